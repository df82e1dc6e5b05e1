"""Films on a cluster of this machine's processes: the same pixels, whatever happens to a worker."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import distributed
import numpy as np
import pytest
from lippmann.base.images import read_picture
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import InputError
from lippmann.rendering import executors, memory_estimate
from lippmann.rendering.executors import choose_executor, render_on_cluster
from lippmann.rendering.plan import Job, check_same_scene
from lippmann.rendering.sinks import MemorySink, render_into, render_picture
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import load_scene
from test_film import DISPLAY, FILM, MOVE, PATIENCE_S, SCENE, until

FRAMES = 30
ANIMATE = ("animate", "film.toml", "--display", "small.toml", "--samples", "16", "--device", "llvm")


class Cluster:
    """A scheduler and workers, each a process of its own."""

    def __init__(self, folder):
        self.folder = folder
        self.file = folder / "scheduler.json"
        self.processes = []
        self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(self.file))
        until(lambda: self.file.exists() and self.file.read_text().endswith("}"), "no scheduler")
        self.address = json.loads(self.file.read_text())["address"]

    def _start(self, what, *words, **options):
        log = (self.folder / f"{what}.log").open("ab")
        command = [sys.executable, "-m", "dask", what, "--no-dashboard", *words]
        with log:
            process = subprocess.Popen(command, cwd=self.folder, stdout=log, stderr=log, **options)
        self.processes.append(process)
        return process

    def worker(self, **options):
        """Add a worker of one thread."""
        return self._start("worker", self.address, "--no-nanny", "--nthreads", "1", **options)

    def film(self, folder, *words):
        """Start to render the film into a folder."""
        command = [sys.executable, "-m", "lippmann", *ANIMATE, "-o", folder, "--json", *words]
        process = subprocess.Popen(command, cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.processes.append(process)
        return process

    def stop(self):
        for process in self.processes:
            process.kill()
            process.communicate()


@pytest.fixture
def cluster(tmp_path):
    made = Cluster(tmp_path)
    yield made
    made.stop()


@pytest.fixture
def place(tmp_path):
    (tmp_path / "three.xml").write_text(SCENE)
    (tmp_path / "small.toml").write_text(DISPLAY)
    (tmp_path / "film.toml").write_text(FILM.replace("5", str(FRAMES)) + MOVE.format("ball-*", 1, 0, 2))
    return tmp_path


def told(process, code=0):
    out, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == code, error
    assert "Traceback" not in error
    return json.loads(out)


def same_pixels(one, other):
    for k in range(FRAMES):
        pictures = [read_picture(folder / f"frame_{k:04d}.exr") for folder in (one, other)]
        np.testing.assert_array_equal(pictures[0].radiance, pictures[1].radiance)
        assert pictures[0].metadata == pictures[1].metadata


def test_a_killed_worker_loses_nothing(mi, place, cluster, monkeypatch):
    """Of two workers one is killed in the middle of a frame; all frames arrive, equal to this process's."""
    first, _ = cluster.worker(), cluster.worker()
    film = cluster.film("shared", "--scheduler", cluster.address)
    until(lambda: len(list((place / "shared").glob("frame_*.exr"))) >= 4 or film.poll() is not None, "no frames")
    assert film.poll() is None, film.communicate()
    first.send_signal(signal.SIGKILL)
    assert told(film)["rendered"] == FRAMES
    monkeypatch.chdir(place)
    assert run([*ANIMATE, "-o", "alone"]) == 0
    same_pixels(place / "shared", place / "alone")
    # They are the same film's frames: either way goes on from the other.
    (place / "alone/frame_0007.exr").unlink()
    assert told(cluster.film("alone", "--workers", "2"))["rendered"] == 1
    same_pixels(place / "shared", place / "alone")


@pytest.mark.full
def test_a_film_waits_for_a_worker(place, cluster):
    """The only worker is killed; the film goes on with the next one."""
    only = cluster.worker()
    film = cluster.film("shared", "--cluster", cluster.address)
    until(lambda: list((place / "shared").glob("frame_*.exr")), "no frames")
    only.send_signal(signal.SIGKILL)
    cluster.worker()
    assert told(film)["rendered"] == FRAMES


def test_where_nobody_is_the_film_does_not_begin(cluster, monkeypatch):
    monkeypatch.setattr(executors, "ANSWER_S", 0.5)
    for address, said in (
        ("tcp://127.0.0.1:9", "no scheduler answers there"),
        ("nonsense://", "no scheduler answers there"),
        (cluster.address, "no worker has joined the scheduler"),
    ):
        with pytest.raises(InputError, match=said):
            next(render_on_cluster(address, "llvm", [None]))


def test_a_worker_of_another_version_is_refused(place, cluster):
    (place / "other").mkdir()
    (place / "other/sitecustomize.py").write_text("import lippmann; lippmann.__version__ = '0.0.0'\n")
    cluster.worker(env={**os.environ, "PYTHONPATH": str(place / "other")})
    error = told(cluster.film("shared", "--cluster", cluster.address), 2)["error"]
    assert "has lippmann 0.0.0" in error
    assert not (place / "shared").exists()


@pytest.mark.full
def test_an_interrupted_film_leaves_whole_frames_and_an_idle_cluster(place, cluster):
    cluster.worker()
    film = cluster.film("shared", "--cluster", cluster.address)
    until(lambda: list((place / "shared").glob("frame_*.exr")), "no frames")
    film.send_signal(signal.SIGINT)
    assert "interrupted" in told(film, 130)["error"]
    names = {path.name for path in (place / "shared").iterdir()}
    assert 1 <= len(names) < FRAMES
    assert all(name.startswith("frame_") for name in names)
    assert told(cluster.film("shared", "--cluster", cluster.address))["kept"] == len(names)


def test_a_lost_scheduler_ends_the_film(mi, place, cluster, monkeypatch, refusal_of):
    """In this process, where Dask looks for the scheduler no longer than is needed here."""
    cluster.worker()
    with distributed.Client(cluster.address) as client:
        client.wait_for_workers(1)
    monkeypatch.setattr(executors, "ANSWER_S", 2.0)
    monkeypatch.chdir(place)

    def kill_scheduler():
        until(lambda: list((place / "shared").glob("frame_*.exr")), "no frames")
        cluster.processes[0].kill()

    with ThreadPoolExecutor(1) as threads:
        killed = threads.submit(kill_scheduler)
        assert "the scheduler is lost" in refusal_of(*ANIMATE, "-o", "shared", "--cluster", cluster.address, code=1)
    killed.result()
    assert {path.suffix for path in (place / "shared").iterdir()} == {".exr"}


@pytest.mark.parametrize("holds_bands", [False, True])
def test_a_stopped_worker_is_given_up_and_told(mi, place, cluster, monkeypatch, caplog, holds_bands):
    """Dask waits five minutes for a process that is stopped and keeps its connections, or its finished bands."""
    monkeypatch.setattr(executors, "STOPPED_WORKER_S", 3.0)
    monkeypatch.setitem(memory_estimate.BAND_PIXELS, "llvm", 1)
    caplog.set_level("WARNING", "lippmann")
    (place / "tall.toml").write_text(DISPLAY.replace("= 32", "= 300"))
    plan = Job(load_scene(place / "three.xml", Placement()), load_display(place / "tall.toml")).plan(portable=True)
    stopped, _ = cluster.worker(), cluster.worker()
    with distributed.Client(cluster.address) as client:
        client.wait_for_workers(2)
    halted = []

    def stop(rows, total=0):
        if rows and not halted:
            time.sleep(4.0 * holds_bands)  # the worker finishes the bands that it has
            halted.append(stopped.send_signal(signal.SIGSTOP))

    stop(not holds_bands)
    sink, began = MemorySink(plan), time.monotonic()
    render_into(sink, choose_executor(scheduler=cluster.address, device="llvm"), stop)
    assert time.monotonic() - began < PATIENCE_S
    np.testing.assert_array_equal(sink.radiance, render_picture(plan).radiance)
    assert any("has not answered for 3 s; others render its bands" in line for line in caplog.messages)


def test_a_scene_that_a_worker_cannot_read_is_told(mi, tmp_path):
    """The check that runs on a worker, with a scene that is not there and one that is another."""
    with pytest.raises(InputError, match=r"worker w: .*no such scene.*share the scene's folder"):
        check_same_scene("worker w", tmp_path / "three.xml", "0" * 64)
    (tmp_path / "three.xml").write_text(SCENE)
    with pytest.raises(InputError, match=r"worker w: .*three\.xml differs there"):
        check_same_scene("worker w", tmp_path / "three.xml", "0" * 64)

"""Pictures rendered by bands: the same pixels, by one process or many, after an interruption or a lost worker."""

import errno
import io
import json
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import Mock

import dask
import lippmann
import numpy as np
import pytest
from lippmann.base.images import read_picture
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import DeviceError, InputError, LippmannWarning, NoSpaceError
from lippmann.motion.film import load_film
from lippmann.motion.film_frames import choose_shading, plan_film
from lippmann.rendering import executors, irradiance_cache_choice, memory_estimate, picture_hash, sinks
from lippmann.rendering.executors import Band, local_workers, render_band, render_here, render_on_cluster
from lippmann.rendering.options import RenderOptions, Settings
from lippmann.rendering.plan import Job
from lippmann.rendering.sinks import KeptBands, bands_folder, log_remaining_bands, render_into, render_picture
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import load_scene
from lippmann.simulation.toolchain import repository
from test_film import DISPLAY, SCENE
from test_film_cluster import Cluster, until

#: Settings whose pixels depend on random numbers, and on none.
SETTINGS = (Settings(samples=3, integrator="path", seed=4), Settings(samples=1))


@pytest.fixture
def place(tmp_path):
    (tmp_path / "three.xml").write_text(SCENE)
    (tmp_path / "small.toml").write_text(DISPLAY.replace("= 32", "= 300"))
    return tmp_path


@pytest.fixture
def narrow(monkeypatch, mi):
    """Bands of 64 rows."""
    monkeypatch.setitem(memory_estimate.BAND_PIXELS, "llvm", 1)


def still(place, settings):
    """Return a plan whose bands are kept, and its scene."""
    display = load_display(place / "small.toml")
    scene = load_scene(place / "three.xml", Placement())
    return Job(scene, display, RenderOptions("exact", settings=settings)).plan(portable=True), scene


def render_bands(path, plan, executor=render_here, progress=None):
    """Render the bands that the folder beside a picture lacks; return all, and the numbers of the new ones."""
    kept = KeptBands(bands_folder(path), plan)
    missing = [band.number for band in kept.missing_bands()]
    render_into(kept, executor, progress)
    return kept, missing


def picture(whole, scene):
    return render_picture(Job(scene, whole.display, whole.options).plan())


def logged(caplog):
    messages = [record.getMessage() for record in caplog.records if record.name == "lippmann"]
    caplog.clear()
    return messages


@pytest.mark.parametrize("settings", SETTINGS)
def test_bands_are_the_picture(place, narrow, settings):
    whole, scene = still(place, settings)
    assert [len(rows) for rows in whole.bands] == [64, 64, 64, 64, 44]
    told = []
    kept, rendered = render_bands(place / "a.exr", whole, render_here, lambda *done: told.append(done))
    assert rendered == [0, 1, 2, 3, 4]
    assert list(dict.fromkeys(told)) == [(n, 300) for n in (0, 64, 128, 192, 256, 300)]
    kept.write(place / "a.exr")
    image = picture(whole, scene)
    image.save(place / "b.exr")
    ours, theirs = (read_picture(place / name) for name in ("a.exr", "b.exr"))
    np.testing.assert_array_equal(ours.radiance, theirs.radiance)
    assert ours.metadata == theirs.metadata
    assert not (place / "a.exr.bands").exists()
    # Any band alone, as a worker renders it.
    np.testing.assert_array_equal(render_band(Band(whole, 3))[0], image.radiance[192:256])


#: A card before a wall that has more points, 0.5 mm apart, than the picture has rays.
WALL = """<scene version="3.0.0">
  <emitter type="point"><point name="position" x="300" y="400" z="600" /><rgb name="intensity" value="4e5" /></emitter>
  <shape type="rectangle"><transform name="to_world"><scale value="13" /><translate y="-2" /></transform></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="190" /><translate z="-20" /></transform></shape>
</scene>"""


def test_auto_shades_the_same_bodies_everywhere(place, narrow, monkeypatch):
    """What was too large for `auto` had its light shared by workers, bands and films: 28 dB, where 45 are kept."""
    monkeypatch.setattr(irradiance_cache_choice, "MIN_LAMPS", 1)
    monkeypatch.setattr(irradiance_cache_choice, "MIN_RAYS", 1)
    monkeypatch.setattr(irradiance_cache_choice, "RAYS_A_POINT", 0.4)
    (place / "three.xml").write_text(WALL)
    whole, scene = still(place, Settings(samples=4))
    auto = picture(whole, scene)
    shared = picture(*still(place, Settings(samples=4, shading="shared")))
    assert auto.metadata["shading"] == shared.metadata["shading"] == "shared"
    # The plan of one compiled for its trial, the render of the other when it began: both say so.
    assert min(auto.measured["prepare_seconds"], shared.measured["prepare_seconds"]) > 0.0
    assert not np.array_equal(auto.radiance, shared.radiance)
    (place / "film.toml").write_text('scene = "three.xml"\nframes = 1\n')
    (shot,) = choose_shading(plan_film(load_film(place / "film.toml"), whole.display, whole.options))
    np.testing.assert_array_equal(render_picture(shot).radiance, auto.radiance)
    for number, rows in enumerate(whole.bands):
        radiance, _ = render_band(Band(whole, number))
        np.testing.assert_array_equal(radiance, auto.radiance[rows.start : rows.stop])


def test_a_link_to_a_scene_stands_where_it_is(place, narrow):
    """Its pictures lie beside it, not beside what it leads to."""
    (place / "own").mkdir()
    (place / "own/linked.xml").symlink_to(place / "three.xml")
    scene = load_scene(place / "own/linked.xml", Placement())
    found = Job(scene, load_display(place / "small.toml"), RenderOptions("exact")).plan(portable=True)
    assert found.scene == place / "own/linked.xml"
    assert found.metadata["scene"] == "linked.xml"


def test_bands_of_many_rays_are_small_and_tell_their_rows(place, mi, monkeypatch):
    """A panel of few pixels, and so many samples that a band has fewest rows; chunks are 4 rows of tiles at most."""
    monkeypatch.setitem(memory_estimate.BAND_RAYS, "llvm", 46 * 64 * 16)
    whole, _ = still(place, Settings(samples=16))
    assert [len(rows) for rows in whole.bands] == [64, 64, 64, 64, 44]
    assert [len(rows) for rows in still(place, Settings(samples=1))[0].bands] == [300]
    monkeypatch.setitem(memory_estimate.CHUNK_SAMPLES, "llvm", 4 * 6 * 64 * 16)
    told = []
    kept, _ = render_bands(place / "a.exr", whole, render_here, lambda *done: told.append(done))
    kept.remove()
    rows = [0, 32, 64, 96, 128, 160, 192, 224, 256, 278, 300]  # the last band: 6 rows of tiles, three of them 22 rows
    assert list(dict.fromkeys(told)) == [(n, 300) for n in rows]


def test_an_interrupted_render_goes_on(place, narrow, caplog):
    whole, scene = still(place, SETTINGS[0])

    def stopped(missing, rows):
        for rendered in render_here(missing, rows):
            if rendered.band.number == 2:
                raise KeyboardInterrupt
            yield rendered

    folder = place / "a.tif.bands"
    caplog.set_level("INFO", "lippmann")
    with pytest.raises(KeyboardInterrupt):
        render_bands(place / "a.tif", whole, stopped)
    assert logged(caplog) == [f"128 of 300 rows are kept in {folder}: the same command goes on from there"]
    assert len(list(folder.iterdir())) == 2
    assert not (place / "a.tif").exists()
    # One is cut short; and there are bands of another render.
    first = sorted(folder.iterdir())[0]
    first.write_bytes(first.read_bytes()[:-5])
    (folder / f"{'0' * 16}-00003.npy").write_bytes(b"another's")
    (folder / "notes.txt").write_text("the user's")
    kept, rendered = render_bands(place / "a.tif", whole)
    assert rendered == [0, 2, 3, 4]
    assert any("a.tif.bands: removed 1 bands left by a different render" in line for line in logged(caplog))
    assert len(list(folder.iterdir())) == 6
    kept.write(place / "a.tif")
    np.testing.assert_array_equal(read_picture(place / "a.tif").radiance, picture(whole, scene).radiance)
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]


def test_one_command_at_a_time_has_the_bands(place, narrow, caplog):
    """Two of one picture took each other's bands away, and one of them lost its work."""
    whole, _ = still(place, SETTINGS[1])
    other, _ = still(place, SETTINGS[0])

    def disturbed(missing, rows):
        for rendered in render_here(missing, rows):
            for second in (whole, other):
                with pytest.raises(InputError, match=r"a\.exr\.bands: is in use by another command"):
                    render_bands(place / "a.exr", second)
            yield rendered

    kept, rendered = render_bands(place / "a.exr", whole, disturbed)
    assert rendered == [0, 1, 2, 3, 4]
    kept.write(place / "a.exr")
    assert not (place / "a.exr.bands").exists()
    caplog.set_level("INFO", "lippmann")
    render_bands(place / "a.exr", other)
    assert logged(caplog) == []


def test_a_picture_that_cannot_be_written_keeps_its_bands(place, narrow, monkeypatch, caplog):
    whole, _ = still(place, SETTINGS[1])
    caplog.set_level("INFO", "lippmann")
    kept, _ = render_bands(place / "a.exr", whole)
    with monkeypatch.context() as patched:
        patched.setattr(sinks, "write_picture", Mock(side_effect=NoSpaceError("full")))
        with pytest.raises(NoSpaceError):
            kept.write(place / "a.exr")
    folder = place / "a.exr.bands"
    assert logged(caplog) == [f"300 of 300 rows are kept in {folder}: the same command goes on from there"]
    kept, rendered = render_bands(place / "a.exr", whole)
    assert rendered == []
    with monkeypatch.context() as patched:
        patched.setattr(np, "memmap", Mock(side_effect=OSError(errno.ENOMEM, "no memory")))
        with pytest.raises(MemoryError):  # and not: the band is gone
            kept.missing_bands()
    kept.write(place / "a.exr")
    assert (place / "a.exr").exists()


def npy(array, save=np.save):
    stream = io.BytesIO()
    save(stream, array)
    return stream.getvalue()


ROWS = np.zeros((64, 46, 3), np.float32)
HEADER = npy(ROWS)[:128]


@pytest.mark.parametrize(
    "content",
    [
        *(b"", b"no band", HEADER, npy(ROWS)[:-1], npy(ROWS, np.savez), npy(ROWS.astype(np.float64)), npy(ROWS[:-1])),
        *(npy(np.array([{"a": 1}], object)), HEADER.replace(b"(64, 46, 3)", b"(-4, 46, 3)")),
        HEADER.replace(b"(64, 46, 3), }", b"(6400000, 4600000, 3), }"[:14]),
    ],
)
def test_what_is_no_band_is_rendered_again(place, narrow, content):
    whole, _ = still(place, SETTINGS[1])
    folder = place / "a.exr.bands"
    folder.mkdir()
    (folder / f"{whole.identity}-00000.npy").write_bytes(content)
    _, rendered = render_bands(place / "a.exr", whole)
    assert rendered == [0, 1, 2, 3, 4]


def test_a_worker_takes_the_bands_of_the_command(place, narrow, monkeypatch):
    """Bands depended on the device of who asked, so that a worker with a GPU rendered other rows."""
    whole, scene = still(place, SETTINGS[1])
    monkeypatch.setitem(memory_estimate.BAND_PIXELS, "llvm", 1 << 30)
    expected = picture(whole, scene).radiance
    np.testing.assert_array_equal(render_band(pickle.loads(pickle.dumps(Band(whole, 2))))[0], expected[128:192])


@pytest.mark.parametrize(
    "change", [{"seed": 5}, {"samples": 2}, {"integrator": "lights"}, {"max_depth": 2}, {"aperture": "full"}]
)
def test_other_settings_are_another_picture(place, mi, change):
    one, _ = still(place, SETTINGS[0])
    other, _ = still(place, replace(SETTINGS[0], **change))
    assert one.identity != other.identity
    same, _ = still(place, replace(SETTINGS[0], memory_mb=5000.0))
    assert one.identity == same.identity


def test_other_code_of_the_same_version_is_told(place, tmp_path, monkeypatch):
    """Whose bands, frames and workers must not be mixed."""
    package = tmp_path / "lippmann"
    shutil.copytree(Path(lippmann.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    changed = package / "optics/faces.py"
    digests = []

    def found():
        picture_hash.code_digest.cache_clear()
        digests.append(picture_hash.code_digest(package))

    found()
    text = changed.read_text()
    for other in (text + "#", text.replace("0", "1", 1), text):
        changed.write_text(other)
        found()
    changed.rename(package / "optics/dome2.py")
    found()
    # An editor's lock is a link that leads nowhere.
    (package / ".#dome.py").symlink_to("nobody@nowhere.1")
    found()
    assert digests[3] == digests[0]
    assert digests[5] == digests[4]
    assert len(set(digests)) == 4
    assert picture_hash.code_digest(tmp_path / "none") == ""
    before = still(place, SETTINGS[0])[0].identity
    monkeypatch.setattr(picture_hash, "code_digest", lambda folder: digests[1])
    assert picture_hash.pixel_versions()["lippmann"].endswith(digests[1])
    assert still(place, SETTINGS[0])[0].identity != before


@pytest.mark.parametrize("first_byte", [200, -8, -2])
def test_a_damaged_band_is_rendered_again_and_told(place, narrow, first_byte):
    """Kept bands had no checksum: a byte that the disk had changed came into the picture."""
    whole, scene = still(place, SETTINGS[1])
    kept, _ = render_bands(place / "a.exr", whole)
    kept.release()
    path = place / "a.exr.bands" / f"{whole.identity}-00064.npy"
    content = bytearray(path.read_bytes())
    content[first_byte] ^= 0x10
    path.write_bytes(content)
    with pytest.warns(LippmannWarning, match=r"-00064\.npy: this band is damaged and will be rendered again"):
        kept, rendered = render_bands(place / "a.exr", whole)
    assert rendered == [1]
    np.testing.assert_array_equal(kept[64:128], picture(whole, scene).radiance[64:128])


def test_a_scheduler_that_is_not_there_leaves_nothing(large, mi, monkeypatch, refusal_of):
    monkeypatch.setattr(executors, "ANSWER_S", 0.5)
    monkeypatch.chdir(large)
    before = set(large.iterdir())
    words = "-o", "a.png", "--scheduler", "tcp://127.0.0.1:1"
    assert "tcp://127.0.0.1:1" in refusal_of(*RENDER, *words)
    assert "workers and scheduler are both given" in refusal_of(*RENDER, *words, "--workers", "2")
    assert set(large.iterdir()) == before


def test_a_still_counts_the_rays_of_its_subpixels(place, mi):
    """Three for a pixel whose red, green and blue are beside each other."""
    whole, _ = still(place, SETTINGS[0])
    striped = replace(whole, display=replace(whole.display, panel=replace(whole.display.panel, subpixels="rgb")))
    assert (whole.rays, striped.rays) == (3, 9)
    assert striped.start().rays == 9


def test_a_limit_below_one_band_is_refused(place, narrow):
    whole, _ = still(place, Settings())
    small = replace(whole, options=replace(whole.options, settings=Settings(memory_mb=100.0)))
    refusal = "a band of 64 rows of 46 pixels: needs 501 MB, the limit is 100 MB; raise memory_mb"
    with pytest.raises(InputError, match=re.escape(refusal)):
        render_bands(place / "a.exr", small)
    assert not (place / "a.exr.bands").exists()


@pytest.mark.parametrize(("name", "samples"), [("paper-square", 23), ("uhd-4k", 5)])
def test_long_renders_are_kept(name, samples):
    """2^27 rays: 2400 x 2400 pixels with one for all colours, 3840 x 2160 with one for each of three."""
    display = load_display(repository() / f"scenes/displays/{name}.toml")
    for more, kept in ((0, False), (1, True)):
        options = RenderOptions("exact", settings=Settings(samples=samples + more))
        assert memory_estimate.is_long_render(options.settings, display) == kept


#: A panel of four bands.
LARGE = DISPLAY.replace("= 46", "= 2048").replace("= 32", "= 2048")
RENDER = ("render", "three.xml", "--display", "large.toml", "--samples", "1", "--model", "exact", "--device", "llvm")


@pytest.fixture
def large(place):
    (place / "large.toml").write_text(LARGE)
    return place


def started(place, *words):
    # SIGHUP is ignored where the tests run under nohup.
    command = ["env", "--default-signal=HUP", Path(sys.executable).with_name("lippmann"), *RENDER, "--json", *words]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=place, stdout=pipe, stderr=pipe, text=True, start_new_session=True)


def told(process):
    out, error = process.communicate(timeout=120.0)
    assert (process.returncode, "current folder" in error) == (0, False), error
    return json.loads(out)


def test_a_killed_worker_loses_its_band_only(large, mi, monkeypatch):
    """Of two workers, in another folder, one is killed; the picture is whole, and equal to one process's."""
    elsewhere = large / "elsewhere"
    elsewhere.mkdir()
    cluster = Cluster(elsewhere)
    try:
        first, _ = cluster.worker(), cluster.worker()
        process = started(large, "-o", "shared.exr", "--scheduler", cluster.address)
        folder = large / "shared.exr.bands"
        until(lambda: (folder.is_dir() and any(folder.iterdir())) or process.poll() is not None, "no bands")
        first.send_signal(signal.SIGKILL)
        said = told(process)
    finally:
        cluster.stop()
    assert (said["bands"], said["bands_kept"]) == (4, 0)
    monkeypatch.chdir(large)
    assert run([*RENDER, "-o", "alone.exr"]) == 0
    ours, theirs = (read_picture(large / f"{name}.exr") for name in ("alone", "shared"))
    np.testing.assert_array_equal(ours.radiance, theirs.radiance)
    assert ours.metadata == theirs.metadata


def test_own_workers_and_a_killed_command(large, mi):
    """A command that starts its workers is killed; the next one goes on, and leaves nothing.

    Neither runs anything of the current folder.
    """
    for name in ("signal", "random", "numpy", "distributed"):
        (large / f"{name}.py").write_text("raise SystemExit('ran a file of the current folder')")
    process = started(large, "-o", "a.png", "--workers", "2")
    folder = large / "a.png.bands"
    until(lambda: (folder.is_dir() and any(folder.glob("[0-9a-f]*.npy"))) or process.poll() is not None, "no bands")
    process.kill()
    process.communicate()
    said = told(started(large, "-o", "a.png", "--workers", "2"))
    assert said["bands"] == 4
    assert said["bands_kept"] >= 1
    assert sorted(path.name for path in large.glob("*a.png*")) == ["a.png"]


@pytest.mark.parametrize("script", ["script.py", "-"])
def test_own_workers_do_not_run_the_users_script(large, mi, script):
    """It needs no `if __name__ == "__main__"`: Python would run it in each worker, whose render starts workers."""
    text = "import lippmann\nprint('runs')\nlippmann.render('three.xml', 'large.toml', 1, device='llvm', workers=2)"
    (large / "script.py").write_text(text)
    done = subprocess.run([sys.executable, script], check=False, cwd=large, input=text, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "runs\n"), done.stderr


def test_nobody_else_may_use_own_workers():
    """Who reaches the scheduler may run programs there: without its key, which no other process has, nobody does.

    Dask's own limit of memory is off.
    """
    from distributed import Client, Security

    with local_workers(1) as (address, security):
        assert address.startswith("tls://127.0.0.1:")
        for where, key in ((address.replace("tls", "tcp"), None), (address, Security.temporary())):
            with pytest.raises(OSError, match=r"certificate does not match|Timed out|in <TCP"):
                Client(where, security=key, timeout=3)
        with Client(address, security=security, timeout=20) as client:
            limits = client.run(lambda dask_worker: dask_worker.memory_manager.memory_limit)
            assert list(limits.values()) == [None]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_all_processes_of_a_terminal_is_one_line(large, mi, number):
    process = started(large, "-o", "a.png", "--workers", "2", "--samples", "256")  # longer than this test
    until(lambda: (large / "a.png.bands").is_dir() or process.poll() is not None, "no bands")
    os.killpg(process.pid, number)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, json.loads(out)["exit_code"]) == (128 + number, 128 + number)
    assert "Traceback" not in err
    assert "leaked" not in err
    assert err.splitlines()[-1].startswith("lippmann: interrupted")


def test_workers_that_lack_memory_are_refused_not_waited_for(large, monkeypatch, refusal_of):
    """Dask would have them wait for memory: what all of them need is looked at before."""
    monkeypatch.chdir(large)
    said = refusal_of(*RENDER, "-o", "a.png", "--workers", "64", "--memory-mb", "2000")
    assert re.search(r"rows of \d+ pixels for each of 4 workers: needs \d+ MB.*--memory-mb, or .* fewer", said)
    assert not (large / "a.png.bands").exists()


@dataclass
class DeadlyPlan:
    """A plan whose renderer ends or stops its worker."""

    number: signal.Signals
    name, identity = "the picture", "0" * 16

    def start(self, worker):
        os.kill(os.getpid(), self.number)


@pytest.mark.parametrize(
    ("number", "more", "message"),
    [(signal.SIGKILL, 0, ".* crashed several .*: use fewer .*"), (signal.SIGSTOP, 3, "no worker is left; run .*")],
)
def test_own_workers_that_end_are_told(monkeypatch, number, more, message):
    """Dask gives a task to three more workers, or to none. It does not replace a stopped worker."""
    monkeypatch.setattr(executors, "STOPPED_WORKER_S", 3.0)
    failures = dask.config.set({"distributed.scheduler.allowed-failures": more})
    with failures, local_workers(1) as (address, security), pytest.raises(DeviceError) as error:
        list(render_on_cluster(address, "llvm", [Band(DeadlyPlan(number), 0)], security))
    assert re.fullmatch(f"--workers: {message}", str(error.value))


def test_bands_that_are_left_are_told(place, narrow, capfd, caplog):
    whole, _ = still(place, SETTINGS[1])
    render_bands(place / "a.exr", whole)[0].release()
    caplog.set_level("INFO", "lippmann")
    log_remaining_bands(place / "a.exr")
    (line,) = logged(caplog)
    assert line.startswith(f"{place}/a.exr.bands: has 5 bands of an unfinished render; ")
    log_remaining_bands(place / "b.exr")
    assert logged(caplog) == []
    words = [str(place / "three.xml"), "--display", str(place / "small.toml"), "-o", str(place / "a.exr")]
    assert run(["render", *words, "--device", "llvm"]) == 0
    assert f"{place}/a.exr.bands: has 5 bands" in capfd.readouterr().err


@pytest.mark.parametrize("engine", ["golden", pytest.param("twin", marks=pytest.mark.full)])
def test_layers_by_workers_are_those_of_one_process(large, monkeypatch, capfd, engine):
    monkeypatch.chdir(large)
    monkeypatch.setitem(memory_estimate.BAND_PIXELS, "llvm", 1)
    layers = str(repository() / "scenes/layers/fish")
    common = ["render", layers, "--display", "small.toml", "--engine", engine, "--samples", "2"]
    assert run([*common, "-o", "one.exr"]) == 0
    capfd.readouterr()
    assert run([*common, "-o", "two.exr", "--workers", "2", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["bands"] == 5
    one, two = (read_picture(large / name) for name in ("one.exr", "two.exr"))
    np.testing.assert_array_equal(one.radiance, two.radiance)
    assert one.metadata == two.metadata


def test_python_keeps_bands_and_shares_them(place, narrow):
    """`kept`, `workers`: an interrupted `lippmann.render` goes on, and its bands stay for the next call."""
    options = {"samples": 1, "model": "exact", "placement": Placement(), "device": "llvm"}
    scene, display, folder = place / "three.xml", place / "small.toml", place / "three.bands"
    usual = lippmann.render(scene, display, **options)

    def interrupt(done, total):
        if done > 128:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        lippmann.render(scene, display, **options, kept=folder, progress=interrupt)
    assert len(list(folder.iterdir())) == 2
    shared = lippmann.render(scene, display, **options, kept=folder, workers=2)
    assert (shared.measured["bands"], shared.measured["bands_kept"]) == (5, 2)
    in_memory = lippmann.render(scene, display, **options, workers=1)
    for image in (shared, in_memory, lippmann.render(scene, display, **options, kept=folder)):
        np.testing.assert_array_equal(image.radiance, usual.radiance)
        assert image.metadata == usual.metadata
    with pytest.raises(InputError, match="need a scene file, not a scene in memory"):
        lippmann.render({"type": "scene", "ball": {"type": "sphere"}}, display, **options, workers=2)
    paint = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.0, np.nan, 0.0]}}
    with pytest.raises(InputError, match=r"the scene: reflectance\.value of the material 'paint' is not finite"):
        lippmann.render({"type": "scene", "ball": {"type": "sphere", "paint": paint}}, display, **options)


def test_what_a_folder_for_bands_says(place, mi, caplog):
    """A picture of one band is not kept before it is complete; foreign files stay, and are named."""
    caplog.set_level("INFO", "lippmann")
    folder = place / "kept"
    folder.mkdir()
    (folder / "mine.txt").touch()
    options = {"samples": 1, "model": "exact", "placement": Placement(), "device": "llvm", "kept": folder}
    with pytest.warns(LippmannWarning, match="kept: has 1 other files or folders, which stay there"):
        lippmann.render(place / "three.xml", place / "small.toml", **options)
    assert "the picture is one band, so it is kept only when complete" in caplog.text
    assert (folder / "mine.txt").exists()
    lock = sinks.FolderLock(folder, "")
    with pytest.raises(InputError, match=r"is in use by another command.*or give another folder as kept"):
        lippmann.render(place / "three.xml", place / "small.toml", **options)
    lock.close()


@pytest.mark.parametrize("kept", [None, "kept"])
def test_a_black_picture_is_warned_of_once(place, narrow, kept):
    """Python was silent without a log; a picture with one value of light has no warning."""
    plan, _ = still(place, Settings())
    for light, expected in ((0.0, ["the whole picture is black"]), (1.0, [])):

        def nearly_black(bands, report, light=light):
            for rendered in render_here(bands, report):
                radiance = np.zeros_like(rendered.radiance)
                radiance[-1, -1, -1] = light * (rendered.band.number == 4)
                yield rendered._replace(radiance=radiance)

        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            render_picture(plan, nearly_black, None if kept is None else place / f"{kept} {light}")
        assert [str(one.message).partition(":")[0] for one in caught] == expected


def test_nan_and_infinity_of_a_renderer_are_warned_of(place, narrow):
    plan, _ = still(place, Settings())

    def broken(bands, report):
        for rendered in render_here(bands, report):
            radiance = np.array(rendered.radiance)
            radiance[2, 7] = np.nan, np.inf, -np.inf
            yield rendered._replace(radiance=radiance)

    with pytest.warns(LippmannWarning, match=r"band 4 .*: NaN or infinity \(count: 3, the first in row 2, column 7\)"):
        image = render_picture(plan, broken)
    np.testing.assert_array_equal(image.radiance[2, 7], [0.0, 65504.0, 0.0])
    assert np.isfinite(image.radiance).all()

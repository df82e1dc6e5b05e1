"""Commands that are killed at any moment: no file is half-written, nothing is left after the next start, boards go on.

`LIPPMANN_KILLS` is the number of kills of each command.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lippmann.base import files
from lippmann.base.images import read_picture, write_picture
from lippmann.display.description import load_display
from lippmann.fixed.build import Build
from lippmann.simulation import harness, virtual_board
from lippmann.simulation.compilation import FAST
from lippmann.simulation.toolchain import build_folder, repository

pytestmark = pytest.mark.full
KILLS = int(os.environ.get("LIPPMANN_KILLS", "4"))
SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))
SCENES = repository() / "scenes"
#: By signal, the exit codes of a process that it ends: Lippmann's, and the system's before Python runs.
CODES = {signal.SIGKILL: {-9}, signal.SIGTERM: {143, -15}, signal.SIGINT: {130, -2}}
#: Longest time that a command takes to end after a signal, s: this machine may be busy.
PATIENCE_S = 30.0
DISPLAY = """gap_mm = 3.3
[panel]
width_px = 112
height_px = 80
dpi = 254
[array]
grid = "square"
pitch_mm = 1.0
focal_length_mm = 3.3
index = 1.5
"""
FILM = """scene = "chart/chart.xml"
frames = 3
[world]
keys = [{ frame = 0 }, { frame = 2, offset_mm = [0, 0, 5] }]
"""
FEW = ["--samples", "1", "--device", "llvm"]
PLACED = ["--display", "tiny.toml", "--scale", "0.1", *FEW]
#: Commands that write files, and the patterns of these.
WRITERS = {
    "render": (["render", "chart/chart.xml", *PLACED, "-o", "a.exr"], "a.exr"),
    "capture": (["capture", "chart/chart.xml", "--setup", "plain.toml", "--size", "320", *FEW, "-o", "b.exr"], "b.exr"),
    "animate": (["animate", "film.toml", *PLACED, "-o", "frames"], "frames/frame_*.exr"),
    "trace": (
        ["trace", "--display", "tiny.toml", "--engine", "rtl", "--fraction-bits", "17", "--pixels", "9", "-o", "r.npz"],
        "r.npz",
    ),
}


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("tiny.toml").write_text(DISPLAY)
    Path("film.toml").write_text(FILM)
    setup = (SCENES / "setups/plain.toml").read_text()
    Path("plain.toml").write_text(setup.replace("../displays", str(SCENES / "displays")))
    os.symlink(SCENES / "chart", "chart")
    print(f"seed {SEED}")
    return tmp_path


def started(words) -> subprocess.Popen[str]:
    program = [sys.executable, "-m", "lippmann", *words]
    return subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


def finished(words) -> float:
    """Run a command to its end; return how long it took."""
    began = time.monotonic()
    process = started(words)
    _, err = process.communicate()
    assert process.returncode == 0, err
    return time.monotonic() - began


def killed(words, rng, longest_s) -> None:
    """Start a command, and end it after a random time by a random signal."""
    number, after = list(CODES)[rng.integers(len(CODES))], rng.uniform(0.0, longest_s)
    print(f"{number.name} after {after:.3f} s")
    process = started(words)
    time.sleep(after)
    process.send_signal(number)
    _, err = process.communicate(timeout=PATIENCE_S)
    if number == signal.SIGINT and err.startswith("Could not import runpy module"):
        return  # Python itself was interrupted, in the milliseconds before it reads any of Lippmann's files
    assert process.returncode in CODES[number] | {0}, (process.returncode, err)
    assert "Traceback" not in err


def content(path: Path) -> bytes:
    """Return what a whole file holds but the times in it."""
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            return b"".join(arrays[name].tobytes() for name in sorted(arrays.files))
    return read_picture(path).radiance.tobytes()


def partials(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*") if files.PARTIAL.fullmatch(path.name))


def programs_in(place: Path) -> Iterator[str]:
    """Yield the command lines of the other programs that run in a folder."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            if int(process.name) != os.getpid() and words and (process / "cwd").readlink() == place:
                yield words
        except OSError:  # it has ended
            continue


@pytest.mark.parametrize("command", WRITERS)
def test_no_file_is_half_written(place, command):
    words, pattern = WRITERS[command]
    compiled = None
    if command == "trace":  # compiled each time, as on a new machine; no other test has this word length
        build = replace(Build.of(load_display("tiny.toml"), "exact", 17, aims=False), cross_cells=True)
        compiled = harness.ray_library(build, FAST)
        compiled.unlink()
    longest_s = finished(words)
    assert compiled is None or compiled.exists()
    wanted = {path.name: content(path) for path in Path().glob(pattern)}
    assert wanted
    usual = {path.name for path in place.iterdir()}
    rng = np.random.default_rng([SEED, len(command)])
    for _ in range(KILLS):
        for path in Path().glob(pattern):
            path.unlink()
        if compiled is not None:
            compiled.unlink()
        killed(words, rng, 1.1 * longest_s)
        for path in Path().glob(pattern):
            assert content(path) == wanted[path.name]
        finished(words)
        assert {path.name: content(path) for path in Path().glob(pattern)} == wanted
        assert {path.name for path in place.iterdir()} == usual
        assert not partials(place)
        # Other tests compile here at the same time; what processes that have ended left must be gone.
        left = partials(build_folder() / "sim")
        files.remove_stale(build_folder() / "sim")
        assert partials(build_folder() / "sim") == left


def test_a_board_goes_on_after_a_killed_stream(place):
    rng = np.random.default_rng([SEED, 1])
    display = load_display("tiny.toml")
    for name in ("one.png", "two.png"):
        light = rng.random((80, 112, 3)).astype(np.float32)
        write_picture(name, light, {"identity": display.identity})
    with virtual_board.running(display) as board:
        words = ["stream", "one.png", "two.png", "--port", board.url]
        longest_s = finished(words)
        for _ in range(KILLS):
            killed(words, rng, 1.1 * longest_s)
            finished([*words, "--verify"])


def test_a_killed_start_of_a_board_is_no_hindrance(place):
    rng = np.random.default_rng([SEED, 2])
    words = ["board", "start", "--display", "tiny.toml", "--ready", "board.json", "--capture", "shown", "--background"]
    stop = ["board", "stop", "--ready", "board.json"]
    longest_s = finished(words)
    finished(stop)
    for _ in range(KILLS):
        killed(words, rng, 1.1 * longest_s)
        process = started(stop)  # the board may run, or not, or have ended because nobody waits for it
        said = str(process.communicate())
        assert process.returncode in (0, 2) or "the command that started this board was killed" in said, said
        until = time.monotonic() + PATIENCE_S
        while left := list(programs_in(place)):  # it ends when it is ready, and sees that nobody waits
            assert time.monotonic() < until, left
            time.sleep(0.1)
        finished(words)
        assert list(programs_in(place))  # the board
        finished(stop)
        assert not Path("board.json").exists()
        assert not list(programs_in(place))
        assert not partials(place)

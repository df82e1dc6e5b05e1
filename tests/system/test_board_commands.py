"""`lippmann board` and `lippmann stream` as a person uses them: one board in the background, and bad input."""

import contextlib
import io
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import zlib
from pathlib import Path

import numpy as np
import pytest
from full_disk import full_disk
from lippmann.base.images import read_picture, write_picture
from lippmann.base.tones import encode
from lippmann.board.streaming import Sender
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import DeviceError
from lippmann.simulation import virtual_board
from PIL import Image

ROOT = Path(__file__).parents[2]
WIDTH, HEIGHT = 112, 80  # as the board of test_virtual_board, compiled once


def lippmann(*words):
    """Run the command in this process: exit code, stdout, stderr."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run([str(word) for word in words])
    return code, out.getvalue(), err.getvalue()


def process(*words):
    """Run the command as a person does, in a process of its own: exit code, stdout, stderr."""
    command = [sys.executable, "-m", "lippmann", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    return done.returncode, done.stdout, done.stderr


def asked(*words, by=lippmann):
    """Run what must succeed; what it says in JSON."""
    code, out, err = by(*words, "--json")
    assert code == 0, err
    return json.loads(out)


def refused(*words, code=2, by=lippmann):
    """Run what must be refused, in one line; that line."""
    found, out, err = by(*words)
    assert (found, out) == (code, ""), err
    lines = [line for line in err.splitlines() if line.startswith("lippmann: ")]
    assert len(lines) == 1, err
    assert "Traceback" not in err
    return lines[0]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a display and images for it."""
    place = tmp_path_factory.mktemp("board")
    text = (ROOT / "scenes/displays/paper-square.toml").read_text()
    text = text.replace("width_px = 2400", f"width_px = {WIDTH}").replace("height_px = 2400", f"height_px = {HEIGHT}")
    (place / "small.toml").write_text(text)
    radiance = np.random.default_rng(1).random((HEIGHT, WIDTH, 3)).astype(np.float32)
    own = {"identity": load_display(place / "small.toml").identity}
    write_picture(place / "own.exr", radiance, own)
    write_picture(place / "second.exr", radiance[::-1], own)
    write_picture(place / "other.exr", radiance, {"identity": "0123456789abcdef"})
    write_picture(place / "nobody.png", radiance, {})
    write_picture(place / "large.exr", np.zeros((HEIGHT, WIDTH + 1, 3), np.float32), own)
    (place / "cut.exr").write_bytes((place / "own.exr").read_bytes()[:3000])
    (place / "text.png").write_text("no picture")
    return place


@pytest.fixture(scope="module")
def port(place):
    """A board that runs in the background; frames that it scans out are in `screen`."""
    (place / "screen").mkdir()
    ready = place / "board.json"
    start = ("board", "start", "--display", place / "small.toml", "--ready", ready, "--background")
    told = asked(*start, "--capture", place / "screen", by=process)
    assert told == json.loads(ready.read_text())
    try:
        assert "belongs to a running board" in refused(*start, by=process)
        yield told["url"]
    finally:
        assert asked("board", "stop", "--ready", ready, by=process)["pid"] == told["pid"]
    assert not ready.exists()
    assert "names no board" in refused("board", "stop", "--ready", ready, by=process)


def values(path):
    """The panel's values of a linear image: sRGB, 8 bits."""
    return np.rint(encode(read_picture(path).radiance, "srgb") * 255).astype(np.uint8)


def captured(place, count, seconds=30.0):
    """The captured frames once `count` are there: the board's process writes a frame after the panel showed it."""
    end = time.monotonic() + seconds
    while True:
        paths = sorted((place / "screen").glob("frame-*.png"))
        if len(paths) >= count or time.monotonic() > end:
            return paths
        time.sleep(0.02)


def settled(place, seconds=0.5):
    """The captured frames once no other comes for a while."""
    paths = captured(place, 0)
    while len(more := captured(place, len(paths) + 1, seconds)) > len(paths):
        paths = more
    return paths


def test_a_frame_is_streamed_verified_and_captured(place, port):
    for name in ("own.exr", "second.exr"):
        wanted = values(place / name)
        frame = asked("stream", place / name, "--port", port, "--verify", by=process)["frames"][0]
        assert frame["crc"] == f"{zlib.crc32(wanted.tobytes()):08x}"
        assert frame["verified"]
        assert (frame["tiles"], frame["unchanged"]) == (12, False)
    info = asked("board", "info", "--port", port, by=process)
    assert info["panel"] == {"width": WIDTH, "height": HEIGHT}
    assert info["shown_crc"] == frame["crc"]
    again = asked("stream", place / "second.exr", "--port", port)["frames"][0]
    assert (again["unchanged"], again["sends"]) == (True, 0)
    found = asked("doctor", "--port", port)["checks"][-1]
    assert (found["check"], found["ok"]) == (port, True)
    assert found["detail"].startswith("a board")
    last = settled(place)[-1]
    shown = np.rint(encode(read_picture(last).radiance, "srgb") * 255).astype(np.uint8)
    np.testing.assert_array_equal(shown, wanted)


@pytest.mark.parametrize("frames", [6, pytest.param(24, marks=pytest.mark.full)])
def test_a_film_is_shown_frame_by_frame(place, port, frames):
    """The shipped film, whole or in fewer frames, rendered for the board, streamed, and scanned out byte for byte."""
    text = (ROOT / "scenes/films/swim.toml").read_text().replace("../fish", str(ROOT / "scenes/fish"))
    text = re.sub(r"\bframe = (\d+)", lambda key: f"frame = {int(key[1]) * (frames - 1) // 23}", text)
    (place / "film.toml").write_text(text.replace("frames = 24", f"frames = {frames}"))
    film = ("animate", place / "film.toml", "--display", place / "small.toml", "--scale", 0.05, "--samples", 1)
    assert asked(*film, "-o", place / f"film-{frames}")["frames"] == frames
    paths = sorted((place / f"film-{frames}").glob("frame_*.exr"))
    wanted = [values(path) for path in paths]
    before = len(settled(place))
    sent = asked("stream", *paths, "--port", port, "--verify")["frames"]
    assert [frame["crc"] for frame in sent] == [f"{zlib.crc32(frame.tobytes()):08x}" for frame in wanted]
    assert all(frame["verified"] and not frame["unchanged"] for frame in sent)
    assert sum(frame["copied"] + frame["skipped"] for frame in sent[1:]) >= len(paths), (
        "what stands still is sent again"
    )
    shown = captured(place, before + len(wanted))[before:]
    assert len(shown) == len(wanted)
    for path, frame in zip(shown, wanted, strict=True):
        np.testing.assert_array_equal(values(path), frame)


def test_a_live_picture_is_never_torn(place, port, monkeypatch):
    """Of a scene that turns the panel shows pictures that were made, each whole, and at last the finest."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    made, send = [], Sender.send
    monkeypatch.setattr(Sender, "send", lambda sender, pixels: (made.append(pixels.tobytes()), send(sender, pixels)))
    before = len(settled(place))
    told = asked(
        "live", ROOT / "scenes/knot/knot.xml", "--display", place / "small.toml", "--port", port, "--fit", "--turn", 60,
        "--turn-seconds", 3, "--seconds", 3, "--samples", 8, "--device", "llvm",
    )  # fmt: skip
    frames = [np.asarray(Image.open(path).convert("RGB")).tobytes() for path in settled(place)[before:]]
    assert told["samples"] == 8
    assert 3 <= len(frames) <= told["board"]["frames"] <= len(made)
    assert set(frames) <= set(made)
    assert frames[-1] == made[-1]


def test_registers_are_read_and_written(place, port):
    assert asked("board", "read", "identity", "--port", port)["words"] == [int.from_bytes(b"LIPB")]
    assert asked("board", "write", "display", "brightness=127", "--port", port)["words"] == [0x7F]
    assert asked("board", "read", "display", "--port", port)["fields"] == {"brightness": 127, "pattern": 0}
    assert asked("board", "write", "0x18", "0xFF", "--port", port)["words"] == [0xFF]
    assert asked("board", "read", "0x18", "--port", port)["words"] == [0xFF]
    assert asked("board", "setup", "--display", place / "small.toml", "--port", port)["writes"] > 10


def test_rays_are_those_of_the_twin(place, port):
    check = ("board", "check", "--display", place / "small.toml", "--port", port)
    whole = asked(*check)
    assert (whole["rays"], whole["equal"]) == (WIDTH * HEIGHT, True)
    part = asked(*check, "--region", "100,70,12,10")
    assert (part["rays"], part["equal"]) == (120, True)
    assert part["crc"] != whole["crc"]
    assert "not inside" in refused(*check, "--region", "100,70,13,10")
    for number in ("1.5", "1e300"):
        assert "whole numbers" in refused(*check, "--region", f"0,0,{number},1")
    assert "LEFT,TOP,WIDTH,HEIGHT" in refused(*check, "--region", "0,0,1")
    for far in ("1000000,0,1,1", "0,0,99999,1", "-1,0,1,1", "0,0,0,1"):
        line = refused(*check, "--region", far)
        assert "--region: is not inside" in line
        assert len(line) < 150
    other = ROOT / "scenes/displays/vga-square.toml"
    assert "the board drives display" in refused("board", "check", "--display", other, "--port", port)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("read", "nothing"), "nothing: no such register"),
        (("write", "nothing", 1), "nothing: no such register"),
        (("write", "clock", 1), "clock: can only be read"),
        (("write", "display", 1 << 11), "2048: sets bits outside the fields of display"),
        (("write", "display", "brightness=256"), "brightness=256: is out of range; give 0 to 255"),
        (("write", "display", "brightness=x"), "brightness=x: is not an integer"),
        (("write", "display", "colour=1"), "display has no field colour"),
        (("write", "display", "brightness=1", "brightness=2"), "a field is named twice"),
        (("write", "display", "brightness=1", 2), "give words or FIELD=VALUE"),
        (("write", "display", "pattern=7"), "pattern=7: pattern 7 is not defined; choose from 0 off, 1 single_lens"),
        (("write", "display", "pattern=99"), "pattern=99: pattern 99 is not defined; choose from 0 off"),
        (("write", "display", 0x6FF), "1791: pattern 6 is not defined"),
        (("write", "--", "0x18", -1), "-1: is out of range"),
        (("setup", "--display", ROOT / "scenes/displays/vga-square.toml"), "--force"),
    ],
)
def test_bad_registers_and_values_are_refused(port, words, message):
    before = asked("board", "read", "display", "--port", port)["words"]
    assert message in refused("board", words[0], "--port", port, *words[1:])
    assert asked("board", "read", "display", "--port", port)["words"] == before


@pytest.mark.parametrize(
    ("image", "message"),
    [
        ("other.exr", "was rendered for display 0123456789abcdef"),
        ("nobody.png", "names no display"),
        ("large.exr", f"{WIDTH + 1} x {HEIGHT}"),
        ("cut.exr", "cut.exr"),
        ("text.png", "text.png"),
        ("missing.exr", "missing.exr"),
        ("board.json", "unknown extension"),
    ],
)
def test_images_that_do_not_belong_are_refused_and_the_last_frame_stays(place, port, image, message):
    asked("stream", place / "own.exr", "--port", port)
    epoch = asked("board", "read", "epoch", "--port", port)["words"]
    # A good one before it is not shown either.
    assert message in refused("stream", place / "second.exr", place / image, "--port", port)
    assert asked("board", "read", "epoch", "--port", port)["words"] == epoch


def test_bad_options_of_a_board_are_refused_before_it_is_compiled(place, tmp_path, monkeypatch, capsys):
    start = ["board", "start", "--display", str(place / "small.toml")]
    monkeypatch.setattr(virtual_board, "compiled", lambda *_: pytest.fail("compiled"))
    for words in ("10", "5"), ("5", "5"):
        assert run([*start, "--trace", str(tmp_path / "a.fst"), "--trace-clocks", *words]) == 2
        assert "--trace-clocks: " in capsys.readouterr().err
    assert run([*start, "--line", "pty", "--tcp-port", "4000"]) == 2
    assert "pty" in capsys.readouterr().err
    for drawn in ("--slots", "3"), ("--slot", "32x32"), ("--slot", "256x192"), ("--bilinear",), ("--samples", "1"):
        assert run([*start, *drawn]) == 2
        assert "add --layers N" in capsys.readouterr().err
    assert run([*start, "--background"]) == 2
    assert capsys.readouterr().err.startswith("lippmann: --background needs --ready FILE")
    assert run([*start, "--background", "--ready", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"lippmann: --ready: {tmp_path} is a folder; name a file\n"
    with socket.create_server(("127.0.0.1", 0)) as busy:
        number = busy.getsockname()[1]
        for more in [], ["--background", "--ready", str(tmp_path / "a.json")]:
            assert run([*start, "--tcp-port", str(number), *more]) == 1
            said = f"lippmann: --tcp-port: cannot listen on port {number} (Address already in use); choose another"
            assert capsys.readouterr().err.startswith(said)

    # Root may write anywhere: ask as one who may not.
    def refuse(*_, **__):
        raise PermissionError

    with monkeypatch.context() as denied:
        denied.setattr(Path, "mkdir", refuse)
        assert run([*start, "--capture", str(tmp_path / "no" / "place")]) == 2
    assert capsys.readouterr().err.startswith(
        f"lippmann: --capture: {tmp_path / 'no' / 'place'} cannot be made; choose"
    )
    monkeypatch.setattr(os, "access", lambda *_: False)
    for option, path in (("--capture", tmp_path), ("--ready", tmp_path / "a.json"), ("--trace", tmp_path / "a.fst")):
        assert run([*start, option, str(path)]) == 2
        assert f"{option}: {tmp_path} cannot be written to" in capsys.readouterr().err


def children(pid):
    """Return the processes that a process started."""
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def alive(pid):
    """Tell whether a process runs; one that nobody asked about after its end does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def wait_until(done, seconds=60.0):
    until = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < until
        time.sleep(0.05)


def test_what_ended_a_board_in_the_background_is_told(place, tmp_path):
    ready = tmp_path / "board.json"
    start = ("board", "start", "--display", place / "small.toml", "--ready", ready, "--background")
    for _ in range(2):
        code, out, err = process(*start, "--json")
        assert code == 0, err
        pid = json.loads(out)["pid"]
        (board,) = children(pid)
        os.kill(board, signal.SIGKILL)
        wait_until(lambda pid=pid: not alive(pid))
    # The second start told of the first.
    assert "the previous board had ended: the virtual board failed (signal 9)" in err
    line = refused("board", "stop", "--ready", ready, code=1)
    assert "had already ended: the virtual board failed (signal 9)" in line
    assert "exit code 1" in line


def test_a_frame_that_cannot_be_kept_ends_a_board_in_the_background_and_is_told(place, tmp_path):
    ready, folder = tmp_path / "board.json", tmp_path / "screen"
    # What stands in the way of the first frame's PNG.
    (folder / "frame-00000001.png").mkdir(parents=True)
    start = ("board", "start", "--display", place / "small.toml", "--ready", ready, "--background")
    code, out, told = process(*start, "--capture", folder, "--json")
    if code == 0:  # it ended after it could be reached
        wait_until(lambda: not alive(json.loads(out)["pid"]))
        code, _, told = lippmann("board", "stop", "--ready", ready)
    assert code == 3
    assert "frame-00000001.png: is a folder" in told
    # The frame itself is there: the panel's bytes.
    assert (folder / "frame-00000001.rgb").stat().st_size == 3 * WIDTH * HEIGHT
    assert not ready.exists()


def test_links_that_another_user_planted_are_not_followed(place, tmp_path):
    mine, folder = tmp_path / "mine", tmp_path / "screen"
    mine.write_text("precious")
    folder.mkdir()
    for number in range(1, 4):
        (folder / f"frame-{number:08d}.rgb.part").symlink_to(mine)
    ready = tmp_path / "board.json"
    Path(f"{ready}.log").symlink_to(mine)
    start = ("board", "start", "--display", place / "small.toml", "--ready", ready, "--background")
    assert process(*start, "--capture", folder)[0] == 0
    wait_until((folder / "frame-00000001.png").is_file)  # a ready board may not have scanned one out
    assert lippmann("board", "stop", "--ready", ready)[0] == 0
    assert mine.read_text() == "precious"


def test_a_board_nobody_can_be_told_of_ends(place, tmp_path):
    """Its place is printed on a full disk."""
    ready = tmp_path / "board.json"
    start = [sys.executable, "-m", "lippmann", "board", "start", "--display", str(place / "small.toml"), "--background"]
    with open("/dev/full", "w") as full:
        done = subprocess.run([*start, "--ready", ready], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 3, done.stderr
    assert "no space left" in done.stderr.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


def test_a_log_on_a_full_disk_is_told(place, tmp_path):
    with full_disk(tmp_path / "full") as full:
        (full / "rest").write_bytes(bytes(64 << 10))
        start = ("board", "start", "--display", place / "small.toml", "--ready", full / "board.json", "--background")
        assert "board.json.log: cannot be written (no space left" in refused(*start, code=3)
        assert [path.name for path in full.iterdir()] == ["rest"]


def test_waveforms_do_not_follow_a_planted_link(place, tmp_path):
    mine, trace = tmp_path / "mine", tmp_path / "waves.fst"
    mine.write_text("precious")
    trace.symlink_to(mine)
    with pytest.raises(DeviceError):  # a program that ends at once
        virtual_board.start(load_display(place / "small.toml"), trace=trace, program=Path("/bin/false"))
    assert mine.read_text() == "precious"
    assert not trace.is_symlink()


def test_the_loss_of_the_terminal_ends_a_board_and_its_simulator(place, tmp_path):
    ready = tmp_path / "board.json"
    words = [sys.executable, "-m", "lippmann", "board", "start", "--display", place / "small.toml", "--ready", ready]
    board = subprocess.Popen(words, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_until(ready.exists)
    url = json.loads(ready.read_text())["url"]
    os.killpg(board.pid, signal.SIGHUP)
    _, err = board.communicate(timeout=60)
    assert board.returncode == 0, err
    assert not Path(url.removeprefix("unix://")).exists()
    assert list(tmp_path.iterdir()) == []


def test_the_frames_of_the_next_board_come_after_those_of_the_last(place, tmp_path):
    """Half a frame is removed once it is old; a frame of another panel is left alone."""
    display = load_display(place / "small.toml")
    old, new = tmp_path / "frame-00000007.rgb.part", tmp_path / "frame-00000008.rgb.part"
    for path in (old, new):
        path.write_bytes(b"half")
    other = tmp_path / "frame-00000002.rgb"
    other.write_bytes(bytes(3 * WIDTH * HEIGHT + 3))
    os.utime(old, (0, 0))
    virtual_board.remove_parts(tmp_path)
    for name, after in (("frame-00000001.png", 0), ("frame-00000002.png", 1)):
        assert virtual_board.last_frame(tmp_path) == after
        (tmp_path / "frame-00000001.rgb").write_bytes(bytes(3 * WIDTH * HEIGHT))
        assert virtual_board.keep_as_png(tmp_path, display, after) == [tmp_path / name]
    assert new.exists()
    assert other.exists()
    assert not old.exists()


def test_a_start_that_is_ended_takes_the_board_with_it(place, tmp_path):
    """A panel that no board was compiled for: while it waits for the compiler."""
    (tmp_path / "odd.toml").write_text((place / "small.toml").read_text().replace(f"= {WIDTH}", f"= {WIDTH + 1}"))
    ready = tmp_path / "board.json"
    words = ("board", "start", "--display", tmp_path / "odd.toml", "--ready", ready, "--background")
    with subprocess.Popen([sys.executable, "-m", "lippmann", *map(str, words)], stderr=subprocess.PIPE) as start:
        wait_until(lambda: children(start.pid))
        (board,) = children(start.pid)
        wait_until(lambda: any(children(child) for child in children(board)) or children(board))
        workers = children(board)
        start.send_signal(signal.SIGTERM)
        assert start.wait(60) == 143
    wait_until(lambda: not any(map(alive, [board, *workers])))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["odd.toml"]

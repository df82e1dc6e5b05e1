"""`lippmann board` and `lippmann stream` as a person uses them: one board in the background, and bad input."""

import json
import socket
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from lippmann.display import load_display
from lippmann.images import encode, read_picture, write_picture

ROOT = Path(__file__).parents[2]
WIDTH, HEIGHT = 112, 80  # as the board of test_virtual_board, compiled once


def lippmann(*words):
    """Run the command: exit code, stdout, stderr."""
    done = subprocess.run(
        [sys.executable, "-m", "lippmann", *map(str, words)], capture_output=True, text=True, check=False, timeout=300
    )
    return done.returncode, done.stdout, done.stderr


def asked(*words):
    """Run what must succeed; what it says in JSON."""
    code, out, err = lippmann(*words, "--json")
    assert code == 0, err
    return json.loads(out)


def refused(*words, code=2):
    """Run what must be refused, in one line; that line."""
    found, out, err = lippmann(*words)
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
    told = asked(*start, "--capture", place / "screen")
    assert told == json.loads(ready.read_text())
    try:
        assert "runs" in refused(*start)
        yield told["url"]
    finally:
        assert asked("board", "stop", "--ready", ready)["pid"] == told["pid"]
    assert not ready.exists()
    assert "no board" in refused("board", "stop", "--ready", ready)


def values(path):
    """The panel's values of a linear image: sRGB, 8 bits."""
    return np.rint(encode(read_picture(path).radiance, "srgb") * 255).astype(np.uint8)


def test_a_frame_is_streamed_verified_and_captured(place, port):
    for name in ("own.exr", "second.exr"):
        wanted = values(place / name)
        frame = asked("stream", place / name, "--port", port, "--verify")["frames"][0]
        assert frame["crc"] == f"{zlib.crc32(wanted.tobytes()):08x}"
        assert frame["verified"]
        assert (frame["tiles"], frame["unchanged"]) == (12, False)
    info = asked("board", "info", "--port", port)
    assert info["panel"] == {"width": WIDTH, "height": HEIGHT}
    assert info["shown_crc"] == frame["crc"]
    again = asked("stream", place / "second.exr", "--port", port)["frames"][0]
    assert (again["unchanged"], again["sends"]) == (True, 0)
    last = max((place / "screen").glob("frame-*.png"))
    shown = np.rint(encode(read_picture(last).radiance, "srgb") * 255).astype(np.uint8)
    np.testing.assert_array_equal(shown, wanted)


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
    assert "no window" in refused(*check, "--region", "100,70,13,10")
    assert "not whole" in refused(*check, "--region", "0,0,1.5,1")
    assert "LEFT,TOP,WIDTH,HEIGHT" in refused(*check, "--region", "0,0,1")
    other = ROOT / "scenes/displays/vga-square.toml"
    assert "the board drives display" in refused("board", "check", "--display", other, "--port", port)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("read", "nothing"), "nothing: no such register"),
        (("write", "nothing", 1), "nothing: no such register"),
        (("write", "clock", 1), "clock: can only be read"),
        (("write", "display", 1 << 11), "2048: display has no field in some of these bits"),
        (("write", "display", "brightness=256"), "brightness=256: is out of range; give 0 to 255"),
        (("write", "display", "brightness=x"), "brightness=x: is no whole number"),
        (("write", "display", "colour=1"), "display has no field colour"),
        (("write", "display", "brightness=1", "brightness=2"), "a field is there twice"),
        (("write", "display", "brightness=1", 2), "give words, or FIELD=VALUE"),
        (("write", "0x18", -1), "-1: is out of range"),
        (("setup", "--display", ROOT / "scenes/displays/vga-square.toml"), "--force"),
    ],
)
def test_bad_registers_and_values_are_refused(port, words, message):
    before = asked("board", "read", "display", "--port", port)["words"]
    assert (
        message in refused("board", words[0], "--port", port, "--", *words[1:])
        if words[0] != "setup"
        else (message in refused("board", *words, "--port", port))
    )
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


def test_an_image_of_another_display_is_shown_when_forced(place, port):
    wanted = values(place / "other.exr")
    frame = asked("stream", place / "other.exr", "--port", port, "--force", "--verify")["frames"][0]
    assert frame["crc"] == f"{zlib.crc32(wanted.tobytes()):08x}"


def test_no_board_is_a_device_error(place, tmp_path):
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        url = f"socket://127.0.0.1:{nobody.getsockname()[1]}"
        assert "nobody listens" in refused("stream", place / "own.exr", "--port", url, code=1)
    assert "no such port" in refused("board", "info", "--port", tmp_path / "ttyNONE", code=1)
    assert "pty" in refused(
        "board", "start", "--display", place / "small.toml", "--line", "pty", "--tcp-port", 4000
    )  # fmt: skip

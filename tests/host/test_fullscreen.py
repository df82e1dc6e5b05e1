"""An image on the host's own panel, on SDL's dummy desktop: one pixel is one pixel, or nothing is shown."""

import json
import os
import re

import numpy as np
import pytest
from lippmann.base.fullscreen import full_screen, monitors
from lippmann.base.images import write_picture
from lippmann.cli import run
from lippmann.errors import DeviceError, InputError
from scene_cases import small_toml


@pytest.fixture(autouse=True)
def dummy(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


def noise(width, height):
    return np.random.default_rng(5).integers(0, 256, (height, width, 3)).astype(np.uint8)


def show(image, monitor, seconds):
    with full_screen(image.shape[1::-1], monitor) as put:
        return put(image, seconds)


def test_every_pixel_is_shown_as_it_is():
    width, height = monitors()[0]
    image = noise(width, height)
    np.testing.assert_array_equal(show(image, 0, 0.01), image)


def test_nothing_is_scaled():
    width, height = monitors()[0]
    with pytest.raises(InputError, match="resolution"):
        show(noise(width, height - 1), 0, 0.01)
    with pytest.raises(InputError, match="monitor 7 does not exist; choose from 0: "):
        show(noise(width, height), 7, 0.01)


def test_a_driver_that_shows_nothing_is_refused(no_desktop, monkeypatch, capfd):
    """Without a desktop SDL takes one of its blind drivers by itself; libraries print no line of their own."""
    width, height = 1024, 768
    for call in (monitors, lambda: show(noise(width, height), 0, 0.0)):
        with pytest.raises(DeviceError, match=r"no desktop.*graphical session"):
            call()
    assert capfd.readouterr() == ("", "")
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")
    with pytest.raises(DeviceError, match="graphical session"):
        monitors()


@pytest.mark.parametrize("named", ["dummy", "offscreen", "nonsense,offscreen"])
def test_a_driver_that_is_named_is_taken(monkeypatch, named):
    monkeypatch.setenv("SDL_VIDEODRIVER", named)
    assert monitors()


def test_the_command(tmp_path, capsys):
    width, height = monitors()[0]
    toml = tmp_path / "d.toml"
    toml.write_text(small_toml(width, height, 'dpi = 600\ntransfer = "linear"'))
    path = tmp_path / "i.png"
    write_picture(path, noise(width, height) / 255.0, {}, "linear")
    words = ["display", str(path), "--display", str(toml), "--seconds", "0", "--json"]
    assert run(words) == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert "names no display, but the panel belongs to display" in error
    assert "or accept it with --force" in error
    assert not re.search("board|stream", error)
    assert run([*words, "--force"]) == 0
    assert json.loads(capsys.readouterr().out)["width"] == width
    assert run(["display", str(path)]) == 2
    capsys.readouterr()
    toml.write_text(toml.read_text().replace('"linear"', '"srgb"'))
    assert run([*words, "--force"]) == 2
    assert "transfer is linear in the file, srgb in --display" in json.loads(capsys.readouterr().out)["error"]
    assert os.environ["SDL_VIDEODRIVER"] == "dummy"

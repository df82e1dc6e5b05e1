"""Images for the board: panel values by hand, and refusals before a pixel is read."""

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from lippmann.base.images import write_picture
from lippmann.board.panel_frames import Target, image_frame, load_frame
from lippmann.board.session import Hello
from lippmann.display.description import Panel
from lippmann.errors import InputError
from lippmann.rendering.integral_image import IntegralImage
from optics_cases import display_of
from PIL import Image
from scene_cases import generator

SEED = 4506
IDENTITY = 0x79EE8471D40B2533
HELLO = Hello(1, IDENTITY, 60, 40, 32, 3200, 50_000_000, 0, 0)
META = {"identity": f"{IDENTITY:016x}", "display": "paper-square"}


def panel_of(transfer, bits):
    return Panel(60, 40, 0.1, bits=bits, transfer=transfer)


def picture():
    return generator(SEED).random((40, 60, 3), np.float32)


def srgb_levels(light):
    light = np.clip(light.astype(np.float64), 0.0, 1.0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055) * 255


def test_png_values_pass_as_they_are(tmp_path):
    values = np.arange(40 * 60 * 3, dtype=np.int64).reshape(40, 60, 3).astype(np.uint8)
    path = tmp_path / "x.png"
    Image.fromarray(values).save(path)
    np.testing.assert_array_equal(load_frame(path, HELLO, force=True), values)
    # Another curve changes the values, and black and white stay.
    linear = load_frame(path, HELLO, transfer="linear", force=True)
    assert (linear == values).mean() < 0.05
    np.testing.assert_array_equal(linear[values == 255], 255)
    np.testing.assert_array_equal(linear[values == 0], 0)


@pytest.mark.parametrize(("bits", "levels"), [(1, 2), (4, 16), (6, 64), (8, 256), (10, 256)])
def test_panels_of_other_depths(tmp_path, bits, levels):
    # As half floats hold it, so that EXR and PNG are made of the same.
    ramp = np.broadcast_to(np.linspace(0.0, 1.0, 60, dtype=np.float16)[None, :, None], (40, 60, 3)).astype(np.float32)
    path = tmp_path / "ramp.exr"
    write_picture(path, ramp, META)
    frame = load_frame(path, HELLO, None, panel_of("linear", bits))
    steps = np.rint(np.rint(ramp.astype(np.float64) * (levels - 1)) * 255 / (levels - 1))
    np.testing.assert_array_equal(frame, steps)
    # A PNG of that panel comes to the same; one of 10 bits is rounded twice.
    write_picture(tmp_path / "ramp.png", ramp, META, "linear", bits)
    if bits > 8:
        steps = np.rint(np.rint(ramp.astype(np.float64) * 1023) * 255 / 1023)
    np.testing.assert_array_equal(load_frame(tmp_path / "ramp.png", HELLO, None, panel_of("linear", bits)), steps)


@pytest.mark.parametrize("suffix", [".exr", ".png"])
@pytest.mark.parametrize(("key", "own", "other"), [("transfer", "linear", "srgb"), ("bits", "6", "8")])
def test_tones_other_than_the_files_are_refused(tmp_path, suffix, key, own, other):
    """A file that names its panel's tones: the options may confirm them, and nothing else."""
    path = tmp_path / f"x{suffix}"
    tones = {"transfer": "linear", "bits": "6"}
    write_picture(path, picture(), META | tones, "linear", 6)
    np.testing.assert_array_equal(load_frame(path, HELLO), load_frame(path, HELLO, "linear", panel_of("linear", 6)))
    wrong = tones | {key: other}
    with pytest.raises(InputError, match=f"^[^\n]*{key} is {own} in the file, {other} in --display[^\n]*$"):
        load_frame(path, HELLO, None, panel_of(wrong["transfer"], int(wrong["bits"])), force=True)
    if key == "transfer":
        with pytest.raises(InputError, match="transfer is linear in the file, srgb in --transfer"):
            load_frame(path, HELLO, "srgb")


def test_what_a_file_does_not_name_is_supplied_or_logged(tmp_path, caplog):
    """EXR of version 0.1 names no panel, PNG its curve; a display supplies the rest."""
    caplog.set_level("INFO", "lippmann")

    def logged():
        texts = [record.getMessage().partition(": ")[2] for record in caplog.records]
        caplog.clear()
        return texts

    light = picture().astype(np.float16).astype(np.float32)
    light[np.abs(srgb_levels(light) % 1 - 0.5) < 1e-3] = 0
    write_picture(tmp_path / "old.exr", light, META)
    write_picture(tmp_path / "old.png", light, META, "linear")
    np.testing.assert_array_equal(load_frame(tmp_path / "old.exr", HELLO), np.rint(srgb_levels(light)))
    assert logged() == ["srgb and 8 bits are assumed; name the panel with --display FILE"]
    linear = load_frame(tmp_path / "old.exr", HELLO, None, panel_of("linear", 6))
    np.testing.assert_array_equal(linear, np.rint(np.rint(light * 63) * 255 / 63))
    assert logged() == []
    # No board tells its panel's tones.
    unconfirmed = "made for linear and 8 bits; check the board's panel with --display FILE"
    for panel, texts in ((None, [unconfirmed]), (panel_of("linear", 8), [])):
        frame = load_frame(tmp_path / "old.png", HELLO, None, panel)
        np.testing.assert_array_equal(frame, np.rint(light * 255))
        assert logged() == texts
    with pytest.raises(InputError, match="--transfer, linear in --display"):
        load_frame(tmp_path / "old.exr", HELLO, "srgb", panel_of("linear", 6))


@pytest.mark.parametrize("bits", ["0", "17", "six", "999999"])
def test_bits_that_no_panel_has_are_refused(tmp_path, bits):
    write_picture(tmp_path / "x.exr", picture(), META | {"bits": bits})
    with pytest.raises(InputError, match="number of bits"):
        load_frame(tmp_path / "x.exr", HELLO)


def test_the_frame_of_an_image_is_what_its_display_asks_for():
    display = display_of("square", "panel", width_px=60, height_px=40)
    display = replace(display, panel=replace(display.panel, transfer="linear", bits=6))
    target = Target(int(display.identity, 16), 60, 40)
    light = picture()
    image = IntegralImage(light, display)
    np.testing.assert_array_equal(image_frame(image, target), np.rint(np.rint(light * 63) * 255 / 63))
    with pytest.raises(InputError, match="panel belongs to display"):
        image_frame(image, HELLO)
    assert image_frame(image, HELLO, force=True).shape == (40, 60, 3)
    image.metadata["transfer"] = "srgb"
    with pytest.raises(InputError, match="transfer is srgb in its metadata, linear in its display"):
        image_frame(image, target)
    with pytest.raises(InputError, match=r"its shape is \(40, 60, 3\), the panel's is \(39, 60, 3\)"):
        image_frame(IntegralImage(light, display), target._replace(height=39))


def test_images_of_other_displays_are_refused_unless_forced(tmp_path):
    path = tmp_path / "other.exr"
    for metadata, message in (
        ({"identity": "0123456789abcdef"}, r"0123456789abcdef, but the panel .* 79ee8471d40b2533.*--force"),
        ({}, r"names no display.*--force"),
    ):
        write_picture(path, picture(), metadata)
        with pytest.raises(InputError, match=message):
            load_frame(path, HELLO)
        assert load_frame(path, HELLO, force=True).shape == (40, 60, 3)


def test_a_header_that_promises_too_much_is_refused(tmp_path):
    path = tmp_path / "x.exr"
    spec = oiio.ImageSpec(60, 40, 900, oiio.HALF)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    assert out.write_image(np.zeros((40, 60, 900), np.float16))
    out.close()
    with pytest.raises(InputError, match="flat image of 1 to 4 channels"):
        load_frame(path, HELLO, force=True)


@pytest.mark.parametrize("name", ["missing.png", "x.gif", "x", "x.png/", "x.null", "x.exr?RES=60x40"])
def test_paths_that_are_no_image(tmp_path, name):
    with pytest.raises(InputError, match=r"; \w"):
        load_frame(str(tmp_path / name), HELLO)

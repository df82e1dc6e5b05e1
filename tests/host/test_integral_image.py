"""The integral image: what its files carry, what loading refuses, and how it is shown."""

import dataclasses
import io
import re
import subprocess
import sys

import lippmann
import numpy as np
import OpenImageIO as oiio
import pytest
from lippmann.base.images import read_picture, write_picture
from lippmann.base.tones import encoded_values
from lippmann.display.description import display_text
from lippmann.errors import InputError, LippmannWarning
from lippmann.eye.observer import View
from lippmann.rendering.integral_image import IntegralImage, metadata_of
from lippmann.rendering.memory_estimate import BASE_MEMORY_MB
from optics_cases import display_of
from PIL import Image
from scene_cases import focused_display, generator

TONES = [("srgb", 8), ("linear", 8), ("gamma2.2", 6), ("srgb", 1), ("linear", 10), ("srgb", 16)]


def display_with(transfer="srgb", bits=8, **others):
    made = display_of("square", "panel", radius=1.65, width_px=17, height_px=13, **others)
    return dataclasses.replace(made, panel=dataclasses.replace(made.panel, transfer=transfer, bits=bits))


def image_for(display, *key):
    return IntegralImage(generator(77, *key).random((13, 17, 3), np.float32), display, {"model": "exact"})


@pytest.mark.parametrize(("transfer", "bits"), TONES)
@pytest.mark.parametrize("suffix", [".exr", ".tif", ".png"])
def test_saved_and_loaded(tmp_path, suffix, transfer, bits):
    display = display_with(transfer, bits)
    image, path = image_for(display, suffix, bits), tmp_path / f"a{suffix}"
    carried = {"display": display.name, "identity": display.identity, "transfer": transfer, "bits": str(bits)}
    image.save(path)
    back = IntegralImage.load(path, display)
    assert back.display is display
    assert back.metadata == image.metadata == {"model": "exact", **carried}
    stored = {
        ".exr": lambda light: light.astype(np.float16),
        ".tif": lambda light: light,
        ".png": lambda light: encoded_values(light, transfer, bits),  # what a panel shows of them
    }[suffix]
    np.testing.assert_array_equal(stored(back.radiance), stored(image.radiance))


@pytest.mark.parametrize("suffix", [".exr", ".png"])
def test_another_display_is_refused(tmp_path, suffix):
    """A forced image keeps the identity of its file: saved again, it is not another display's."""
    display = display_with()
    other = dataclasses.replace(display, gap_mm=display.gap_mm + 0.1)
    path, again = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    image_for(display).save(path)
    with pytest.raises(InputError, match=rf"a\{suffix}.*{display.identity}.*{other.identity}.*--force"):
        IntegralImage.load(path, other)
    for stored in (False, True):
        forced = IntegralImage.load(path, other, force=True, stored=stored)
        assert forced.metadata["identity"] == display.identity
        forced.save(again)
        assert IntegralImage.load(again, display).metadata["identity"] == display.identity
    write_picture(path, image_for(display).radiance, {})
    with pytest.raises(InputError, match=r"names no display.*--force"):
        IntegralImage.load(path, display)
    IntegralImage.load(path, display, force=True)


@pytest.mark.parametrize(
    ("tones", "said"), [(("linear", 8), "transfer srgb, .* has transfer linear"), (("srgb", 6), "bits 8, .* bits 6")]
)
def test_panel_values_of_other_tones_are_refused(tmp_path, tones, said):
    """Transfer curve and bits are not a part of the identity; linear radiance fits all of them."""
    display, other = display_with(), display_with(*tones)
    assert display.identity == other.identity
    for suffix in (".png", ".exr", ".tif"):
        path = tmp_path / f"a{suffix}"
        image_for(display).save(path)
        if suffix == ".png":
            with pytest.raises(InputError, match=said):
                IntegralImage.load(path, other)
        back = IntegralImage.load(path, other, force=suffix == ".png")
        assert (back.metadata["transfer"], back.metadata["bits"]) == (tones[0], str(tones[1]))


def write_foreign(path, pixels, entries):
    """Write an image file with other entries than this version's."""
    spec = oiio.ImageSpec(17, 13, 3, oiio.UINT8 if path.suffix == ".png" else oiio.FLOAT)
    if path.suffix == ".tif":
        spec.attribute("ImageDescription", "\n".join(f"lippmann:{k}={v}" for k, v in entries.items()))
    else:
        for key, value in entries.items():
            spec.attribute(f"lippmann:{key}", value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    assert out.write_image(pixels)
    out.close()


def test_files_of_version_0_1_load(tmp_path):
    """They carry no bits; `transfer` is the file's: linear in .exr and .tif, the panel's in .png."""
    display = display_with("gamma2.2", 6)
    light = image_for(display).radiance
    carried = {"display": display.name, "identity": display.identity, "version": "0.1.0"}
    for suffix, transfer in ((".exr", "linear"), (".tif", "linear"), (".png", "gamma2.2")):
        path = tmp_path / f"a{suffix}"
        pixels = encoded_values(light, "gamma2.2", 6) if suffix == ".png" else light
        write_foreign(path, pixels, {**carried, "transfer": transfer})
        back = IntegralImage.load(path, display)
        assert back.metadata == {**carried, "transfer": "gamma2.2", "bits": "6"}
        if suffix == ".png":
            np.testing.assert_array_equal(encoded_values(back.radiance, "gamma2.2", 6), pixels)
            with pytest.raises(InputError, match=r"transfer gamma2\.2, .* has transfer srgb"):
                IntegralImage.load(path, display_with("srgb", 6))
        else:
            np.testing.assert_array_equal(back.radiance, light)


def test_an_unknown_curve_in_a_file_names_the_file(tmp_path):
    """EXR holds linear light: its curve is only the panel's, and the display's own takes its place."""
    display, pixels = display_with(), np.zeros((13, 17, 3), np.uint8)
    for suffix in (".exr", ".png"):
        write_foreign(tmp_path / f"a{suffix}", pixels, {"transfer": "gamma2.6"})
    assert IntegralImage.load(tmp_path / "a.exr", display, force=True).metadata["transfer"] == "srgb"
    with pytest.raises(InputError, match=r"a\.png: unknown transfer 'gamma2\.6'; choose from srgb"):
        IntegralImage.load(tmp_path / "a.png", display, force=True)


@pytest.mark.parametrize(
    ("radiance", "message"),
    [
        *((np.zeros(shape), "the panel 13 x 17 x 3; render it for this display")
          for shape in ((13, 17), (17, 13, 3), (13, 17, 4), (0, 0, 3))),
        *((np.ones((13, 17, 3), kind), f"the radiance is {np.dtype(kind)}, not linear light, where 1 is white")
          for kind in (np.uint8, np.uint16, np.int64, bool)),
        ([[0.0]], "the radiance is 1 x 1, the panel 13 x 17 x 3"),
        ([[1]], "not linear light"),
    ],
)  # fmt: skip
def test_what_is_no_radiance_is_refused(radiance, message):
    """128 of 255 was taken for 128 times white; a list was an AttributeError."""
    with pytest.raises(InputError, match=message):
        IntegralImage(radiance, display_with())
    with pytest.raises(InputError, match=r"display must be a lippmann\.Display, not 'desk\.toml'"):
        IntegralImage(np.zeros((13, 17, 3)), "desk.toml")


@pytest.mark.parametrize("suffix", [".exr", ".tif", ".png"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_saved_can_be_loaded(tmp_path, suffix, value):
    """NaN is refused; EXR and PNG hold infinite light as their largest value, TIFF has none."""
    path, display = tmp_path / f"a{suffix}", display_with()
    radiance = image_for(display).radiance
    radiance[12, 16, 1] = value
    with pytest.raises(InputError, match=r"NaN or infinity \(count: 1, the first in row 12, column 16\); replace NaN"):
        IntegralImage(radiance, display)
    metadata = metadata_of(display)
    if suffix == ".tif" or np.isnan(value):
        with pytest.raises(InputError, match=rf"a\{suffix}: the image has pixels that are not finite; replace them"):
            write_picture(path, radiance, metadata)
        assert list(tmp_path.iterdir()) == []
        return
    write_picture(path, radiance, metadata)
    largest = {".exr": 65504.0, ".png": 1.0}[suffix]
    least = -largest if suffix == ".exr" else 0.0
    assert IntegralImage.load(path, display).radiance[12, 16, 1] == (largest if value > 0 else least)


@pytest.mark.parametrize(
    ("key", "value"),
    [("", "v"), ("a=b", "v"), ("a\nb", "v"), ("a\0", "v"), ("a ", "v"), ("k" * 71, "v"), ("a\ud800", "v"),
     ("k", ""), ("k", "a\0b"), ("k", "\udc80"), ("k", "v" * 70_000)],
)  # fmt: skip
def test_metadata_that_a_file_would_lose_is_refused(tmp_path, key, value):
    with pytest.raises(InputError, match=rf"^metadata {re.escape(repr(key[:40]))}: files cannot store .*; (use|give)"):
        IntegralImage(image_for(display_with()).radiance, display_with(), {key: value})
    metadata = {"k" * 70: "first\nsecond", "\u03b1 \xe9:1": "=", "long": "v" * 59_000}
    for suffix in (".exr", ".tif", ".png"):
        write_picture(tmp_path / f"a{suffix}", np.zeros((1, 1, 3)), metadata)
        assert metadata.items() <= read_picture(tmp_path / f"a{suffix}").metadata.items()
        with pytest.raises(InputError, match="metadata"):
            write_picture(tmp_path / f"b{suffix}", np.zeros((1, 1, 3)), {key: value})


def test_values_below_0_are_warned_of_once(tmp_path):
    display = display_with()
    radiance = image_for(display).radiance
    radiance[11, 16, 1] = -3.0
    radiance[12, :2] = -1.0
    said = re.escape("values below 0 (count: 7, the first in row 11, column 16), which a display shows as black")
    write_picture(tmp_path / "a.exr", radiance, metadata_of(display))
    with pytest.warns(LippmannWarning, match=f"image for display .*: {said}"):
        IntegralImage.load(tmp_path / "a.exr", display)
    stored = IntegralImage.load(tmp_path / "a.exr", display, stored=True).radiance
    with pytest.warns(LippmannWarning, match=rf"a\.exr: {said}") as caught:
        [stored[:5], stored[5:], stored[12]]
    assert len(caught) == 1


def test_a_file_of_another_size_is_refused(tmp_path):
    write_picture(tmp_path / "a.exr", np.zeros((13, 18, 3)), {})
    with pytest.raises(InputError, match="is 18 x 13 pixels, but the panel is 17 x 13"):
        IntegralImage.load(tmp_path / "a.exr", display_with())


def test_a_view_is_saved_with_its_metadata_and_printed_without_pixels(tmp_path):
    image = image_for(display_with())
    assert str(image) == f"<IntegralImage, 17 x 13 px, {image.metadata}>"
    view = View(generator(3).random((4, 5, 3), np.float32), {"ok": 1.0}, {"eye_mm": "(0.0, 0.0, 600.0)"})
    assert repr(view) == "<View, 5 x 4 px, {'eye_mm': '(0.0, 0.0, 600.0)'}>"
    view.save(tmp_path / "v.tif")
    back = read_picture(tmp_path / "v.tif")
    np.testing.assert_array_equal(back.radiance, view.radiance)
    assert back.metadata == view.metadata


def test_a_notebook_gets_srgb():
    """Whatever the panel's curve: a notebook is seen on an ordinary screen."""
    image = image_for(display_with("linear", 6))
    values = np.asarray(Image.open(io.BytesIO(image._repr_png_())))
    np.testing.assert_array_equal(values, encoded_values(image.radiance, "srgb", 8))


def test_a_window_closes_after_its_seconds(monkeypatch, capfd):
    """Also in a program that loads ipykernel, as jupyter_client does: that is no notebook."""
    import ipykernel
    import IPython

    assert {IPython.__name__, ipykernel.__name__} <= set(sys.modules)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    large = dataclasses.replace(display_with(), panel=dataclasses.replace(display_with().panel, width_px=5000))
    images = image_for(display_with()), IntegralImage(np.zeros((13, 5000, 3), np.float32), large)
    capfd.readouterr()
    for image in images:
        image.show(seconds=0.01)
    assert capfd.readouterr() == ("", "")


def test_without_a_desktop_a_line_says_so(no_desktop, capfd):
    image = image_for(display_with())
    capfd.readouterr()
    image.show()
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("lippmann: not shown: there is no desktop")
    assert len(err.splitlines()) == 1


#: Saves images of two sizes and prints the peak memory after each, MB.
PEAKS = """
import dataclasses, sys
import numpy as np
from lippmann.display.description import load_display
from lippmann.rendering.integral_image import IntegralImage, metadata_of
from lippmann.base.machine import peak_memory_mb
display = load_display(sys.argv[1])
for width, height in SIZES:
    panel = dataclasses.replace(display.panel, width_px=width, height_px=height)
    light = np.full((height, width, 3), 0.5, np.float32)
    IntegralImage(light, dataclasses.replace(display, panel=panel), {}).save(sys.argv[2])
    print(peak_memory_mb())
"""


@pytest.mark.parametrize("largest", [(3840, 2160), pytest.param((15360, 8640), marks=pytest.mark.full)], ids=str)
@pytest.mark.parametrize("suffix", [".png", ".exr", ".tif"])
def test_files_are_written_within_the_memory_that_is_asked_for(tmp_path, suffix, largest):
    """`check_memory` allows three pictures in float32, 36 bytes a pixel, above the base: one is the image itself.

    A larger image takes no copy of itself, of 12 bytes a pixel.
    """
    (tmp_path / "it.toml").write_text(display_text(display_with()))
    sizes = (1280, 720), largest
    command = [sys.executable, "-c", PEAKS.replace("SIZES", repr(sizes)), "it.toml", f"a{suffix}"]
    said = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    peaks, pixels = np.array(said.split(), float), np.array([width * height for width, height in sizes])
    assert (peaks <= BASE_MEMORY_MB + 36e-6 * pixels).all()
    assert (np.diff(peaks) <= 18e-6 * np.diff(pixels)).all()
    assert peaks[-1] >= 12e-6 * pixels[-1]


@pytest.mark.parametrize("kind", [np.float16, np.float64, list])
def test_other_floats_and_lists_become_float32(kind):
    light = np.linspace(0.0, 1.0, 663).reshape(13, 17, 3)
    image = IntegralImage(light.tolist() if kind is list else light.astype(kind), display_with())
    assert image.radiance.dtype == np.float32
    np.testing.assert_allclose(image.radiance, light, atol=1e-3)


def test_metadata_are_texts(mi):
    display = focused_display("square", width_px=40, height_px=30)
    given = {"gain": np.float64(1.5), "transfer": "mine"}
    image = IntegralImage(np.zeros((30, 40, 3), np.float32), display, given)
    assert (image.metadata["gain"], image.metadata["transfer"]) == ("1.5", "srgb")
    assert given == {"gain": 1.5, "transfer": "mine"}, "the caller's stays"
    view = lippmann.observe(image, tuple(np.array([0.0, 1.5, 600.0])), width_px=8, samples=1)
    assert view.metadata["eye_mm"] == "(0.0, 1.5, 600.0)"

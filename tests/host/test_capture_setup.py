"""The set-up file: what it means, what it refuses, and how it says so."""

import math
import re
from pathlib import Path

import pytest
from lippmann.capturing.capture_setup import Camera, Pickup, load_setup
from lippmann.capturing.imaging_lens import LensPair, ThinLens
from lippmann.display.description import load_display
from lippmann.errors import InputError
from scene_cases import small_toml

TOP = Path(__file__).parents[2]
SETUPS = TOP / "scenes/setups"

DISPLAY = "[display]\n" + small_toml(120, 80, gap_mm=4.8).replace("[", "[display.")
OBJECT = "[object]\ndistance_mm = 1000\n"
THIN = '[lens]\nkind = "thin"\nimage_distance_mm = 415\naperture_mm = 300\n'
PAIR = """[lens]
kind = "pair"
image_distance_mm = 415
glass = "N-BK7"
thickness_mm = 60
separation_mm = 1
aperture_mm = 320
"""
ARRAY = "[array]\nposition_mm = -60\n"
CAMERA = "[camera]\ndistance_mm = 1450\n"


def load(tmp_path, *parts):
    path = tmp_path / "s.toml"
    path.write_text("\n".join(parts))
    return load_setup(path)


@pytest.mark.parametrize("lens", [THIN, PAIR], ids=["thin", "pair"])
def test_the_paper_s_numbers(tmp_path, lens):
    """100 cm to 41.5 cm: f = 1000 * 415 / 1415, m = -0.415; the array 6 cm before the image, the camera at 145 cm."""
    setup = load(tmp_path, DISPLAY, OBJECT, lens, ARRAY, CAMERA)
    assert setup.lens.focal_length_mm == pytest.approx(293.2862190812721, rel=1e-12)
    assert setup.image_distance_mm == pytest.approx(415.0, rel=1e-12)
    assert setup.magnification == pytest.approx(-0.415, rel=1e-12)
    assert setup.array_distance_mm == pytest.approx(355.0, rel=1e-12)
    # Thinnest lenslet: R = 1.65, T = R - sqrt(R^2 - 1/2); its principal plane T - T/n before the vertices.
    thickness = 1.65 - math.sqrt(1.65**2 - 0.5)
    assert setup.camera_distance_mm == pytest.approx(1450 - 355 - thickness / 3, rel=1e-12)
    assert setup.pickup == Camera(1450.0)
    assert setup.name == "s"


@pytest.mark.parametrize(
    ("name", "array", "real"), [("fig8a", -60, True), ("fig8b", -40, True), ("fig8c", -20, True), ("fig8d", 10, False)]
)
def test_figure_8(name, array, real):
    setup = load_setup(SETUPS / f"{name}.toml")
    assert setup.position_mm == array
    assert setup.image_distance_mm == pytest.approx(415.0)
    assert setup.magnification == pytest.approx(-0.415)
    assert isinstance(setup.lens, LensPair)
    assert setup.display == load_display(TOP / f"scenes/displays/paper-square{'-real' if real else ''}.toml")
    assert setup.display.gap_mm == (4.8 if real else 3.3)
    assert setup.array == setup.display.array
    assert not setup.concave
    assert (setup.display.panel.width_px, setup.display.panel.height_px) == (2400, 2400)


def test_the_other_set_ups():
    hexagonal, thin, pickup, concave, plain = (
        load_setup(SETUPS / f"{name}.toml") for name in ("hex", "thin", "pickup", "concave", "plain")
    )
    assert (hexagonal.array.grid, hexagonal.array.pitch_mm) == ("hex", 2.3)
    assert isinstance(thin.lens, ThinLens)
    assert pickup.pickup == Pickup(4.8)
    assert pickup.camera_distance_mm is None
    assert concave.concave
    assert concave.array.radius_mm == pytest.approx(1.65)
    assert plain.lens is None
    assert (plain.array_distance_mm, plain.image_distance_mm, plain.magnification) == (0.0, -120.0, 1.0)


def test_resized():
    setup = load_setup(SETUPS / "fig8a.toml")
    small = setup.resized(600)
    assert (small.display.panel.width_px, small.display.panel.height_px) == (600, 600)
    assert small.display.panel.width_mm == pytest.approx(setup.display.panel.width_mm, rel=1e-15)
    assert small.display.array == setup.display.array
    # 102 lenslets across: 203 pixels are fewer than two each.
    with pytest.raises(InputError, match=re.escape("has 2.00 pixels for a lenslet, fewer than 2")):
        setup.resized(203)
    assert setup.resized(204)


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ((DISPLAY, THIN, ARRAY, CAMERA), "object: the key is missing"),
        ((DISPLAY, "[object]\ndistance_mm = -1", THIN, ARRAY, CAMERA),
         "object.distance_mm: -1 is not valid; give a finite number, from 1e-09 to 1e+12"),
        ((DISPLAY, OBJECT + "size = 2", THIN, ARRAY, CAMERA),
         "object.size: unknown key; known here: distance_mm, scale"),
        ((DISPLAY, "[object]\ndistance_mm = 200", PAIR.replace("image_distance_mm = 415", "focal_length_mm = 300"),
          ARRAY, CAMERA), "object.distance_mm: 200 mm is within the focal length 300 mm"),
        ((DISPLAY, "[object]\ndistance_mm = 300", THIN.replace("image_distance_mm = 415", "focal_length_mm = 300"),
          ARRAY, CAMERA), "object.distance_mm: 300 mm is within the focal length 300 mm"),
        ((DISPLAY, OBJECT, THIN.replace("thin", "fat"), ARRAY, CAMERA),
         'lens.kind: "fat" is not valid; choose from "pair", "thin"'),
        ((DISPLAY, OBJECT, THIN + "focal_length_mm = 3", ARRAY, CAMERA), "several are given; give exactly one"),
        ((DISPLAY, OBJECT, THIN + "index = 1.5", ARRAY, CAMERA),
         "lens.index: unknown key of a thin lens; leave it out"),
        ((DISPLAY, OBJECT, PAIR.replace("320", "620"), ARRAY, CAMERA), "lens.aperture_mm: 620 mm is wider than domes"),
        ((DISPLAY, OBJECT, PAIR.replace("60", "40"), ARRAY, CAMERA), "lens.thickness_mm: 40 mm is below the sag"),
        ((DISPLAY, OBJECT, PAIR.replace("N-BK7", "jelly"), ARRAY, CAMERA), "lens.glass: unknown glass 'jelly'"),
        ((DISPLAY, OBJECT, PAIR.replace("separation_mm = 1", "separation_mm = 500"), ARRAY, CAMERA),
         "lens.image_distance_mm: no pair of such thick lenses"),
        ((DISPLAY, OBJECT, THIN, CAMERA), "array.position_mm: the key is missing"),
        ((DISPLAY, OBJECT, THIN, "[array]\nposition_mm = -500", CAMERA), "array.position_mm: -500 mm puts the array"),
        # Behind the principal plane, yet inside the thick lens.
        ((DISPLAY, OBJECT, PAIR, "[array]\nposition_mm = -390", CAMERA), "outside the image space"),
        ((DISPLAY, OBJECT, THIN, "[array]\nposition_mm = 1040", CAMERA), "not before the camera: outside the image"),
        ((DISPLAY, OBJECT, THIN, ARRAY + "focal_length_mm = 0", CAMERA), "0 is no focal length"),
        ((DISPLAY, OBJECT, THIN, ARRAY + "focal_length_mm = -1", CAMERA),
         "array.focal_length_mm: radius 0.5 mm is too small to span its cell"),
        ((DISPLAY, OBJECT, THIN, ARRAY + "thickness_mm = 0.01", CAMERA), "array.thickness_mm: 0.01 mm is below"),
        ((DISPLAY + 'plano_side = "viewer"\n', OBJECT, THIN, ARRAY + "focal_length_mm = -3.3", CAMERA),
         "concave lenslets are traced with their plano side to the camera only"),
        ((DISPLAY, OBJECT, THIN, ARRAY), "camera or pickup: none is given"),
        ((DISPLAY, OBJECT, THIN, ARRAY, CAMERA, "[pickup]\ngap_mm = 3"), "camera or pickup: several are given"),
        ((DISPLAY.replace("pixel_pitch_mm = 0.1", "pixel_pitch_mm = 0.6"), OBJECT, THIN, ARRAY, CAMERA),
         "the picture has 1.67 pixels for a lenslet, fewer than 2"),
        ((DISPLAY.replace("[display.array]", 'subpixels = "rgb"\n[display.array]'), OBJECT, THIN, ARRAY, CAMERA),
         "has colour sub-pixels"),
        ((DISPLAY.replace("pitch_mm = 1.0", "pitch_mm = 9.0"), OBJECT, THIN, ARRAY, CAMERA),
         "display.array.radius_mm: radius 1.65 mm is too small"),
        (('display = "none.toml"', OBJECT, THIN, ARRAY, CAMERA), "none.toml: no such file"),
        (("display = 3", OBJECT, THIN, ARRAY, CAMERA),
         "display: 3 is not valid; put it in quotes or write it as [display]"),
        (("display =",), "not TOML"),
        ((DISPLAY, OBJECT, CAMERA.replace("1450", "0.01")), "camera.distance_mm: the camera stands within the array"),
    ],
)  # fmt: skip
def test_refusals(tmp_path, parts, said):
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        load(tmp_path, *parts)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)

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
    names = "hex", "thin", "pickup", "concave", "plain"
    hexagonal, thin, pickup, concave, plain = (load_setup(SETUPS / f"{name}.toml") for name in names)
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


WHOLE = {"display": DISPLAY, "object": OBJECT, "lens": THIN, "array": ARRAY, "camera": CAMERA}
FOCAL_300 = "focal_length_mm = 300"
#: Parts that are others than in the whole file, and what is said of them.
REFUSED = [
    ({"object": ""}, "object: the key is missing"),
    ({"object": "[object]\ndistance_mm = -1"},
     "object.distance_mm: -1 is not valid; give a finite number, from 1e-09 to 1e+12"),
    ({"object": OBJECT + "size = 2"}, "object.size: unknown key; known here: distance_mm, scale"),
    ({"object": "[object]\ndistance_mm = 200", "lens": PAIR.replace("image_distance_mm = 415", FOCAL_300)},
     "object.distance_mm: 200 mm is within the focal length 300 mm"),
    ({"object": "[object]\ndistance_mm = 300", "lens": THIN.replace("image_distance_mm = 415", FOCAL_300)},
     "object.distance_mm: 300 mm is within the focal length 300 mm"),
    ({"lens": THIN.replace("thin", "fat")}, 'lens.kind: "fat" is not valid; choose from "pair", "thin"'),
    ({"lens": THIN + "focal_length_mm = 3"}, "several are given; give exactly one"),
    ({"lens": THIN + "index = 1.5"}, "lens.index: unknown key of a thin lens; leave it out"),
    ({"lens": PAIR.replace("320", "620")}, "lens.aperture_mm: 620 mm is wider than domes"),
    ({"lens": PAIR.replace("60", "40")}, "lens.thickness_mm: 40 mm is below the sag"),
    ({"lens": PAIR.replace("N-BK7", "jelly")}, "lens.glass: unknown glass 'jelly'"),
    ({"lens": PAIR.replace("separation_mm = 1", "separation_mm = 500")},
     "lens.image_distance_mm: no pair of such thick lenses"),
    ({"array": ""}, "array.position_mm: the key is missing"),
    ({"array": "[array]\nposition_mm = -500"}, "array.position_mm: -500 mm puts the array"),
    # Behind the principal plane, yet inside the thick lens.
    ({"lens": PAIR, "array": "[array]\nposition_mm = -390"}, "outside the image space"),
    ({"array": "[array]\nposition_mm = 1040"}, "not before the camera: outside the image"),
    ({"array": ARRAY + "focal_length_mm = 0"}, "0 is no focal length"),
    ({"array": ARRAY + "focal_length_mm = -1"}, "array.focal_length_mm: radius 0.5 mm is too small to span its cell"),
    ({"array": ARRAY + "thickness_mm = 0.01"}, "array.thickness_mm: 0.01 mm is below"),
    ({"display": DISPLAY + 'plano_side = "viewer"\n', "array": ARRAY + "focal_length_mm = -3.3"},
     "concave lenslets are traced with their plano side to the camera only"),
    ({"camera": ""}, "camera or pickup: none is given"),
    ({"pickup": "[pickup]\ngap_mm = 3"}, "camera or pickup: several are given"),
    ({"display": DISPLAY.replace("pixel_pitch_mm = 0.1", "pixel_pitch_mm = 0.6")},
     "the picture has 1.67 pixels for a lenslet, fewer than 2"),
    ({"display": DISPLAY.replace("[display.array]", 'subpixels = "rgb"\n[display.array]')}, "has colour sub-pixels"),
    ({"display": DISPLAY.replace("pitch_mm = 1.0", "pitch_mm = 9.0")},
     "display.array.radius_mm: radius 1.65 mm is too small"),
    ({"display": 'display = "none.toml"'}, "none.toml: no such file"),
    ({"display": "display = 3"}, "display: 3 is not valid; put it in quotes or write it as [display]"),
    ({"display": "display ="}, "not TOML"),
    ({"lens": "", "array": "", "camera": CAMERA.replace("1450", "0.01")},
     "camera.distance_mm: the camera stands within the array"),
]  # fmt: skip


@pytest.mark.parametrize(("parts", "said"), REFUSED)
def test_refusals(tmp_path, parts, said):
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        load(tmp_path, *(WHOLE | parts).values())
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)

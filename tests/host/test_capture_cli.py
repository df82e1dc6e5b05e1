"""`lippmann capture` and its set-up files: answers, files, what an eye sees of them, and what is refused."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from lippmann.base.images import read_picture
from lippmann.capturing.capture import rays_from_picture
from lippmann.capturing.capture_setup import Camera, Pickup, load_setup
from lippmann.capturing.elemental_rotation import rotated, rotation_map
from lippmann.capturing.imaging_lens import ThinLens
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import InputError
from lippmann.optics.backend import NumpyBackend
from lippmann.scenes.placement import Placement
from scene_cases import generator, glowing_sphere, small_toml, write_scene

TOP = Path(__file__).parents[2]
SETUP = f"""
[display]
name = "small"
{small_toml(400, 300, gap_mm=4.8).replace("[", "[display.")}
[object]
distance_mm = 1000
rotation_deg = [0, 0, 180]
[lens]
kind = "thin"
image_distance_mm = 415
aperture_mm = 300
[array]
position_mm = -60
[camera]
distance_mm = 1450
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    (tmp_path / "s.toml").write_text(SETUP)
    write_scene(tmp_path / "ball.xml", glowing_sphere((5.0, 5.0, -5.0), 4.0))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def capture(capfd, *more, code=0):
    capfd.readouterr()
    base = ["capture", "ball.xml", "--setup", "s.toml", "-o", "out.exr", "--samples", "1", "--device", "llvm"]
    found = run([*base, *(str(m) for m in more)])
    out, err = capfd.readouterr()
    assert found == code, err
    return out, err


def change(place, old, new):
    text = (place / "s.toml").read_text()
    assert old in text
    (place / "s.toml").write_text(text.replace(old, new))


def test_answer_and_files(place, capfd, mi):
    out, _ = capture(capfd, "--json", "--display-out", "shows.toml")
    answer = json.loads(out)
    assert answer["focal_length_mm"] == pytest.approx(293.2862190812721)
    assert answer["image_distance_mm"] == pytest.approx(415.0)
    assert answer["magnification"] == pytest.approx(-0.415)
    assert (answer["array_position_mm"], answer["array_distance_mm"]) == (-60.0, pytest.approx(355.0))
    assert answer["elemental_image_px"] == pytest.approx(10.0)
    assert (answer["image"], answer["relief"], answer["rotated"]) == ("real", "orthoscopic", True)
    assert answer["vignetting_percent"] == 0.0
    display = load_display("shows.toml")
    picture = read_picture("out.exr")
    assert display.identity == answer["identity"] == picture.metadata["identity"]
    assert picture.metadata["setup"] == "s"
    assert picture.radiance.max() > 0.5
    # The observer takes the picture for that display; the ball stands right of the axis and above it.
    words = "observe out.exr --display shows.toml --eye 0,0,600 -o view.exr --width 40"
    assert run(words.split()) == 0
    light = read_picture("view.exr").radiance.sum(axis=2)
    rows, columns = np.indices(light.shape)
    assert (light * columns).sum() / light.sum() > 20.0
    assert (light * rows).sum() / light.sum() < 14.5


def test_rotation_is_what_no_rotate_leaves_out(place, capfd, mi):
    capture(capfd, "--no-rotate", "-o", "plain.exr")
    capture(capfd, "--rotate", "-o", "turned.exr")
    plain, turned = read_picture("plain.exr"), read_picture("turned.exr")
    assert (plain.metadata["rotated"], turned.metadata["rotated"]) == ("False", "True")
    assert np.array_equal(rotated(plain.radiance, rotation_map(load_setup("s.toml").display)), turned.radiance)
    out, _ = capture(capfd, "--json", "--no-rotate")
    assert json.loads(out)["relief"] == "pseudoscopic"


@pytest.mark.parametrize(
    ("old", "new", "more", "said"),
    [
        ("aperture_mm = 300", "aperture_mm = 0.0001", (), "lens.aperture_mm: no ray passes lens and array"),
        ("position_mm = -60", "position_mm = -300", (), "array.position_mm: -300 mm is outside the image space"),
        ("[0, 0, 180]", "[0, 0, 180]\noffset_mm = [0, 0, 1005]", (), "the scene extends"),
        ("", "", ("--size", "70"), "at least 2 are needed; give a larger --size"),
        ("", "", ("--size", "0"), "size 0 is out of range"),
        ("distance_mm = 1450", "distance_mm = 412", (), "the camera, 411.9 mm behind"),
        ("[0, 0, 180]", "[0, 0, 180]\noffset_mm = [0, 0, 702]", (), "camera.distance_mm: the scene's image ("),
        ("width_px = 400\nheight_px = 300", "width_px = 24\nheight_px = 24", (), "2.4 lenslets across the display"),
        ("", "", ("--display-out", "s.toml"), "s.toml: exists, and is not this image's display file"),
        ("", "", ("--aperture", "chief"), "aperture applies only to a [pickup]"),
        ("", "", ("--memory-mb", "nan"), "'--memory-mb': 'nan' is not finite; give a finite number"),
        ("", "", ("-o", "out.jpg"), "unknown extension"),
        ("", "", ("--samples", "0"), "samples 0 is out of range"),
        ("", "", ("--setup", "none.toml"), "none.toml: no such file; give the path of a set-up file"),
    ],
)
def test_refusals(place, capfd, mi, old, new, more, said):
    if old:
        change(place, old, new)
    out, err = capture(capfd, *more, code=2)
    assert out == ""
    assert said in err
    assert len(err.splitlines()) == 1
    assert not (place / "out.exr").exists()


def test_the_image_may_come_near_the_camera(place, capfd, mi):
    """The ball's image stands some 415 mm behind the lens, the camera at 550 mm."""
    change(place, "distance_mm = 1450", "distance_mm = 550")
    out, _ = capture(capfd, "--json")
    low, high = json.loads(out)["shown_depth_mm"]
    # The ball's front, z = -1: 1/s' = 1/f - 1/1001, and the rays as depths.py has them.
    f, length = 415.0e3 / 1415.0, json.loads(out)["camera_distance_mm"]
    z = 355.0 - 1.0 / (1.0 / f - 1.0 / 1001.0)
    v = 1.0 / (1.0 / 3.3 - 1.0 / length)
    g = load_setup("s.toml").display.aperture_distance_mm
    assert high == pytest.approx(-g / v * (z - v) * length / (length + z), rel=1e-3)
    assert 0.0 < low < high


def test_the_array_s_loss_is_told(place, capfd, mi):
    """Domes of radius R reflect what comes along the axis farther than R / n out (sin of incidence r / R = 1 / n)."""
    change(place, "pitch_mm = 1.0\nfocal_length_mm = 3.3", "pitch_mm = 1.0\nfocal_length_mm = 1.42")
    change(place, "aperture_mm = 300", "aperture_mm = 5000")
    change(place, "position_mm = -60", "position_mm = 0")
    change(place, "pixel_pitch_mm = 0.1", "pixel_pitch_mm = 0.02")
    out, err = capture(capfd, "--json")
    percent = json.loads(out)["array_loss_percent"]
    # A disc of radius 0.71 mm / 1.5 = 0.473 mm in a square of 1 mm; the camera's perspective adds little.
    assert percent == pytest.approx(100.0 * (1.0 - np.pi * (0.71 / 1.5) ** 2), abs=1.0)
    assert f"note: {percent:.1f} % of the rays are lost in the array" in err
    assert "lens's aperture" not in err


def test_all_is_lost_in_the_array(place, capfd, mi):
    """A camera that sees the corners of four lenslets alone: not the lens's fault."""
    change(place, "focal_length_mm = 3.3", "focal_length_mm = 1.42\noffset_mm = [0.5, 0.5]")
    change(place, "width_px = 400\nheight_px = 300", "width_px = 8\nheight_px = 8")
    change(place, "pixel_pitch_mm = 0.1", "pixel_pitch_mm = 0.02")
    change(place, "position_mm = -60", "position_mm = 0")
    _, err = capture(capfd, code=2)
    assert "array: total internal reflection blocks all rays in the lenslets" in err
    assert "lens.aperture_mm" not in err


@pytest.mark.parametrize("array_too", [False, True])
def test_the_losses_are_those_of_golden_s_rays(place, capfd, mi, array_too):
    """Rays through all pixel centres, which a lens of 40 mm loses, or lenslets that reflect totally, too."""
    change(place, "aperture_mm = 300", "aperture_mm = 40")
    if array_too:
        change(place, "focal_length_mm = 3.3", "focal_length_mm = 1.42")
        change(place, "position_mm = -60", "position_mm = 0")
        change(place, "pixel_pitch_mm = 0.1", "pixel_pitch_mm = 0.02")
    out, err = capture(capfd, "--json")
    answer = json.loads(out)
    percent = answer["vignetting_percent"]
    if not array_too:
        # A lenslet's rays alone, 0.3 f wide, reach 107 mm across at 355 mm, a disc of 40 mm out of a square of
        # 355 mm / 3.32 mm = 107 mm, and the field: 1 - pi/4 (40/107)^2 = 89 %.
        assert percent == pytest.approx(89.0, abs=2.0)
        assert f"note: the lens's aperture cuts off {percent:.1f} % of the rays" in err
    row, column = np.mgrid[0:300, 0:400]
    rays = rays_from_picture(NumpyBackend(), load_setup("s.toml"), column.ravel() + 0.5, row.ravel() + 0.5)
    # In float32 a ray in a thousand may pass a rim that it meets in float64.
    lens = 100.0 * np.mean(rays.through_array & ~rays.through_lens)
    assert percent == pytest.approx(lens, abs=0.1)
    array = 100.0 * np.mean(~rays.through_array)
    assert answer["array_loss_percent"] == pytest.approx(array, abs=0.1)
    assert (array > 10.0) == array_too
    # Four samples, anywhere in their pixels, see the same aperture.
    answer = json.loads(capture(capfd, "--json", "--samples", "4")[0])
    assert answer["vignetting_percent"] == pytest.approx(lens, abs=0.5)


def test_the_same_again(place, capfd, mi):
    """A command may be repeated: the display file is the same; another one is not written over."""
    capture(capfd, "--display-out", "shows.toml", "--size", "200")
    written = (place / "shows.toml").read_bytes()
    assert load_display("shows.toml").panel.height_px == 150
    capture(capfd, "--display-out", "shows.toml", "--size", "200")
    assert (place / "shows.toml").read_bytes() == written
    _, err = capture(capfd, "--display-out", "shows.toml", "--size", "120", code=2)
    assert "shows.toml: exists, and is not this image's display file; give another name" in err
    assert (place / "shows.toml").read_bytes() == written


def test_a_set_up_of_the_scene_s_name_is_no_placement(place, capfd, mi):
    capture(capfd)
    expected = read_picture("out.exr").radiance
    (place / "s.toml").rename(place / "ball.toml")
    capture(capfd, "--setup", "ball.toml")
    assert np.array_equal(read_picture("out.exr").radiance, expected)


def test_the_shipped_identities():
    """A picture of the full size fits the display file that the set-up names."""
    paths = list((TOP / "scenes/setups").glob("*.toml"))
    assert len(paths) >= 9
    for path in paths:
        named = re.search(r'^display = "(.+)"$', path.read_text(), re.M)[1]
        assert load_setup(path).display.identity == load_display(path.parent / named).identity


def test_placements_one_after_the_other():
    rng = generator(21)

    def drawn():
        return Placement(rng.uniform(0.1, 9), tuple(rng.uniform(-180, 180, 3)), tuple(rng.uniform(-50, 50, 3)))

    for _ in range(20):
        first, second = drawn(), drawn()
        both = first.then(second)
        assert both.display_from_scene == pytest.approx(second.display_from_scene @ first.display_from_scene, abs=1e-10)
    upright = Placement(near_mm=10.0, far_mm=-5.0).then(Placement(2.0, (0.0, 0.0, 180.0), (0.0, 0.0, 3.0)))
    assert (upright.near_mm, upright.far_mm) == (23.0, -7.0)
    assert Placement(near_mm=10.0, far_mm=-5.0).then(Placement(1.0, (0.0, 10.0, 0.0))).near_mm is None
    for scale in (1e-8, 1e8):
        placement = Placement(scale, (10.0, 20.0, 30.0))
        assert placement.then(Placement()).rotation_deg == pytest.approx((10.0, 20.0, 30.0), abs=1e-9)
    # A turn of a quarter about y: the angles about x and z are not told apart.
    for x, z in ((30.0, 0.0), (0.0, 40.0), (20.0, -70.0)):
        steep = Placement(1.0, (x, 90.0, z))
        assert steep.then(Placement()).display_from_scene == pytest.approx(steep.display_from_scene, abs=1e-10)


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


def load_parts(tmp_path, *parts):
    path = tmp_path / "s.toml"
    path.write_text("\n".join(parts))
    return load_setup(path)


@pytest.mark.parametrize("lens", [THIN, PAIR], ids=["thin", "pair"])
def test_the_paper_s_numbers(tmp_path, lens):
    """100 cm to 41.5 cm: f = 1000 * 415 / 1415, m = -0.415; the array 6 cm before the image, the camera at 145 cm."""
    setup = load_parts(tmp_path, DISPLAY, OBJECT, lens, ARRAY, CAMERA)
    assert setup.lens.focal_length_mm == pytest.approx(293.2862190812721, rel=1e-12)
    assert setup.image_distance_mm == pytest.approx(415.0, rel=1e-12)
    assert setup.magnification == pytest.approx(-0.415, rel=1e-12)
    assert setup.array_distance_mm == pytest.approx(355.0, rel=1e-12)
    # Thinnest lenslet: R = 1.65, T = R - sqrt(R^2 - 1/2); its principal plane T - T/n before the vertices.
    thickness = 1.65 - math.sqrt(1.65**2 - 0.5)
    assert setup.camera_distance_mm == pytest.approx(1450 - 355 - thickness / 3, rel=1e-12)
    assert setup.pickup == Camera(1450.0)
    assert setup.name == "s"


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
    with pytest.raises(InputError, match=re.escape("has 2.00 pixels per lenslet; at least 2 are needed")):
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
    ({"lens": THIN + "index = 1.5"}, "lens.index: a thin lens has no such key; remove it"),
    ({"lens": PAIR.replace("320", "620")}, "lens.aperture_mm: 620 mm is wider than a lens"),
    ({"lens": PAIR.replace("60", "40")}, "lens.thickness_mm: 40 mm is less than the sag"),
    ({"lens": PAIR.replace("N-BK7", "jelly")}, "lens.glass: unknown glass 'jelly'"),
    ({"lens": PAIR.replace("separation_mm = 1", "separation_mm = 500")},
     "lens.image_distance_mm: a focal length of"),
    ({"array": ""}, "array.position_mm: the key is missing"),
    ({"array": "[array]\nposition_mm = -500"}, "array.position_mm: -500 mm puts the array"),
    # Behind the principal plane, yet inside the thick lens.
    ({"lens": PAIR, "array": "[array]\nposition_mm = -390"}, "outside the image space"),
    ({"array": "[array]\nposition_mm = 1040"}, "not before the camera: outside the image"),
    ({"array": ARRAY + "focal_length_mm = 0"}, "the focal length is 0"),
    ({"array": ARRAY + "focal_length_mm = -1"}, "array.focal_length_mm: radius 0.5 mm is too small to span its cell"),
    ({"array": ARRAY + "thickness_mm = 0.01"}, "array.thickness_mm: 0.01 mm is below"),
    ({"display": DISPLAY + 'plano_side = "viewer"\n', "array": ARRAY + "focal_length_mm = -3.3"},
     "concave lenslets must have their plano side towards the camera"),
    ({"camera": ""}, "camera or pickup: none is given"),
    ({"pickup": "[pickup]\ngap_mm = 3"}, "camera or pickup: several are given"),
    ({"display": DISPLAY.replace("pixel_pitch_mm = 0.1", "pixel_pitch_mm = 0.6")},
     "the picture has 1.67 pixels per lenslet; at least 2 are needed"),
    ({"display": DISPLAY.replace("[display.array]", 'subpixels = "rgb"\n[display.array]')}, "has colour sub-pixels"),
    ({"display": DISPLAY.replace("pitch_mm = 1.0", "pitch_mm = 9.0")},
     "display.array.radius_mm: radius 1.65 mm is too small"),
    ({"display": 'display = "none.toml"'}, "none.toml: no such file"),
    ({"display": "display = 3"}, "display: 3 is not valid; put it in quotes or write it as [display]"),
    ({"display": "display ="}, "not TOML"),
    ({"lens": "", "array": "", "camera": CAMERA.replace("1450", "0.01")},
     "camera.distance_mm: the camera is inside the array"),
]  # fmt: skip


@pytest.mark.parametrize(("parts", "said"), REFUSED)
def test_wrong_set_ups_are_refused(tmp_path, parts, said):
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        load_parts(tmp_path, *(WHOLE | parts).values())
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)

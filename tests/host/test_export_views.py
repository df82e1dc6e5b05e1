"""Views, quilts, focal stacks and depth for other tools, against geometry by hand and Pillow's reading."""

import json
import math
import re

import numpy as np
import pytest
from lippmann.base.images import read_picture
from lippmann.base.tones import psnr_db
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import InputError
from lippmann.eye.many_views import eyes_of, scene_viewer
from lippmann.eye.observer import Eye, whole_window
from lippmann.rendering.options import Settings
from lippmann.rendering.sampling import Window, first_depths
from lippmann.scenes.quilts_and_views import quilt_path
from lippmann.scenes.scene import load_scene
from PIL import Image
from scene_cases import glowing_sphere, write_scene
from test_film import DISPLAY

#: Balls of 0.25 mm that glow, on the axis: red before the display, green in its plane, blue behind.
DEPTHS_MM = {"red": 20.0, "green": 0.0, "blue": -30.0}
BALLS = [
    glowing_sphere((0.0, y, z), 0.25, colour)
    for y, z, colour in zip((1.0, 0.0, -1.0), DEPTHS_MM.values(), np.eye(3), strict=True)
]
NEAR_FAR = "[placement]\nnear_mm = 25.0\nfar_mm = -35.0\n"
QUILT = ("--width", "184", "--samples", "4", "--device", "llvm", "--json")


@pytest.fixture
def place(tmp_path, monkeypatch, mi):
    write_scene(tmp_path / "balls.xml", *BALLS)
    (tmp_path / "balls.toml").write_text(NEAR_FAR)
    (tmp_path / "d.toml").write_text(DISPLAY)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def told(capfd, *words, code=0):
    assert run([*map(str, words)]) == code
    out, error = capfd.readouterr()
    return json.loads(out) if code == 0 else error


def centre_mm(tile, colour, window):
    """The centroid of a colour in a picture of values (height, width, 3), mm from the window's middle."""
    weight = tile[..., list(DEPTHS_MM).index(colour)].astype(float)
    weight -= np.minimum(weight, tile.sum(axis=2) - weight)
    rows, columns = np.indices(weight.shape)
    x = ((columns + 0.5) * weight).sum() / weight.sum() / tile.shape[1] - 0.5
    y = 0.5 - ((rows + 0.5) * weight).sum() / weight.sum() / tile.shape[0]
    return x * window[0], y * window[1]


def test_a_quilt_by_the_rules_of_its_name(place, capfd):
    """Cut by Pillow, with the tiling of the name: each tile's balls lie where its eye sees them."""
    columns, rows, cone, distance = 4, 3, 16.0, 250.0
    words = ("--columns", columns, "--rows", rows, "--cone", cone, "--distance", distance)
    said = told(capfd, "export", "quilt", "balls.xml", "--display", "d.toml", "-o", "balls.png", *words, *QUILT)
    (file,) = place.glob("*.png")
    assert said["output"] == file.name
    name = re.fullmatch(r"balls_qs(\d+)x(\d+)a([\d.]+)\.png", file.name)
    assert (int(name[1]), int(name[2])) == (columns, rows)
    picture = Image.open(file).convert("RGB")
    width, height = picture.width // columns, picture.height // rows
    assert width / height == pytest.approx(float(name[3]), abs=1e-5)
    assert width / height == pytest.approx(46 / 32)
    window = 4.6, 3.2
    reach = distance * math.tan(math.radians(cone / 2))
    for view in range(columns * rows):
        left, top = view % columns * width, (rows - 1 - view // columns) * height
        tile = np.asarray(picture.crop((left, top, left + width, top + height)))
        eye = -reach + 2 * reach * view / (columns * rows - 1)
        np.testing.assert_allclose(said["eyes_mm"][view], (eye, 0.0, distance), atol=1e-9)
        for (colour, z), y in zip(DEPTHS_MM.items(), (1.0, 0.0, -1.0), strict=True):
            # The line from the eye to the ball meets the window.
            share = distance / (distance - z)
            expected = eye + (0.0 - eye) * share, y * share
            if max(abs(expected[0]) / window[0], abs(expected[1]) / window[1]) < 0.4:
                np.testing.assert_allclose(centre_mm(tile, colour, window), expected, atol=0.02)


def test_views_of_an_image_are_those_through_its_lenslets(place, capfd):
    told(capfd, "render", "balls.xml", "--display", "d.toml", "-o", "a.exr", "--samples", "1", *QUILT[4:])
    words = ("--across", "3", "--linear", "-o", "views")
    said = told(capfd, "export", "views", "a.exr", "--display", "d.toml", *words, *QUILT)
    assert json.loads((place / "views/views.json").read_text())["views"] == said["views"]
    display = load_display("d.toml")
    for view, eye in zip(said["views"], eyes_of(display, 3), strict=True):
        at = ",".join(map(repr, view["eye_mm"]))
        assert view["eye_mm"] == list(eye)
        observed = ("--display", "d.toml", f"--eye={at}", "-o", "eye.exr")
        told(capfd, "observe", "a.exr", *observed, *QUILT)
        found, expected = (read_picture(path).radiance for path in (place / "views" / view["file"], "eye.exr"))
        np.testing.assert_array_equal(found, expected)
    told(capfd, "export", "views", "a.exr", "--display", "d.toml", *words, *QUILT)
    fewer = ("--across", "2", "--linear", "-o", "views")
    error = told(capfd, "export", "views", "a.exr", "--display", "d.toml", *fewer, *QUILT, code=2)
    assert "views: contains view_0002.exr of another export" in error


def test_eyes_in_steps_and_in_the_viewing_zone(mi, place):
    display = load_display("d.toml")
    x = [eye[0] for eye in eyes_of(display, 5, 1, 40.0, 300.0)]
    np.testing.assert_allclose(np.degrees(np.arctan2([x[0], x[-1]], 300.0)), (-20.0, 20.0))
    np.testing.assert_allclose(np.diff(x), 300.0 * math.tan(math.radians(20.0)) / 2)
    grid = eyes_of(display, 3, 2, 10.0, 300.0)
    assert [(eye[0] < 0, eye[1] < 0) for eye in grid[:1]] == [(True, True)]
    assert grid[2][0] > 0 > grid[2][1]
    assert grid[3][0] < 0 < grid[3][1]
    # Without a cone no eye sees crosstalk.
    zone = np.array(eyes_of(display, 2, 2))
    assert 0.0 < zone[-1, 0] < 0.5 * zone[0, 2] * 1.0 / 3.3
    for wrong in ({"cone_deg": 121.0}, {"cone_deg": -1.0}, {"distance_mm": 0.0}, {"distance_mm": math.inf}):
        with pytest.raises(InputError, match=r"out of range|above 0"):
            eyes_of(display, 2, **wrong)


def test_depths_by_hand(mi, place, capfd):
    """The front of a ball on the eye's axis; the eye is before the scene, or in it."""
    scene = load_scene("balls.xml")
    window = Window(0.2, 4.0, 1, 41)
    for distance in (250.0, 22.0):
        seen = first_depths(scene, (0.0, 0.0, distance), window)
        assert seen[20, 0] == pytest.approx(0.25, abs=1e-4)
        hits = np.isfinite(seen)
        assert hits.any()
        assert not hits.all()
        assert np.isneginf(seen[~hits]).all()
    seen = told(
        capfd, "export", "depth", "balls.xml", "--display", "d.toml", "-o", "z.tif", "--width", "92", *QUILT[4:]
    )
    assert seen["near_mm"] == pytest.approx(20.25, abs=0.05)
    assert seen["far_mm"] == pytest.approx(-30.0, abs=0.25)
    depths = read_picture("z.tif").radiance[..., 0]
    assert depths.max() == pytest.approx(seen["near_mm"])
    assert (depths == depths.min()).mean() == pytest.approx(seen["empty_share"], abs=1e-3)
    told(capfd, "export", "depth", "balls.xml", "--display", "d.toml", "-o", "z.png", "--width", "92", *QUILT[4:])
    levels = np.asarray(Image.open("z.png").convert("RGB"))[..., 0] / 255.0
    expected = (depths - seen["far_mm"]) / (seen["near_mm"] - seen["far_mm"])
    np.testing.assert_allclose(levels, expected, atol=0.5 / 255 + 0.002)


def test_a_focal_stack_is_sharp_at_its_depths(mi, place, capfd):
    """The ball in focus is as a pinhole sees it; another one is a disk as wide as the pupil's cone at the window."""
    scene, window = load_scene("balls.xml"), whole_window(load_display("d.toml"), 230)
    settings, at, pupil = Settings(samples=64), (0.0, 0.0, 250.0), 6.0
    sharp = scene_viewer(scene, window, settings)(Eye(at))
    columns = (np.arange(230) + 0.5) * window.width_mm / 230
    for number, (colour, z) in enumerate(DEPTHS_MM.items()):
        blurred = scene_viewer(scene, window, settings)(Eye(at, pupil, z))
        only = np.eye(3)[number]
        assert psnr_db(blurred * only, sharp * only) > 38.0, colour
        for other, depth in enumerate(DEPTHS_MM.values()):
            if other != number:
                share = blurred[..., other].sum(axis=0) / blurred[..., other].sum()
                rms = math.sqrt((share * (columns - (share * columns).sum()) ** 2).sum())
                # Uniform disks of the pupil's cone and of the ball, seen at the window: a quarter of the diameter each.
                cone = pupil * abs(depth - z) / (250.0 - z) * 250.0 / (250.0 - depth)
                ball = 0.5 * 250.0 / (250.0 - depth)
                assert rms == pytest.approx(math.hypot(cone, ball) / 4, rel=0.08), (colour, other)
    words = ("--depths", "20,0", "--pupil", "6", "-o", "stack")
    said = told(capfd, "export", "focal-stack", "balls.xml", "--display", "d.toml", *words, *QUILT)
    assert [one["focus_mm"] for one in said["pictures"]] == [20.0, 0.0]
    assert all((place / "stack" / one["file"]).exists() for one in said["pictures"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("quilt balls.xml -o b_qs9x9a1.44.png", "has another tiling than _qs8x6a1.43885"),
        ("quilt none.xml -o b.png", "no such scene"),
        ("quilt none.png -o b.png", "no such image"),
        ("quilt balls.xml -o b.gif", "unknown extension '.gif'"),
        ("views balls.xml -o v --cone 150", "the cone of 150 degrees is out of range"),
        ("focal-stack balls.xml -o v --depths 1,x", "'--depths': '1,x' is not Z,Z,...; give a list"),
        ("focal-stack balls.xml -o v --depths 9999", "the focus is behind the eye"),
        ("depth balls.xml -o z.tif --offset 50,0,0", "the eye sees no surface"),
        ("depth balls.xml -o z.exr", "unknown extension '.exr'"),
        # An image has no depth.
        ("depth a.exr -o z.tif", "give the scene"),
        ("focal-stack a.exr -o v", "give --depths"),
        ("views a.exr -o v --scale 2", "--scale is for scenes"),
    ],
)
def test_refusals(place, capfd, words, said):
    if "a.exr" in words:
        told(capfd, "render", "balls.xml", "--display", "d.toml", "-o", "a.exr", "--samples", "1", *QUILT[4:])
    error = told(capfd, "export", *words.split(), "--display", "d.toml", "--device", "llvm", code=2)
    assert said in error
    assert len(error.splitlines()) == 1
    assert {path.name for path in place.iterdir()} <= {"balls.xml", "balls.toml", "d.toml", "v", "a.exr"}


def test_names_of_quilts(tmp_path):
    assert quilt_path(tmp_path / "a.png", 8, 6, 0.75).name == "a_qs8x6a0.75.png"
    assert quilt_path(tmp_path / "a_qs8x6a0.75.png", 8, 6, 0.7512).name == "a_qs8x6a0.75.png"
    assert quilt_path(tmp_path / "a.png", 5, 9, 4 / 3).name == "a_qs5x9a1.33333.png"

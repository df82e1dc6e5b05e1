"""Scenes placed for a display: into its depth range, or by their own camera; and the remarks before a render."""

import dataclasses
import itertools
import math
import re
import warnings
from pathlib import Path
from types import SimpleNamespace

import lippmann
import numpy as np
import pytest
from lippmann.base.images import read_picture
from lippmann.base.tones import psnr_db
from lippmann.cli import run
from lippmann.errors import InputError
from lippmann.motion.film import load_film
from lippmann.motion.film_frames import plan_film
from lippmann.rendering.diagnostics import warn_of_unused_parts, warn_of_view
from lippmann.rendering.options import RenderOptions, Settings
from lippmann.rendering.renderer import render_view
from lippmann.rendering.sampling import Window
from lippmann.scenes.placement import Placement, arranged
from lippmann.scenes.scene import Scene, load_scene
from scene_cases import display_toml, focused_display, generator, glowing_sphere, rgb, write_scene

SEED = 5508
POINT_LIGHT = (
    f'<emitter type="point"><point name="position" x="0" y="30" z="60"/>{rgb("intensity", (4e3,) * 3)}</emitter>'
)


def small_display(**others):
    """32 x 24 mm, depth range +-20 mm: p D / pixel = 1 x 4 / 0.2."""
    return focused_display("square", focal=4.0, width_px=160, height_px=120, pixel_pitch=0.2, **others)


def card(z, size=1000.0, reflectance=0.5):
    return (
        f'<shape type="rectangle"><transform name="to_world"><scale value="{size}"/><translate z="{z}"/></transform>'
        f'<bsdf type="diffuse">{rgb("reflectance", (reflectance,) * 3)}</bsdf></shape>'
    )


def diffuse_sphere(centre, radius, colour):
    shape, _, _ = glowing_sphere(map(float, centre), radius).partition("<emitter")
    return f'{shape}<bsdf type="diffuse">{rgb("reflectance", colour)}</bsdf></shape>'


def noted(scene, display=None, **settings):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_unused_parts(scene, Settings(**settings))
        warn_of_view(scene, display or small_display(), Settings(**settings))
    return [f"note: {one.message}" for one in caught]


@pytest.mark.parametrize("viewing", [None, 150.0])
@pytest.mark.parametrize("case", range(6))
def test_fit_fills_view_or_depth_range(mi, tmp_path, case, viewing):
    """The scene's box, turned, ends within the depth range and in the eye's pyramid, and reaches one of them."""
    rng = generator(SEED, case)
    size = rng.uniform(0.05, 40.0) * np.exp(rng.uniform(-1.5, 1.5, 3))
    middle = rng.uniform(-200, 200, 3)
    balls = [glowing_sphere((middle + s * size).tolist(), 0.01) for s in ((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))]
    turn = tuple(rng.uniform(-180, 180, 3)) if case % 2 else (0.0, 0.0, 0.0)
    path = write_scene(tmp_path / "box.xml", "".join(balls))
    display = dataclasses.replace(small_display(), viewing_distance_mm=viewing)
    scene = arranged(load_scene(path, Placement(7.0, turn, (1.0, 2.0, 3.0))), display, "fit")
    ends = [(m - 0.5 * s - 0.01, m + 0.5 * s + 0.01) for m, s in zip(middle, size, strict=True)]
    corners = np.array(list(itertools.product(*ends, (1.0,)))).reshape(-1, 4)
    x, y, z = (corners @ scene.placement.display_from_scene.T)[:, :3].T
    # Of the box in the display's axes round them.
    low, high = (np.array([f(w) for w in (x, y, z)]) for f in (np.min, np.max))
    np.testing.assert_allclose(0.5 * (low + high), 0.0, atol=1e-4)  # Mitsuba's box is float32
    eye = viewing or 600.0
    half = np.array([16.0, 12.0]) * (1.0 - high[2] / eye)
    shares = [high[0] / half[0], high[1] / half[1], high[2] / 20.0]
    assert max(shares) == pytest.approx(1.0, abs=1e-4)
    far, near = scene.depth_range_mm
    assert far == pytest.approx(low[2], abs=1e-4)
    assert high[2] < near < high[2] + 0.1
    turned = scene.placement.display_from_scene[:3, :3] / scene.placement.scale
    np.testing.assert_allclose(turned, Placement(1.0, turn).display_from_scene[:3, :3], atol=1e-12)


def test_a_film_is_fitted_as_a_whole(mi, tmp_path):
    """A ball that moves 100 mm to the right and 60 mm back, with the same motion at the new size."""
    ball = glowing_sphere((0.0, 0.0, 0.0), 5.0).replace('type="sphere"', 'type="sphere" id="ball"')
    write_scene(tmp_path / "ball.xml", ball)
    (tmp_path / "film.toml").write_text(
        'scene = "ball.xml"\nframes = 5\nnear_mm = 300\n[[object]]\nshapes = "ball"\n'
        "keys = [{frame = 1}, {frame = 3, offset_mm = [100, 0, -60]}]\n"
    )
    display = small_display()
    shots = plan_film(load_film(tmp_path / "film.toml"), display, RenderOptions(), None)
    # 110 x 10 x 70 mm: s (110 + 32 x 70 / 1200) = 32 by the width, less than 40 / 70 by the depths.
    scale = 32.0 / (110.0 + 32.0 * 35.0 / 600.0)
    for shot, x, z in ((shots[0], -50.0, 30.0), (shots[4], 50.0, -30.0)):
        box = load_scene(shot.film.scene, shot.placement, shot.moves).mitsuba.bbox()
        corners = np.array([np.array(box.min).ravel(), np.array(box.max).ravel()])
        placed = corners @ shot.placement.display_from_scene[:3, :3].T + shot.placement.offset_mm
        np.testing.assert_allclose(placed.mean(axis=0), [scale * x, 0.0, scale * z], atol=1e-4)
        np.testing.assert_allclose(np.ptp(placed, axis=0), 10.0 * scale, atol=1e-4)
        assert shot.film.near_mm is None


@pytest.mark.parametrize("case", range(4))
def test_the_eye_sees_what_the_files_camera_sees(mi, tmp_path, case):
    """Against Mitsuba's own sensor, in a closed room whose wall is behind the camera, too; a thin lens, a lookat."""
    rng = generator(SEED, 1, case)
    scale = 10.0 ** rng.uniform(-2, 2)
    origin, target = scale * rng.uniform(-0.5, 0.5, 3) + [0, 0, 2 * scale], scale * rng.uniform(-0.2, 0.2, 3)
    fov, kind = rng.uniform(20, 60), ("perspective", "thinlens")[case % 2]
    lens = '<float name="aperture_radius" value="0.000001"/>' if kind == "thinlens" else ""
    up = ("0,1,0", "0.3,1,0.1")[case // 2]
    body = diffuse_sphere(target, 0.2 * scale, (1, 1, 0))
    for centre in scale * rng.uniform(-0.7, 0.7, (12, 3)):
        body += diffuse_sphere(centre, 0.25 * scale, rng.uniform(0, 1, 3))
    room = f'<shape type="cube"><transform name="to_world"><scale value="{4 * scale}"/></transform>'
    room += '<boolean name="flip_normals" value="true"/></shape>'
    camera = (
        f'<sensor type="{kind}"><float name="fov" value="{fov}"/>{lens}<transform name="to_world">'
        f'<lookat origin="{",".join(map(str, origin))}" target="{",".join(map(str, target))}" up="{up}"/></transform>'
        '<film type="hdrfilm"><integer name="width" value="160"/><integer name="height" value="120"/>'
        '<rfilter type="box"/></film></sensor>'
    )
    light = f'<emitter type="point"><point name="position" x="0" y="{3 * scale}" z="{3 * scale}"/>'
    light += f"{rgb('intensity', (20 * scale**2,) * 3)}</emitter>"
    path = write_scene(tmp_path / "seen.xml", camera + body + room + light)
    display = small_display()
    scene = arranged(load_scene(path), display, "camera")
    eye = 16.0 / math.tan(math.radians(0.5 * fov))
    ours = render_view(scene, (0.0, 0.0, eye), Window(32.0, 24.0, 160, 120), Settings(samples=64)).radiance
    theirs = np.array(mi.render(scene.mitsuba, integrator=mi.load_dict({"type": "direct"}), spp=64))
    assert np.ptp(theirs) > 0.2
    assert psnr_db(ours, theirs) > 32.0  # silhouettes, 64 points a pixel each
    # The surface on the axis is in the panel's plane.
    placed = scene.placement.display_from_scene @ [*origin, 1.0]
    np.testing.assert_allclose(placed[:3], [0, 0, eye], atol=1e-4 * eye)
    axis = (target - origin) / np.linalg.norm(target - origin)
    hit = scene.mitsuba.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(axis)))
    point = scene.placement.display_from_scene @ [*np.array(hit.p).ravel(), 1.0]
    np.testing.assert_allclose(point[:3], 0.0, atol=1e-3 * eye)


def test_a_camera_that_looks_past_everything_places_the_middle_of_the_scene_in_the_panels_plane(mi, tmp_path):
    """A sphere 10 to 16 in front of it and 6 aside: 13 in front is the panel, whose 32 mm fill 40 degrees."""
    camera = """<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">
    <lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform></sensor>"""
    path = write_scene(tmp_path / "past.xml", camera + glowing_sphere((6.0, 0.0, -8.0), 3.0))
    placement = arranged(load_scene(path), small_display(), "camera").placement
    scale = 16.0 / math.tan(math.radians(20.0)) / 13.0
    placed = placement.display_from_scene @ [6.0, 0.0, -8.0, 1.0]
    np.testing.assert_allclose(placed[:3], [6.0 * scale, 0.0, 0.0], atol=1e-5)


@pytest.mark.parametrize(
    ("low", "high"),
    [((0, 0, 0), (1, math.inf, 1)), ((0, -math.inf, 0), (1, 1, 1)), ((0, 0, 2), (1, 1, 1)), ((1, 0, 0), (0, 1, 1))],
)
def test_a_scene_without_bounds_has_an_infinite_box(low, high):
    box = SimpleNamespace(min=np.array(low, float), max=np.array(high, float))
    scene = SimpleNamespace(bbox=lambda: box, shapes=list)
    for corner, end in zip(Scene(Path("s"), scene, Placement()).box(Placement()), (-math.inf, math.inf), strict=True):
        assert (corner == end).all()


LOOKING_AWAY = """<sensor type="perspective"><transform name="to_world">
<lookat origin="0,0,9" target="0,0,20" up="0,1,0"/></transform></sensor>"""


@pytest.mark.parametrize(
    ("body", "arrange", "said"),
    [
        (glowing_sphere((0, 0, 0), 1.0), "camera", "contains no camera with a field of view"),
        ('<sensor type="orthographic"/>' + glowing_sphere((0, 0, 0), 1.0), "camera", "contains no camera"),
        (LOOKING_AWAY + glowing_sphere((0, 0, 0), 1.0), "camera", "the camera does not look at the scene"),
        ('<emitter type="constant"/>', "fit", "no bounded extent to fit"),
        (glowing_sphere((0, 0, 0), 1.0), "from-camera", "unknown arrange 'from-camera'; choose from fit, camera"),
        (glowing_sphere((0, 0, 0), 1.0), True, "unknown arrange 'True'"),
    ],
)
def test_scenes_that_cannot_be_placed(mi, tmp_path, body, arrange, said):
    path = write_scene(tmp_path / "scene.xml", body)
    with pytest.raises(InputError, match=said):
        arranged(load_scene(path, Placement(near_mm=1.0, far_mm=0.0)), small_display(), arrange)


def test_render_with_fit_equals_the_options_that_it_prints(mi, tmp_path, capfd, refusal_of):
    """Options that the other would overrule are refused."""
    (tmp_path / "d.toml").write_text(display_toml(small_display()))
    balls = glowing_sphere((300, 0, 0), 250.0), glowing_sphere((-150, 80, -300), 100.0)
    path = write_scene(tmp_path / "ball.xml", *balls)
    common = ["render", str(path), "--display", str(tmp_path / "d.toml"), "--samples", "1", "--model", "exact"]
    assert run([*common, "-o", str(tmp_path / "fit.exr"), "--fit", "--rotate", "0,20,0"]) == 0
    printed = re.search(r"^placed by (.*)$", capfd.readouterr().err, re.M)[1]
    assert run([*common, "-o", str(tmp_path / "same.exr"), *printed.split()]) == 0
    assert "note" not in capfd.readouterr().err
    one, two = (lippmann.IntegralImage.load(tmp_path / f"{name}.exr", small_display()) for name in ("fit", "same"))
    assert 0.05 < one.radiance.mean() < 0.95
    assert (one.radiance != two.radiance).mean() < 0.002  # six digits of the scale
    for words, both in (
        (["--fit", "--scale=2"], "--scale and --fit"),
        (["--fit", "--from-camera"], "--from-camera and --fit"),
        (["--from-camera", "--rotate=0,1,0"], "--rotate and --from-camera"),
    ):
        assert f"{both} both place the scene" in refusal_of(*common, "-o", tmp_path / "x.exr", *words)


def test_the_box_of_rectangles_that_mitsuba_merges(mi, tmp_path):
    """Of one material; Mitsuba's own box leaves them out."""
    path = write_scene(tmp_path / "cards.xml", card(-30.0, 20.0) + card(7.0, 4.0) + glowing_sphere((0, 0, 0), 1.0))
    scene = load_scene(path)
    assert scene.depth_range_mm[0] == -30.0
    assert 7.0 < scene.depth_range_mm[1] < 7.1
    assert scene.width_mm == 40.0


@pytest.mark.parametrize(("z", "outside"), [(-19.0, False), (-21.0, True), (19.0, False), (21.0, True), (-300.0, True)])
def test_a_scene_outside_the_depth_range(mi, tmp_path, z, outside):
    path = write_scene(tmp_path / "card.xml", card(z * 0.01, 10.0) + POINT_LIGHT)
    for display in (small_display(), dataclasses.replace(small_display(), viewing_distance_mm=150.0)):
        said = noted(load_scene(path, Placement(100.0, offset_mm=(3.0, 2.0, 0.0))), display)
        assert len(said) == outside
        if outside:
            eye = display.viewing_distance_mm or 600.0
            assert f"100 % of what an eye at {eye:g} mm sees, z = {z:g} to {z:g} mm" in said[0]
            assert "depth range, z = -20 to 20 mm" in said[0]


def test_the_share_outside_by_hand(mi, tmp_path):
    """A card at -100 mm, and before a square of it of 4 mm at the front: 4 x 4 of 32 x 24 mm, 2 % of the view."""
    path = write_scene(tmp_path / "two.xml", card(-100.0) + card(0.0, 2.0) + POINT_LIGHT)
    (said,) = noted(load_scene(path))
    assert said.startswith("note: 98 % of what an eye at 600 mm sees, z = -100 to 0 mm")
    path = write_scene(tmp_path / "more.xml", card(-100.0) + card(0.0, 6.0) + POINT_LIGHT)  # 19 %: fine
    assert noted(load_scene(path)) == []


def test_a_scene_beside_the_view(mi, tmp_path):
    path = write_scene(tmp_path / "beside.xml", glowing_sphere((200, 0, 0), 5.0))
    (said,) = noted(load_scene(path))
    assert re.match(r"note: an eye at 600 mm sees none of the scene's surfaces, z = -5 to 5.0\d+ mm", said)


@pytest.mark.parametrize("samples", [1, 4, pytest.param(16, marks=pytest.mark.full)])
def test_noise_is_that_of_the_picture(mi, tmp_path, samples):
    """Against the spread of twelve renders with other seeds; a lamp's soft shadow, one random point of it a sample."""
    lamp = '<shape type="rectangle"><transform name="to_world"><scale value="25"/>'
    lamp += '<rotate x="1" angle="90"/><translate y="40"/></transform>'
    lamp += f'<emitter type="area">{rgb("radiance", (2.0,) * 3)}</emitter></shape>'
    path = write_scene(tmp_path / "lamp.xml", card(-10.0) + lamp)
    scene = load_scene(path)
    said = noted(scene, samples=samples, seed=3)
    window = Window(32.0, 24.0, 96, 72)
    settings = [Settings(samples=samples, seed=100 + k) for k in range(12)]
    views = np.minimum([render_view(scene, (0.0, 0.0, 600.0), window, one).radiance for one in settings], 1.0)
    noise = math.sqrt(views.var(axis=0, ddof=1).mean()) / views.mean()
    if noise < 0.1:
        assert said == []
        return
    (line,) = said
    pattern = rf"note: with samples = {samples} the noise is (\d+) % .*; (\d+) samples give 10 %"
    told, enough = map(int, re.match(pattern, line).groups())
    assert told == pytest.approx(100.0 * noise, rel=0.15)
    assert noted(scene, samples=math.ceil(1.4 * enough), seed=3) == []


def test_what_is_not_used_is_told(mi, tmp_path):
    fog = (
        '<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.1 0.1 0.1"/></medium>'
        '<shape type="cube"><bsdf type="null"/><ref id="fog" name="interior"/></shape>'
    )
    path = write_scene(tmp_path / "fog.xml", '<integrator type="volpath"/>' + fog + card(-10.0) + POINT_LIGHT)
    scene = load_scene(path)
    said = noted(scene)
    assert said[0] == (
        "note: lights ignores the file's integrator volpath (integrator scene uses it) and the media of 1 shapes "
        "(integrator volpath renders them)"
    )
    for integrator in ("volpath", "scene"):
        assert "ignores" not in " ".join(noted(scene, integrator=integrator))
    dark = load_scene(write_scene(tmp_path / "dark.xml", card(-10.0)))
    assert noted(dark) == ["note: the scene has no light, so the picture is black; add an <emitter> to the file"]
    # An integrator that does not exist is refused before the first remark.
    with pytest.raises(InputError, match="integrator 'wizard' does not load"):
        warn_of_unused_parts(scene, Settings(integrator="wizard"))
    # Mitsuba makes up an integrator for a file without one: nothing is ignored.
    assert noted(load_scene(write_scene(tmp_path / "lit.xml", card(-10.0) + POINT_LIGHT))) == []


@pytest.mark.parametrize("options", [("--scale", 0.25), ("--fit",), ("--scale", 0.25, "--rotate", "0,30,0")])
def test_a_scene_within_a_studio_is_seen_from_inside(mi, tmp_path, options):
    """The knot stands in a dark sphere of 3.2 m: rays that began outside of it saw black."""
    scenes, out = Path(__file__).parents[2] / "scenes", tmp_path / "knot.exr"
    words = ("render", scenes / "knot/knot.xml", "--display", scenes / "displays/vga-square.toml")
    assert run([*map(str, (*words, *options)), "--samples", "1", "-o", str(out)]) == 0
    assert 0.1 < read_picture(out).radiance.mean() < 0.3


def test_depths_of_a_file_move_with_its_scene():
    own = Placement(scale=2.0, offset_mm=(0.0, 0.0, 5.0), near_mm=25.0, far_mm=-35.0)  # z = 10 and -20 in the scene
    moved = Placement(scale=0.5, rotation_deg=(0.0, 0.0, 40.0), offset_mm=(1.0, 2.0, 3.0)).keeping_depths(own)
    assert (moved.near_mm, moved.far_mm) == pytest.approx((8.0, -7.0), abs=1e-12)
    assert dataclasses.replace(moved, near_mm=9.0, far_mm=None).keeping_depths(own).near_mm == 9.0
    tilted = Placement(rotation_deg=(1.0, 0.0, 0.0)).keeping_depths(own)
    assert (tilted.near_mm, tilted.far_mm) == (None, None)


BAD_VALUES = {
    "rotation_deg": ((0, 0), (0, 0, 0, 0), "012", 5, None, (0, math.nan, 0)),
    "offset_mm": ((1.0,), (0, "1", 0), (0, 0, math.inf), (0, True, 0)),
    "scale": (None, "1", math.nan, 0.0),
    "near_mm": (math.inf, "5"),
    "far_mm": (math.nan, (1, 2, 3)),
}


@pytest.mark.parametrize(("key", "value"), [(key, value) for key, values in BAD_VALUES.items() for value in values])
def test_a_placement_is_checked_when_it_is_made(key, value):
    with pytest.raises(InputError, match=f"(?i)^placement: {key}"):
        Placement(**{key: value})


def test_a_placement_holds_plain_numbers():
    placement = Placement(np.float32(2), list(np.arange(3)), np.arange(3.0), near_mm=np.int64(1))
    assert placement == Placement(2.0, (0.0, 1.0, 2.0), (0.0, 1.0, 2.0), near_mm=1.0)
    assert repr(placement) == repr(Placement(2.0, (0.0, 1.0, 2.0), (0.0, 1.0, 2.0), near_mm=1.0))

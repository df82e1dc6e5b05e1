"""The path of a captured ray: through the pinhole, by exact lenslets, concave ones too, and the imaging lens."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from independent import last_point, surface
from lippmann.capturing.capture import rays_from_picture, system_of
from lippmann.capturing.capture_setup import Camera, Pickup, Setup, Subject, load_setup
from lippmann.capturing.imaging_lens import Face, LensPair, ThinLens, refract_face
from lippmann.engines import trace
from lippmann.optics.backend import DrJitBackend, NumpyBackend
from lippmann.optics.faces import Ray
from lippmann.optics.models import leave_panel
from lippmann.optics.rays import gets_through
from lippmann.optics.trace import trace_to_panel
from optics_cases import display_of
from scene_cases import generator

TOP = Path(__file__).parents[2]
B = NumpyBackend()
OBJECT_MM = 150.0
CAMERA_MM = 900.0

#: Distance and axis of an eye on which the display's elemental images converge.
EYE = {"eye": 80.0, "axis": (3.0, -5.0)}
#: Two pitches and a shear.
SKEWED = {"row_pitch": 1.1, "shear": 0.1}


def setup_of(
    grid="square", side="panel", lens=None, pickup=None, concave=False, rotation=0.0, offset=(0.0, 0.0), **eye
):
    display = display_of(
        grid, side, radius=1.65, thickness=None, gap=4.8, rotation=rotation, offset=offset, width_px=300, height_px=200,
        **eye,
    )  # fmt: skip
    subject = Subject(OBJECT_MM)
    return Setup("case", subject, lens, display, display.array, concave, 0.0, pickup or Camera(CAMERA_MM))


def picture_points(seed, count=400):
    return generator(seed).uniform([20, 20], [280, 180], (count, 2))


def from_array(rays):
    """Origins and directions before the array, z = 0 in its vertices, z towards the object: no lens between."""
    ray = rays.ray
    return np.column_stack([ray.x, ray.y, OBJECT_MM - ray.z]), np.column_stack([ray.dx, ray.dy, -ray.dz])


@pytest.mark.parametrize("eye", [{}, EYE, SKEWED], ids=["far", "near", "skewed"])
@pytest.mark.parametrize("rotation", [0.0, 23.0])
@pytest.mark.parametrize("side", ["panel", "viewer"])
@pytest.mark.parametrize("grid", ["square", "hex"])
def test_traced_back_they_meet_the_pinhole(grid, side, rotation, eye):
    """The other way through the array, by the tracer for rays from the world, onto two panels: the line through both
    hits comes from the pinhole, and goes where the picture says through the first principal plane.
    """
    setup = setup_of(grid, side, rotation=rotation, offset=(0.21, -0.13), **eye)
    points = picture_points(11)
    rays = rays_from_picture(B, setup, *points.T)
    origin, direction = from_array(rays)
    lifted = setup.array.thickness_mm * (1 - 1 / setup.array.index) if side == "panel" else 0.0
    near = setup.array.thickness_mm if side == "panel" else 0.0
    place, depth = [], []
    for gap in (2.0, 7.0):
        display = replace(setup.display, gap_mm=gap, panel=replace(setup.display.panel, width_px=3000, height_px=3000))
        hits = trace_to_panel(display, origin, -direction)
        pitch = display.panel.pixel_pitch_mm
        place.append(np.column_stack([hits.pixel[:, 0] - 1500.0, 1500.0 - hits.pixel[:, 1]]) * pitch)
        depth.append(gap + near)
        arrived = np.isin(hits.status, (0, 4))
    assert np.mean(arrived & np.asarray(rays.through_array)) > 0.9
    slope = (place[1] - place[0]) / (depth[1] - depth[0])
    good = arrived & np.asarray(rays.through_array)
    at_pinhole = place[0] + slope * (CAMERA_MM - depth[0])
    assert np.abs(at_pinhole[good]).max() < 1e-9
    pitch = setup.display.panel.pixel_pitch_mm
    asked = np.column_stack([points[:, 0] - 150.0, 100.0 - points[:, 1]]) * pitch
    if "eye" in eye:
        # The point of the display's panel is seen on the way to the eye.
        glass = setup.array.thickness_mm / setup.array.index if side == "panel" else 0.0
        asked = asked + (np.array(EYE["axis"]) - asked) * (4.8 + glass) / (4.8 + glass + EYE["eye"])
    assert np.abs(place[0] + slope * (lifted - depth[0]) - asked)[good].max() < 1e-9


@pytest.mark.parametrize(("gap", "eye"), [(4.1, {}), (4.8, EYE), (4.1, {**SKEWED, "extent": (12.0, 9.0)})])
def test_a_pickup_is_the_display_s_own_trace(gap, eye):
    """Without a lens a sensor at a gap captures along the rays that a display of that gap sends out."""
    setup = setup_of("hex", pickup=Pickup(gap), rotation=11.0, **eye)
    points = picture_points(12)
    aim = generator(13).uniform(-0.3, 0.3, (len(points), 2))
    for aperture in (None, aim):
        rays = rays_from_picture(B, setup, *points.T, None if aperture is None else tuple(aperture.T))
        expected = trace(replace(setup.display, gap_mm=gap), points, aperture)
        origin, direction = from_array(rays)
        assert origin == pytest.approx(expected.origin_mm, abs=1e-12)
        assert direction == pytest.approx(expected.direction, abs=1e-14)
        assert np.array_equal(rays.through_array, gets_through(expected.status))


@pytest.mark.parametrize("concave", [False, True])
def test_near_its_centre_a_lenslet_obeys_the_lens_equation(concave):
    """Slope c/L - u/v with 1/v = 1/f - 1/L, by hand, for u of a hundredth of the focal length."""
    setup = setup_of(concave=concave)
    pitch = setup.display.panel.pixel_pitch_mm
    focal = -3.3 if concave else 3.3
    to_plane = CAMERA_MM - setup.array.thickness_mm * (1 - 1 / 1.5)
    v = 1.0 / (1.0 / focal - 1.0 / to_plane)
    for centre in (-6.0, 0.0, 4.0):
        u = np.array([-0.03, -0.01, 0.0, 0.02])
        rays = rays_from_picture(B, setup, (centre + u) / pitch + 150.0, 0 * u + 100.0)
        origin, direction = from_array(rays)
        slope = direction[:, 0] / direction[:, 2]
        # Third order: the cube of the slopes.
        assert slope == pytest.approx(centre / to_plane - u / v, abs=2e-5)
        assert origin[:, 0] - origin[:, 2] * slope == pytest.approx(centre + u, abs=2e-5)


def test_concave_lenslets_against_rayoptics():
    """One plano-concave lens, flat side first: centre of curvature on the object's side."""
    setup = setup_of(concave=True)
    system = system_of(setup)
    rng = generator(14)
    aim = rng.uniform(-0.3, 0.3, (100, 2))
    start = aim + rng.uniform(-0.5, 0.5, (100, 2))
    out = leave_panel(B, system, *start.T, tuple(aim.T), "exact")
    own = np.asarray(out.status) == 0
    assert own.sum() > 80
    path = (
        surface(0.0, system.gap_mm, 1.0, "dummy"),
        surface(0.0, system.thickness_mm, 1.5),
        surface(1.0 / 1.65, 0.0, 1.0),
    )
    for k in np.flatnonzero(own):
        direction = np.append(aim[k] - start[k], system.aperture_distance_mm)
        point, direction = last_point(path, np.append(start[k], 0.0), direction / np.linalg.norm(direction))
        ours = np.array([np.asarray(c)[k] for c in out.ray])
        assert ours[:3] == pytest.approx(point, abs=1e-12)
        assert ours[3:] == pytest.approx(direction, abs=1e-12)


def test_concave_seams_keep_every_ray_accounted_for():
    """Rays to the rims: each gets through or is told why not; crosstalk is told too."""
    setup = setup_of("hex", concave=True)
    rng = generator(15)
    aim = rng.uniform(-0.57, 0.57, (4000, 2))
    start = aim + rng.uniform(-3.0, 3.0, (4000, 2))
    out = leave_panel(B, system_of(setup), *start.T, tuple(aim.T), "exact")
    counts = np.bincount(np.asarray(out.status), minlength=5)
    assert np.isfinite(np.array([np.asarray(c) for c in out.ray])).all()
    assert counts[0] > 1000
    assert counts[4] > 10


@pytest.mark.parametrize("name", ["fig8a", "fig8c", "hex", "pickup", "thin", "concave"])
def test_fast_engine_agrees_at_the_object(mi, name):
    """Through the shipped set-ups' lenses to the object a metre away: within half a micrometre, far below a pixel."""
    setup = load_setup(TOP / f"scenes/setups/{name}.toml")
    b = DrJitBackend("llvm")
    panel = setup.display.panel
    points = generator(7, name).random((4000, 2)) * [panel.width_px, panel.height_px]
    golden = rays_from_picture(B, setup, *points.T)
    fast = rays_from_picture(b, setup, *(b.double(c) for c in points.T))
    good = golden.through_array & golden.through_lens
    assert np.array_equal(np.asarray(fast.through_array) & np.asarray(fast.through_lens), good)
    assert good.mean() > 0.5
    met = []
    for ray in (golden.ray, fast.ray):
        x, y, z, dx, dy, dz = (np.asarray(column, np.float64)[good] for column in ray)
        met.append(np.stack([x - z * dx / dz, y - z * dy / dz]))
    assert np.abs(met[1] - met[0]).max() < 5e-4


CONVEX = ("in", "out", "image", "object")
F = 1000.0 * 415.0 / 1415.0


def pair(convex="in", **changes):
    numbers = {"index": 1.5168, "thickness_mm": 58.0, "separation_mm": 1.0, "aperture_mm": 320.0, "convex": convex}
    focal_length_mm = changes.pop("focal_length_mm", F)
    return LensPair(np.inf, **{**numbers, **changes}).with_focal_length(focal_length_mm)


def rays_from(point, aim):
    way = np.column_stack([aim - point[:2], np.full(len(aim), -point[2])])
    way /= np.linalg.norm(way, axis=1)[:, None]
    return Ray(*(np.full(len(aim), c) for c in point), *way.T)


def at_height(ray, z):
    t = (z - ray.z) / ray.dz
    return np.column_stack([ray.x + t * ray.dx, ray.y + t * ray.dy])


@pytest.mark.parametrize("convex", CONVEX)
def test_near_axis_rays_image_41_5_cm_to_100_cm(convex):
    """Points at -415 and height h come together at 1000 from the other principal plane, at height -h / 0.415."""
    lens = pair(convex)
    assert lens.focal_length_mm == pytest.approx(F, rel=1e-12)
    aim = np.array([[0.01, 0.0], [0.0, 0.01], [-0.01, 0.01]])
    for height in (0.0, 0.01):
        ray, through = lens.trace(B, rays_from((height, 0.0, -415.0), aim))
        assert through.all()
        met = at_height(ray, lens.hiatus_mm + 1000.0)
        # Third-order aberration goes with the cube of 0.02 mm / 300 mm.
        assert met == pytest.approx(np.broadcast_to([-height / 0.415, 0.0], (3, 2)), abs=1e-8)


@pytest.mark.parametrize("convex", CONVEX)
def test_focal_length_of_thick_lenses(convex):
    """Gullstrand by hand: each lens F = R / (n - 1), its principal planes at the dome and T/n inside the flat."""
    lens = LensPair(300.0, 1.6, 40.0, 7.0, 100.0, convex)
    inner = {"in": 7.0, "out": 7.0 + 2 * 25.0, "image": 7.0 + 25.0, "object": 7.0 + 25.0}[convex]
    assert 1.0 / lens.focal_length_mm == pytest.approx(2.0 / 500.0 - inner / 500.0**2, rel=1e-12)


def test_principal_planes_of_two_domes_that_touch():
    """Both inner principal planes in one plane: H' there from the image side, so T/n + ... from the flats."""
    lens = LensPair(300.0, 1.5, 30.0, 0.0, 100.0, "in")
    # Each lens: dome plane and a plane T/n = 20 mm inside its flat, 10 mm before the dome. Combined, F = 300: the two
    # outer planes, crossed over: H' 10 mm before the domes, H 10 mm behind.
    assert lens.extent_mm == pytest.approx((-20.0, 40.0))
    assert lens.hiatus_mm == pytest.approx(20.0)


@pytest.mark.parametrize("convex", CONVEX)
def test_against_rayoptics(convex):
    lens = pair(convex)
    rng = generator(515, convex)
    points = np.column_stack([rng.uniform(-60, 60, (60, 2)), rng.uniform(-420, -300, 60)])
    aims = rng.uniform(-90, 90, (60, 2))
    z = [face.z_mm for face in lens.faces]
    faces = [
        surface(face.curvature, distance, face.index_behind)
        for face, distance in zip(lens.faces, [*np.diff(z), 0.0], strict=True)
    ]
    worst = 0.0
    for point, aim in zip(points, aims, strict=True):
        ray, through = lens.trace(B, rays_from(point, aim[None]))
        assert through.all()
        way = np.append(aim - point[:2], -point[2])
        path = [surface(0.0, z[0] - point[2], 1.0, "dummy"), *faces]
        place, direction = last_point(path, np.append(point[:2], 0.0), way / np.linalg.norm(way))
        ours = np.array([c[0] for c in ray])
        worst = max(worst, np.abs(ours[:3] - place - [0, 0, z[-1]]).max(), 1e3 * np.abs(ours[3:] - direction).max())
    print(f"{convex}: at most {worst:.1e} mm, or milliradian")
    assert worst < 1e-11


def test_thin_lens_images_sharply():
    """All rays of a point, at any height, meet in one point: x' = -x 1000 / 415."""
    lens = ThinLens(F, 300.0)
    ray, through = lens.trace(B, rays_from((30.0, -20.0, -415.0), generator(7).uniform(-100, 100, (50, 2))))
    assert through.all()
    met = np.broadcast_to([-30.0 / 0.415, 20.0 / 0.415], (50, 2))
    assert at_height(ray, 1000.0) == pytest.approx(met, rel=1e-12, abs=1e-10)


@pytest.mark.parametrize("lens", [pair(), ThinLens(F, 320.0)], ids=["pair", "thin"])
def test_aperture(lens):
    """Parallel rays: those within the diameter pass, the others are finite and do not."""
    x = np.array([0.0, 159.99, 160.01, -160.01, 250.0, 1000.0])
    zero = 0.0 * x
    ray, through = lens.trace(B, Ray(x, zero, zero - 100.0, zero, zero, zero + 1.0))
    assert through.tolist() == [True, True, False, False, False, False]
    assert np.isfinite(np.array(ray)).all()


def test_total_internal_reflection_and_misses_are_told():
    """Out of glass at 45 degrees with n = 1.5 (critical angle 41.8); a sphere of 10 mm missed by 5."""
    slant = np.sqrt(0.5)
    one = np.array([1.0])
    ray, passed = refract_face(B, Face(0.0, 0.0, 1.5, 1.0), Ray(0 * one, 0 * one, 0 * one, slant, 0 * one, slant), 100)
    assert not passed[0]
    ray, passed = refract_face(B, Face(0.0, 0.1, 1.0, 1.5), Ray(15 * one, 0 * one, 0 * one, 0, 0 * one, one), 100)
    assert not passed[0]
    assert np.isfinite([float(np.squeeze(c)) for c in ray]).all()

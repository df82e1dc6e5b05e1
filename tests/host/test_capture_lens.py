"""The imaging lens: against closed forms, against rayoptics, and what it lets through."""

import numpy as np
import pytest
from independent import last_point, surface
from lippmann.capturing.imaging_lens import Face, LensPair, ThinLens, refract_face
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.faces import Ray
from scene_cases import generator

CONVEX = ("in", "out", "image", "object")
F = 1000.0 * 415.0 / 1415.0
B = NumpyBackend()


def pair(convex="in", **changes):
    numbers = {"index": 1.5168, "thickness_mm": 58.0, "separation_mm": 1.0, "aperture_mm": 320.0, "convex": convex}
    focal_length_mm = changes.pop("focal_length_mm", F)
    return LensPair(np.inf, **{**numbers, **changes}).with_focal_length(focal_length_mm)


def rays_from(point, aim):
    """Rays from one point through points (n, 2) of the plane z = 0."""
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

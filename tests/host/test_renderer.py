"""The renderer: furnaces, golden rays, hand-computed light, Mitsuba's own integrators and sensor."""

import itertools
import math
import subprocess
import sys
import time

import lippmann
import numpy as np
import pytest
from lippmann.base.machine import peak_memory_mb
from lippmann.base.tones import psnr_db
from lippmann.base.variant import current_device
from lippmann.engines import trace
from lippmann.errors import InputError
from lippmann.eye.observer import Eye, observe
from lippmann.optics.backend import DrJitBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import MODELS
from lippmann.optics.sample_points import points_in_pixel, points_in_square, square_to_cell
from lippmann.rendering import renderer
from lippmann.rendering import sampling as sources
from lippmann.rendering.lights import needs_chance
from lippmann.rendering.memory_estimate import BASE_MEMORY_MB, check_memory
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import Renderer, render_integral, render_view
from lippmann.rendering.sampling import Seeds, Window, display_source, sampler_of
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import load_scene
from optics_cases import GRIDS, SIDES, display_of
from scene_cases import (
    centres,
    first_sphere,
    focused_display,
    generator,
    glowing_card,
    glowing_sphere,
    programs_of,
    rgb,
    write_scene,
)
from scipy.spatial.transform import Rotation

SEED = 7301
SKY = '<emitter type="constant"><rgb name="radiance" value="1 1 1"/></emitter>'


def display_for(grid="square", side="panel", **others):
    """A small display with a viewing half-angle of 14 degrees."""
    sizes = {"width_px": 90, "height_px": 70, "pixel_pitch": 0.1} | others
    return focused_display(grid, side, **sizes)


def pixel_centres(display):
    panel = display.panel
    v, u = np.mgrid[0 : panel.height_px, 0 : panel.width_px] + 0.5
    return np.stack([u.ravel(), v.ravel()], axis=1)


def test_another_eye_placement_or_seed_needs_no_compilation(mi, tmp_path):
    """Numbers that a program contained were compiled for every frame of a film, and for every eye."""
    scene = load_scene(write_scene(tmp_path / "s.xml", SKY, glowing_sphere((0.0, 0.0, 0.0), 2.0)), Placement(1.1))
    display = display_for()
    window, panel = Window(8.0, 6.0, 16, 12), np.zeros((display.panel.height_px, display.panel.width_px, 3))

    def work(at, seed):
        placed = scene.placed(Placement(at, (0.0, 10.0 * at, 0.0), (at, 0.0, -at), near_mm=20.0 + at, far_mm=-20.0))
        return {
            "view": programs_of(lambda: render_view(placed, (at, -at, 300.0 * at), window, Settings(2, seed=seed))),
            "image": programs_of(lambda: render_integral(placed, display, "thin", Settings(2, seed=seed))),
            "eye": programs_of(lambda: observe(panel, display, Eye((at, 2.0, 200.0 * at)), window, 2, seed=seed)),
            "lens": programs_of(lambda: observe(panel, display, Eye((at, 2.0, 500.0), at, -at), window, 2, seed=seed)),
        }

    found = work(1.5, 7)
    assert all(found.values())
    assert work(2.5, 8) == found


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("integrator", ["lights", "moment"])
def test_a_picture_without_light_is_black_at_any_size(mi, tmp_path, integrator, samples):
    """`moment` alone computes nothing: the recording of its program kept the size of the first tile."""
    scene = load_scene(write_scene(tmp_path / "s.xml", placement="near_mm = 10.0\nfar_mm = -10.0"))
    view = render_view(
        scene, (0.0, 0.0, 300.0), Window(8.0, 6.0, 96, 72), Settings(samples, integrator=integrator)
    ).radiance
    assert view.shape == (72, 96, 3)
    np.testing.assert_array_equal(view, 0.0)


@pytest.fixture(scope="module")
def sky(mi, tmp_path_factory):
    path = tmp_path_factory.mktemp("sky") / "sky.xml"
    return load_scene(write_scene(path, SKY, placement="near_mm = 10.0\nfar_mm = -10.0"))


@pytest.mark.parametrize("subpixels", ["none", "rgb"])
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("grid", GRIDS)
def test_furnace(mi, sky, grid, model, subpixels):
    display = display_for(grid, subpixels=subpixels)
    rendered = render_integral(sky, display, model, Settings(samples=3))
    assert rendered.radiance.shape == (70, 90, 3)
    assert rendered.radiance.dtype == np.float32
    assert np.abs(rendered.radiance - 1.0).max() <= 1e-5
    assert rendered.samples_traced == 90 * 70 * 3 * (1 if subpixels == "none" else 3)


@pytest.mark.parametrize(("model", "side"), [("thin", "panel"), ("exact", "panel"), ("exact", "viewer")])
@pytest.mark.parametrize("grid", GRIDS)
def test_a_furnace_of_whole_lenslets_loses_what_golden_loses(mi, sky, grid, model, side):
    """Full aperture: rays that totally reflect or are blocked bring no light; all others bring 1."""
    display = display_of(grid, side, radius=0.75, index=1.9, thickness=None, gap=0.6, width_px=16, height_px=12)
    rng = generator(SEED, grid, model, side)
    samples = 1024
    seen = render_integral(sky, display, model, Settings(samples=samples, aperture="full")).radiance[:, :, 0]
    pixels = np.repeat(np.floor(pixel_centres(display)), 400, axis=0) + rng.random((16 * 12 * 400, 2))
    reach = display.array.half_diagonal_mm
    points = rng.uniform(-reach, reach, (len(pixels) * 2, 2))
    points = points[Lattice(grid, 1.0).holds(points[:, 0], points[:, 1])][: len(pixels)]
    pixels = pixels[: len(points)]
    status = lippmann.trace(display, pixels, points, model).status
    share = np.isin(status, (lippmann.Status.OK, lippmann.Status.CROSSTALK)).mean()
    if model == "exact":
        assert share < 0.98
    # 77,000 random rays of golden: a standard error of 0.002.
    assert seen.mean() == pytest.approx(share, abs=0.008)


#: Real and virtual, one before the other, colours told apart.
SPHERES = np.array([(0.5, 0.2, 18.0), (-0.6, 0.1, 6.0), (0.0, -0.4, -15.0), (1.8, 1.2, -30.0), (-2.0, 0.6, -45.0)])
RADII = np.array([1.0, 0.8, 2.5, 3.0, 7.0])
COLOURS = np.array([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1)], float)


@pytest.fixture(scope="module")
def spheres(mi, tmp_path_factory):
    shapes = [glowing_sphere(*sphere) for sphere in zip(SPHERES.tolist(), RADII.tolist(), COLOURS, strict=True)]
    return load_scene(write_scene(tmp_path_factory.mktemp("spheres") / "spheres.xml", *shapes))


def expected_colours(display, model, pixels):
    """The colour that each ray of golden meets first, seen from the viewer; and which are sure in float32."""
    rays = lippmann.trace(display, pixels, None, model)
    which, clear = first_sphere(rays.origin_mm, rays.direction, SPHERES, RADII)
    alive = np.isin(rays.status, (lippmann.Status.OK, lippmann.Status.CROSSTALK))
    colours = np.concatenate([COLOURS, np.zeros((1, 3))])[np.where(alive, which, -1)]
    return colours, clear & alive


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("grid", "side"), list(itertools.product(GRIDS, SIDES)))
def test_each_pixel_shows_the_first_sphere_on_its_ray(mi, spheres, grid, side, model):
    """One sample goes through the pixel's centre; spheres before the display hide those behind it."""
    display = display_for(grid, side, rotation=7.0, offset=(0.23, -0.31))
    seen = render_integral(spheres, display, model, Settings()).radiance.reshape(-1, 3)
    colours, sure = expected_colours(display, model, pixel_centres(display))
    assert sure.mean() > 0.98
    np.testing.assert_array_equal(seen[sure], colours[sure])
    # All five are seen, and nothing at all somewhere.
    assert len(np.unique(colours[sure], axis=0)) == 6


@pytest.mark.parametrize("subpixels", ["rgb", "bgr"])
def test_each_stripe_looks_along_its_own_ray(mi, spheres, subpixels):
    display = display_for(subpixels=subpixels)
    seen = render_integral(spheres, display, "exact", Settings()).radiance.reshape(-1, 3)
    plain = render_integral(spheres, display_for(), "exact", Settings()).radiance.reshape(-1, 3)
    places = dict(zip(subpixels, (-1.0 / 3.0, 0.0, 1.0 / 3.0), strict=True))
    for k, name in enumerate("rgb"):
        colours, sure = expected_colours(display, "exact", pixel_centres(display) + np.array([places[name], 0.0]))
        np.testing.assert_array_equal(seen[sure, k], colours[sure, k])
    assert (seen != plain).any()


def test_more_samples_average_the_pixel(mi, spheres):
    """Against a dense grid of golden's rays in each pixel."""
    display = display_for("hex", width_px=24, height_px=16, offset=(0.1, 0.2))
    seen = render_integral(spheres, display, "exact", Settings(samples=256)).radiance.reshape(-1, 3)
    steps = (np.arange(16) + 0.5) / 16 - 0.5
    total = np.zeros_like(seen, dtype=float)
    for dx, dy in itertools.product(steps, steps):
        total += expected_colours(display, "exact", pixel_centres(display) + np.array([dx, dy]))[0] / 256
    # An outline through a pixel: 256 points of either pattern find the area to about 1 / 64.
    assert np.abs(seen - total).max() < 0.05
    assert np.abs(seen.mean(axis=0) - total.mean(axis=0)).max() < 0.002


def test_the_times_of_a_render_are_parts_of_the_whole(mi, spheres):
    began, cpu = time.perf_counter(), time.process_time()
    rendered = render_integral(spheres, display_for("hex", width_px=24, height_px=16), "exact", Settings())
    whole, cpu = time.perf_counter() - began, time.process_time() - cpu
    assert rendered.prepare_seconds > 0.0
    assert rendered.seconds > 0.0
    assert rendered.prepare_seconds + rendered.seconds < whole
    assert 0.0 <= rendered.cpu_seconds <= cpu
    assert rendered.measured["samples_per_second"] == pytest.approx(24 * 16 / rendered.seconds)


def edge_error(points, rng, edges=4000):
    """Root mean square error of the share of the unit square beyond straight edges through it; points (edges, N, 2)."""
    net = np.stack(np.meshgrid(*[(np.arange(64) + 0.5) / 64] * 2), axis=-1).reshape(-1, 2)
    place, angle = rng.random((edges, 1, 2)), rng.uniform(0.0, math.tau, edges)
    across = np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, :, None]
    found, wanted = (((some - place) @ across > 0.0).mean(axis=(1, 2)) for some in (points, net[None]))
    return math.sqrt(np.mean((found - wanted) ** 2))


@pytest.mark.parametrize("samples", [1, 2, 5, 16])
def test_places_in_a_pixel(mi, samples):
    """The golden steps in exact arithmetic, mirrored and exchanged in all eight ways; a random shift errs more."""
    import drjit as dr

    pixels, golden = 400, (math.isqrt(5 << 128) - (1 << 64)) / (1 << 65)
    c = np.arange(samples) - (samples - 1) / 2
    u, v = 0.5 + c / samples, (0.5 + c * golden) % 1.0
    index = dr.arange(mi.UInt32, pixels * samples)
    s, t = points_in_pixel(index // samples, index % samples, samples, 3)
    points = np.stack([np.broadcast_to(np.array(w), pixels * samples) for w in (s, t)], axis=-1)
    points = points.reshape(pixels, samples, 2)
    ways = [
        np.stack(pair[::turn], axis=-1) for pair in itertools.product((u, 1.0 - u), (v, 1.0 - v)) for turn in (1, -1)
    ]
    far = np.array([np.abs(points - way).max(axis=(1, 2)) for way in ways])
    assert far.min(axis=0).max() < 1e-6
    assert points.min() >= 0.0
    assert points.max() < 1.0
    if samples == 1:
        return
    counts = (far < 1e-6).sum(axis=1)
    assert counts.min() > 25  # of 400 each of the eight ways has 50, some are the same
    rng = generator(11, samples)
    shifted = (points + rng.random((pixels, 1, 2))) % 1.0
    s, t = points_in_square(index // samples, index % samples, 3, stream=0)
    sequence = np.stack([np.array(s), np.array(t)], axis=-1).reshape(pixels, samples, 2)
    ours, theirs, r2 = (edge_error(np.tile(some, (10, 1, 1)), rng) for some in (points, shifted, sequence))
    print(samples, ours, theirs, r2)
    assert 1.05 < theirs / ours < 1.45
    assert 0.55 < ours / r2 < 0.85


def test_passes_of_a_picture_fill_its_pixels(mi):
    """The mean of 16 passes of 4 samples errs less at an edge than that of independent ones would."""
    import drjit as dr

    pixels, passes = 400, 16
    index = dr.arange(mi.UInt32, 4 * pixels)
    found = [points_in_pixel(index // 4, index % 4, 4, 3, mi.UInt32(number)) for number in range(passes)]
    points = np.array([[np.array(w) for w in pair] for pair in found])  # (passes, axes, 4 x pixels)
    points = points.reshape(passes, 2, pixels, 4).transpose(2, 0, 3, 1)
    # Each 64th part of one side has one place: those of a pass are a quarter apart.
    for at in points[:, :, 0, :].reshape(pixels, passes, 2)[:5]:
        assert min(np.diff(np.sort(at[:, axis])).min() for axis in (0, 1)) > 0.005
    rng = generator(12)
    one, every = (edge_error(np.tile(some.reshape(pixels, -1, 2), (10, 1, 1)), rng) for some in (points[:, :1], points))
    print(one, every)
    assert every < one / math.sqrt(passes)


def test_neighbouring_pixels_have_independent_places(mi):
    """Shifts of neighbours by a hash of four rounds are correlated for some seeds: by 0.11 for the seed 50.

    Independent shifts of 2^16 pixels are correlated by 0.004 (one standard deviation); 5 of them are allowed.
    """
    pixels = mi.UInt32(np.arange(1 << 16, dtype=np.uint32))
    for seed, stream in itertools.product(range(45, 55), (0, 1)):
        for shifts in map(np.array, points_in_square(pixels, mi.UInt32(0), seed, stream)):
            for step in (1, 2, 96):
                assert abs(np.corrcoef(shifts[:-step], shifts[step:])[0, 1]) < 0.02, (seed, stream, step)


def test_samples_spread_evenly(mi):
    """Points stay in the square and in the cell; equal areas get equal numbers."""
    import drjit as dr

    n = 4096
    index = dr.arange(mi.UInt32, n)
    for seed, stream in ((0, 0), (0, 1), (77, 0)):
        s, t = points_in_square(mi.UInt32(5), index, seed, stream)
        s, t = np.array(s), np.array(t)
        assert min(s.min(), t.min()) >= 0.0
        assert max(s.max(), t.max()) < 1.0
        counts, *_ = np.histogram2d(s, t, bins=16, range=[[0, 1], [0, 1]])
        # 16 in each of 256 boxes; random points would scatter by 4.
        assert counts.std() < 2.0
        for grid in GRIDS:
            b = DrJitBackend(current_device())
            cell = square_to_cell(b, mi.Float(s), mi.Float(t), Lattice(grid, 2.0))
            x, y = (np.array(c) for c in cell)
            inside = Lattice(grid, 2.0 * (1.0 + 1e-6)).holds(x, y)
            assert inside.all()
            # Second moments of a square and of a hexagon about their axes: a^2/12, and 5/24 of the side^2.
            moment = 4.0 / 12.0 if grid == "square" else 5.0 / 24.0 * (4.0 / 3.0)
            for w in (x, y):
                assert w.mean() == pytest.approx(0.0, abs=0.01)
                assert (w * w).mean() == pytest.approx(moment, rel=0.01)
            # Skewed: the same points, brought to the lattice.
            skewed = square_to_cell(b, mi.Float(s), mi.Float(t), Lattice(grid, (2.0, 3.0), shear=0.25))
            np.testing.assert_allclose(skewed[1], 1.5 * y, atol=1e-6)
            np.testing.assert_allclose(skewed[0], x + 0.25 * 1.5 * y, atol=1e-6)


@pytest.fixture(scope="module")
def lit(mi, tmp_path_factory):
    parts = [
        '<shape type="rectangle"><transform name="to_world"><scale value="40"/><translate z="-20"/></transform>'
        f'<bsdf type="diffuse">{rgb("reflectance", (0.5, 0.5, 0.5))}</bsdf></shape>',
        '<shape type="sphere"><point name="center" x="1" y="1" z="-5"/><float name="radius" value="3"/>'
        f'<bsdf type="roughplastic">{rgb("diffuse_reflectance", (0.6, 0.2, 0.1))}</bsdf></shape>',
        glowing_sphere((15.0, 25.0, 60.0), 6.0, (40.0, 30.0, 20.0)),
    ]
    path = tmp_path_factory.mktemp("lit") / "lit.xml"
    return load_scene(write_scene(path, *parts, placement="near_mm = 20.0\nfar_mm = -20.0"))


@pytest.mark.usefixtures("four_threads")
@pytest.mark.parametrize("integrator", ["path", "direct", "lights"])
def test_equal_seeds_repeat_bit_for_bit(mi, lit, integrator):
    display = display_for()
    pictures = [
        render_integral(lit, display, "exact", Settings(2, integrator=integrator, seed=seed)).radiance
        for seed in (5, 5, 6)
    ]
    assert pictures[0].max() > 0.01
    np.testing.assert_array_equal(pictures[0], pictures[1])
    assert (pictures[0] != pictures[2]).mean() > 0.3


@pytest.mark.parametrize(("shading", "parts"), [("each", 1), ("shared", renderer.CACHE_CHUNK_DIVISOR)])
@pytest.mark.parametrize("samples", [1, 4])
def test_pictures_of_point_lights_do_not_depend_on_chunks(mi, points, samples, shading, parts, monkeypatch):
    display = display_for("hex", subpixels="rgb")
    settings = Settings(samples, seed=9, shading=shading)
    whole = render_integral(points, display, "exact", settings).radiance
    # 12 x 9 tiles of 8 x 8 pixels. With 25 at most, 8 would be left: five equal chunks. With 35, 3: no fourth chunk.
    for most, ends in ((25, (22, 44, 66, 88, 108)), (35, (36, 72, 108))):
        done = []
        monkeypatch.setitem(renderer.CHUNK_SAMPLES, current_device(), 64 * most * 3 * samples * parts)
        pieces = render_integral(points, display, "exact", settings, lambda k, n, done=done: done.append((k, n)))
        np.testing.assert_array_equal(whole, pieces.radiance)
        assert done == [(70 * end // 108, 70) for end in ends]


@pytest.mark.parametrize("integrator", ["path", "direct", "lights"])
def test_random_pictures_do_not_depend_on_chunks_and_bands(mi, lit, integrator, monkeypatch):
    display = display_for("hex", subpixels="rgb")
    settings = Settings(2, integrator=integrator, seed=SEED)
    whole = render_integral(lit, display, "exact", settings).radiance
    monkeypatch.setitem(renderer.CHUNK_SAMPLES, current_device(), 64 * 31 * 3 * 2)
    np.testing.assert_array_equal(render_integral(lit, display, "exact", settings).radiance, whole)
    height = display.panel.height_px
    bands = [range(first, min(first + 16, height)) for first in range(0, height, 16)]
    made = Renderer(lit, display_source(display, "exact", 2), settings, bands)
    for number in reversed(range(len(bands))):
        np.testing.assert_array_equal(made.render(number)[0], whole[bands[number].start : bands[number].stop])


def test_random_numbers_of_samples(mi):
    """Uniform, and alike in nothing: neighbouring pixels, samples, seeds, and one number and the next."""
    import drjit as dr

    pixels, samples = 4096, 16
    index = dr.arange(mi.UInt32, pixels * samples)

    def numbers(seed, number=0):
        sampler = sampler_of(Seeds(mi.UInt32(seed), mi.UInt32(number)), index // samples, index % samples)
        drawn = [sampler.next_1d(), *sampler.next_2d(), sampler.next_1d()]
        return np.array(drawn, np.float64).reshape(4, pixels, samples)

    found = numbers(SEED)
    assert found.min() >= 0.0
    assert found.max() < 1.0
    counts = np.histogram(found, 256, (0.0, 1.0))[0]
    expected = found.size / 256
    # 255 degrees of freedom: mean 255, standard deviation 22.6; six of them.
    assert ((counts - expected) ** 2 / expected).sum() < 255 + 6 * 22.6
    others = {
        "pixels": (found[:, 1:], found[:, :-1]),
        "samples": (found[:, :, 1:], found[:, :, :-1]),
        "next": (found[1:], found[:-1]),
        "seeds": (found, numbers(SEED ^ 1)),
        "passes": (found, numbers(SEED, 1)),
    }
    for name, (a, b) in others.items():
        correlation = np.corrcoef(a.ravel(), b.ravel())[0, 1]
        assert abs(correlation) < 6.0 / np.sqrt(a.size), name
    np.testing.assert_array_equal(found, numbers(SEED))


FLOOR_Z = -10.0
ALBEDO = np.array((0.6, 0.4, 0.2))
LIGHTS = {(30.0, 5.0, 40.0): (9000.0, 8000.0, 7000.0), (-25.0, -20.0, 60.0): (3000.0, 9000.0, 1000.0)}
#: Centre and half side of a square that stands parallel to the floor in the first light's way, beside the eye's view.
SCREEN, SCREEN_HALF = (20.0, 3.0, 20.0), 1.5
SUN, SUN_WAY = (0.5, 0.25, 0.125), np.array((0.6, 0.0, -0.8))
EYE = (0.0, 0.0, 600.0)
VIEW = Window(16.0, 12.0, 64, 48)


@pytest.fixture(scope="module")
def points(mi, tmp_path_factory):
    parts = [
        '<shape type="rectangle"><transform name="to_world"><scale value="30"/>'
        f'<translate z="{FLOOR_Z}"/></transform><bsdf type="diffuse">{rgb("reflectance", ALBEDO)}</bsdf></shape>',
        f'<shape type="rectangle"><transform name="to_world"><scale value="{SCREEN_HALF}"/>'
        f'<translate x="{SCREEN[0]}" y="{SCREEN[1]}" z="{SCREEN[2]}"/></transform>'
        f'<bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>',
        f'<emitter type="directional"><vector name="direction" x="{SUN_WAY[0]}" y="{SUN_WAY[1]}" z="{SUN_WAY[2]}"/>'
        f"{rgb('irradiance', SUN)}</emitter>",
    ]
    for (x, y, z), intensity in LIGHTS.items():
        parts.append(
            f'<emitter type="point"><point name="position" x="{x}" y="{y}" z="{z}"/>'
            f"{rgb('intensity', intensity)}</emitter>"
        )
    return load_scene(write_scene(tmp_path_factory.mktemp("points") / "points.xml", *parts))


def test_light_of_points_by_hand(mi, points):
    """Lambert: radiance = albedo / pi * sum of I cos / r^2 over the lights that are seen, and E cos of the sun."""
    seen = render_view(points, EYE, VIEW, Settings()).radiance
    x, y = centres(VIEW)
    reach = (EYE[2] - FLOOR_Z) / EYE[2]
    floor = np.stack([x * reach, y * reach, np.full_like(x, FLOOR_Z)], axis=2)

    def shadowed(way, to_light):
        """Whether the line towards a light crosses the screen, and how far that is from its edges."""
        at = floor + way * ((SCREEN[2] - FLOOR_Z) / way[..., 2:])
        side = np.abs(at[..., :2] - SCREEN[:2]).max(axis=2) - SCREEN_HALF
        return (side < 0.0) & to_light, np.abs(side)

    irradiance = np.zeros((*x.shape, 3))
    sure = np.ones_like(x, bool)
    dark = 0
    for light, intensity in LIGHTS.items():
        way = np.array(light) - floor
        r = np.linalg.norm(way, axis=2)
        shadow, edge = shadowed(way, light[2] > SCREEN[2])
        sure &= edge > 0.01
        dark += shadow.sum()
        irradiance += np.where(shadow[..., None], 0.0, np.array(intensity) * (way[..., 2] / r**3)[..., None])
    shadow, edge = shadowed(np.broadcast_to(-SUN_WAY, floor.shape), True)
    sure &= edge > 0.01
    irradiance += np.where(shadow[..., None], 0.0, np.array(SUN) * -SUN_WAY[2])
    assert 100 < dark < 0.5 * x.size
    assert sure.mean() > 0.95
    np.testing.assert_allclose(seen[sure], (ALBEDO / math.pi * irradiance)[sure], rtol=2e-5)


@pytest.mark.parametrize("name", ["fish/fish", "chart/chart", "knot/knot", "seed/full"])
def test_who_needs_chance_has_noise_and_who_does_not_has_none(mi, request, name):
    """A rough eye's view by two seeds."""
    scene = load_scene(request.config.rootpath / f"scenes/{name}.xml")
    far, near = scene.depth_range_mm
    assert far < 0.0 < near
    window = Window(100.0, 100.0, 64, 64)
    one, other = (render_view(scene, EYE, window, Settings(seed=seed)).radiance for seed in (1, 2))
    assert needs_chance(scene.mitsuba) == bool((one != other).any())


@pytest.mark.parametrize("name", ["points", "lit"])
def test_against_the_mean_of_mitsubas_direct(mi, name, request):
    """Both estimate the same: emitters, and their light after one reflection."""
    scene = request.getfixturevalue(name)
    window = Window(12.0, 10.0, 24, 20)
    samples = 2048
    ours = render_view(scene, EYE, window, Settings(samples, seed=1)).radiance
    theirs = render_view(scene, EYE, window, Settings(samples, seed=1, integrator="direct")).radiance
    assert ours.mean() > 0.05
    # Noise of `direct`: about the light itself at one sample, so 1 / sqrt(2048) = 2 % in a pixel, 0.1 % in the mean.
    relative = (ours - theirs) / ours.mean(axis=(0, 1))
    assert np.abs(relative.mean(axis=(0, 1))).max() < 0.005
    assert relative.std() < 0.03


def mirror(half: float, origin: str, target: str, share: float) -> str:
    return (
        f'<shape type="rectangle"><transform name="to_world"><scale value="{half}"/>'
        f'<lookat origin="{origin}" target="{target}" up="0, 1, 0"/></transform>'
        f'<bsdf type="conductor"><string name="material" value="none"/>'
        f"{rgb('specular_reflectance', (share, share, share))}</bsdf></shape>"
    )


def test_mirrors_are_followed_to_the_depth_allowed(mi, tmp_path):
    """A corner of two mirrors sends every ray back after two reflections: seen with three surfaces, at 0.5 x 0.25."""
    path = write_scene(
        tmp_path / "corner.xml",
        mirror(20.0, "-10, 0, -20", "0, 0, -10", 0.5),
        mirror(20.0, "10, 0, -20", "0, 0, -10", 0.25),
        SKY,
        placement="near_mm = 10.0\nfar_mm = -60.0",
    )
    scene = load_scene(path)
    window = Window(8.0, 8.0, 16, 16)
    # CUDA's quick square roots and quotients, in Mitsuba's Fresnel formula.
    rounding = 1e-5 if current_device() == "llvm" else 1e-3
    for integrator, depth in itertools.product(("lights", "path"), (2, 3)):
        seen = render_view(scene, EYE, window, Settings(integrator=integrator, max_depth=depth)).radiance
        np.testing.assert_allclose(seen, 0.125 if depth >= 3 else 0.0, rtol=rounding)


def test_mirrors_and_diffuse_surfaces_have_no_noise(mi, tmp_path):
    """A diffuse floor seen in a mirror, lit by a point: the light by hand, the same for every seed."""
    floor_z, mirror_z = 30.0, -20.0
    path = write_scene(
        tmp_path / "mirror.xml",
        mirror(200.0, f"0, 0, {mirror_z}", "0, 0, 0", 0.5),
        # Faces the mirror, off the eye's own way.
        f'<shape type="rectangle"><transform name="to_world"><scale value="100"/><rotate y="1" angle="180"/>'
        f'<translate x="-105" z="{floor_z}"/></transform>'
        f'<bsdf type="diffuse">{rgb("reflectance", ALBEDO)}</bsdf></shape>',
        f'<emitter type="point"><point name="position" x="-20" y="0" z="-10"/>'
        f"{rgb('intensity', (1e3, 1e3, 1e3))}</emitter>",
        placement="near_mm = 100.0\nfar_mm = -60.0",
    )
    scene = load_scene(path)
    eye, window = (200.0, 0.0, 600.0), Window(10.0, 10.0, 20, 20)
    seen = [render_view(scene, eye, window, Settings(seed=s)).radiance for s in (1, 2)]
    np.testing.assert_array_equal(*seen)
    x, y = centres(window)
    # The mirror image of the floor stands at 2 mirror_z - floor_z.
    reach = (eye[2] - (2 * mirror_z - floor_z)) / eye[2]
    hit = np.stack([eye[0] + (x - eye[0]) * reach, y * reach, np.full_like(x, floor_z)], axis=2)
    assert hit[..., 0].max() < -5.0
    way = np.array((-20.0, 0.0, -10.0)) - hit
    r = np.linalg.norm(way, axis=2)
    expected = 0.5 * ALBEDO / math.pi * (1e3 * -way[..., 2] / r**3)[..., None]
    # The mirror lights the floor too, but no integrator that stops at the light's shadow ray sees that.
    np.testing.assert_allclose(seen[0], expected, rtol=5e-5)


@pytest.mark.parametrize("case", range(3))
def test_a_placed_scene_looks_like_the_same_scene_written_in_place(mi, spheres, tmp_path, case):
    rng = generator(SEED, "placement", case)
    scale = float(10.0 ** rng.uniform(-2.0, 2.0))
    angles = rng.uniform(-180.0, 180.0, 3)
    offset = rng.uniform(-20.0, 20.0, 3)
    # Turns about the fixed axes x, then y, then z.
    turn = Rotation.from_euler("xyz", angles, degrees=True)
    moved = turn.inv().apply((SPHERES - offset) / scale)
    shapes = [glowing_sphere(*sphere) for sphere in zip(moved.tolist(), (RADII / scale).tolist(), COLOURS, strict=True)]
    placement = f"""scale = {scale!r}
rotation_deg = {angles.tolist()}
offset_mm = {offset.tolist()}"""
    scene = load_scene(write_scene(tmp_path / "moved.xml", *shapes, placement=placement))
    display = display_for("hex")
    seen = render_integral(scene, display, "exact", Settings()).radiance.reshape(-1, 3)
    colours, sure = expected_colours(display, "exact", pixel_centres(display))
    np.testing.assert_allclose(seen[sure], colours[sure], atol=1e-6)
    # Without near and far in the file the depths come from the turned bounding box: they hold all spheres.
    far, near = scene.depth_range_mm
    assert near >= (SPHERES[:, 2] + RADII).max()
    assert far <= (SPHERES[:, 2] - RADII).min()


def test_what_does_not_fit_in_memory_is_refused(mi, spheres):
    """The picture three times in float32, RGB: 3 x 12 bytes a pixel on top of the base."""
    pixels = 7680 * 4320
    needed = BASE_MEMORY_MB + 36e-6 * pixels
    check_memory(7680, 4320, Settings(memory_mb=needed + 1.0), colours=1)
    with pytest.raises(InputError, match=r"7680 x 4320.*MB.*raise memory_mb"):
        check_memory(7680, 4320, Settings(memory_mb=needed - 1.0), colours=1)
    for limit in (math.nan, -1.0, 0.0, 100.0):
        with pytest.raises(InputError, match="memory"):
            render_integral(spheres, display_for(), "exact", Settings(memory_mb=limit))


def test_memory_of_all_colours_is_refused_before_the_scene_is_loaded(mi):
    """A tile of 65,536 samples of three colours: 80 bytes for each ray above 2^22."""
    striped = focused_display("square", subpixels="rgb", width_px=32, height_px=32)
    needed = BASE_MEMORY_MB + 36e-6 * 32 * 32 + 80e-6 * (64 * 3 * 65536 - 2**22)
    with pytest.raises(InputError, match=f"needs {math.ceil(needed)} MB, the limit is 900 MB"):
        lippmann.render("missing.obj", striped, samples=65536, memory_mb=900.0)


def test_peak_memory_is_the_process_s_own():
    """Not that of who started it, which its resource usage begins with; and the most there was, not what is left."""
    code = "import numpy as np; from lippmann.base.machine import peak_memory_mb; "
    peaks = []
    large = np.ones(75_000_000)  # 600 MB
    for filled in ("", "np.ones(25_000_000); "):  # 200 MB, given back at once
        command = [sys.executable, "-c", f"{code}{filled}print(peak_memory_mb())"]
        peaks.append(float(subprocess.run(command, check=True, capture_output=True, text=True).stdout))
    assert peak_memory_mb() > large.nbytes / 1e6
    assert peaks[0] < 300.0
    assert peaks[1] - peaks[0] == pytest.approx(200.0, abs=20.0)


def test_the_scenes_own_integrator(mi, tmp_path):
    own = '<integrator type="path"><integer name="max_depth" value="1"/></integrator>'
    scene = load_scene(write_scene(tmp_path / "own.xml", glowing_card("wall", -10.0, (1, 1, 1), 50.0), own))
    seen = render_integral(scene, display_for(), "exact", Settings(integrator="scene")).radiance
    np.testing.assert_allclose(seen, 1.0, rtol=1e-6)


def test_a_view_leaves_out_what_stands_behind_the_eye(mi, tmp_path):
    """A wall at z = 100 hides all from 600 mm; an eye at 50 mm, in front of it, sees the ball at z = -20."""
    text = glowing_sphere((0.0, 0.0, -20.0), 8.0) + glowing_card("wall", 100.0, (0.0, 0.0, 0.5), 200.0)
    scene = load_scene(write_scene(tmp_path / "behind.xml", text))
    window = Window(4.0, 4.0, 5, 5)
    far = render_view(scene, EYE, window, Settings()).radiance
    near = render_view(scene, (0.0, 0.0, 50.0), window, Settings()).radiance
    np.testing.assert_allclose(far, np.broadcast_to([0.0, 0.0, 0.5], far.shape), atol=1e-6)
    np.testing.assert_allclose(near, np.ones_like(near), atol=1e-6)


@pytest.mark.parametrize(
    ("grid", "engine", "fraction_bits"),
    [
        ("square", "golden", None),
        ("hex", "golden", None),
        ("hex", "twin", 23),
        pytest.param("square", "rtl", 23, marks=pytest.mark.full),
        ("hex", "rtl", 16),
    ],
)
def test_pictures_by_the_rays_of_each_engine(mi, tmp_path, monkeypatch, grid, engine, fraction_bits):
    asked = []
    monkeypatch.setattr(sources, "trace", lambda *a, **k: asked.append((a[4], *k.values())) or trace(*a, **k))
    scene = load_scene(write_scene(tmp_path / "ball.xml", glowing_sphere((0.3, -0.2, -6.0), 2.5)))
    display = display_for(grid)
    options = {"engine": engine, "fraction_bits": fraction_bits}
    picture = render_integral(scene, display, "exact", Settings(), **options).radiance[..., 0]
    assert set(asked) == {(engine, fraction_bits)}
    for who, bits in ((engine, fraction_bits), ("golden", None)):
        rays = trace(display, pixel_centres(display), engine=who, fraction_bits=bits)
        sphere, clear = first_sphere(rays.origin_mm, rays.direction, np.array([[0.3, -0.2, -6.0]]), np.array([2.5]))
        assert clear.mean() > 0.99
        np.testing.assert_array_equal(picture.ravel()[clear], sphere[clear] == 0)


@pytest.mark.parametrize(("grid", "subpixels"), [("square", "none"), ("hex", "rgb")])
def test_engines_but_the_fast_one_have_the_same_places_in_a_pixel(mi, spheres, monkeypatch, grid, subpixels):
    """Sixteenths of a pixel, spread over all of it: the picture by fixed point is that by golden's rays."""
    asked = []
    monkeypatch.setattr(sources, "trace", lambda *a, **k: asked.append(a[1]) or trace(*a, **k))
    display = display_for(grid, subpixels=subpixels, offset=(0.13, -0.21))
    settings = Settings(samples=4)
    by = {e: render_integral(spheres, display, "exact", settings, engine=e).radiance for e in ("golden", "twin")}
    places = 16.0 * np.concatenate(asked)
    np.testing.assert_array_equal(places, np.rint(places))
    counts = np.bincount((places % 16).astype(int).ravel(), minlength=16)
    if subpixels == "none":
        # 1/8, 3/8, 5/8, 7/8 along a side; along the other 0.573, 0.191, 0.809, 0.427 and their mirror images.
        np.testing.assert_array_equal(np.flatnonzero(counts), [2, 3, 6, 7, 9, 10, 13, 14])
        assert len(set(counts[counts > 0])) == 1
    quarters = counts.reshape(4, 4).sum(axis=1)
    assert quarters.min() > 0.7 * quarters.mean()
    assert psnr_db(by["golden"], by["twin"]) >= 50.0
    fast = render_integral(spheres, display, "exact", settings).radiance
    # Other places: the mean is the same, to what those at outlines leave of it.
    np.testing.assert_allclose(fast.mean(axis=(0, 1)), by["golden"].mean(axis=(0, 1)), atol=0.003)

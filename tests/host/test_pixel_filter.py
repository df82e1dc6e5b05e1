"""The pixels' filter: against sums written out, and by what it is for."""

import math

import drjit as dr
import numpy as np
import pytest
from lippmann.base.variant import current_device, mitsuba
from lippmann.capturing.capture import capture_source
from lippmann.capturing.capture_setup import load_setup
from lippmann.optics.backend import DrJitBackend
from lippmann.optics.sample_points import points_in_pixel
from lippmann.rendering.options import Settings
from lippmann.rendering.pixel_filter import MAX_SAMPLES, PixelFilter, is_filtered, softness
from lippmann.rendering.renderer import Renderer, render_rays
from lippmann.rendering.sampling import Lines, RaySource, Seeds, Window, display_source, eye_source
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import scene_of
from lippmann.simulation.toolchain import repository
from scene_cases import focused_display, generator

WIDTH, HEIGHT = 40, 150


def source_of(owner):
    return RaySource(WIDTH, HEIGHT, lambda *_: None, owner=owner)


def places_of(mi, samples, seed=3, number=0):
    """The places of all samples in their pixels, (2, pixels, samples)."""
    pixel = np.repeat(np.arange(WIDTH * HEIGHT), samples)
    sample = np.tile(np.arange(samples), WIDTH * HEIGHT)
    x, y = points_in_pixel(mi.UInt32(pixel), mi.UInt32(sample), samples, seed, number)
    return np.array([np.array(x), np.array(y)]).reshape(2, -1, samples)


def filtered(mi, colours, owner, seed=3):
    """The picture (HEIGHT, WIDTH, 3) of samples' colours (pixels, samples, 3), given in two pieces."""
    samples = colours.shape[1]
    made = PixelFilter(source_of(owner), samples, range(HEIGHT))
    half = WIDTH * HEIGHT // 3
    for pixels in (np.arange(half, WIDTH * HEIGHT), np.arange(half)):
        flat = colours[pixels].reshape(-1, 3).T.astype(np.float32)
        seeds = Seeds(mi.UInt32(seed), mi.UInt32(0))
        made.add(mi.Color3f(*flat), mi.UInt32(pixels), mi.Bool(True), seeds)
    return np.stack([np.array(plane) for plane in made.colours()], axis=-1).reshape(HEIGHT, WIDTH, 3)


def number_of(mi):
    """Owners seven pixels wide and eleven high."""

    def owner(b, u, v):
        return mi.UInt32(mi.Int32(b.floor(u / 7.0))) * 0x10001 + mi.UInt32(mi.Int32(b.floor(v / 11.0)))

    return owner


def owners(source, v):
    u = dr.arange(mitsuba().Float64, source.width_px) + 0.5
    return np.broadcast_to(np.array(source.owner(DrJitBackend(current_device()), u, 0.0 * u + v)), source.width_px)


@pytest.mark.parametrize("samples", [2, 3, 4])
def test_sums_written_out(mi, samples):
    """Pixel by pixel, from the formula on the module's first lines."""
    rng = generator(1)
    colours = rng.uniform(0.0, 2.0, (WIDTH * HEIGHT, samples, 3))
    x, y = places_of(mi, samples) - 0.5
    s = softness(samples)

    def f(d):
        return min(1.0, max(0.0, (0.5 + s - abs(d)) / (2.0 * s)))

    picture = filtered(mi, colours, number_of(mi))
    for row, column in [*rng.integers(0, [HEIGHT, WIDTH], (300, 2)).tolist(), [63, 9], [64, 9], [0, 0], [149, 39]]:
        total, sum_ = 0.0, np.zeros(3)
        for dx, dy in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
            i, j = column + dx, row + dy
            if not (0 <= i < WIDTH and 0 <= j < HEIGHT and j // 64 == row // 64):
                continue
            if (i // 7, j // 11) != (column // 7, row // 11):
                continue
            for k in range(samples):
                own = j * WIDTH + i
                weight = f(x[own, k] + dx) * f(y[own, k] + dy)
                total, sum_ = total + weight, sum_ + weight * colours[own, k]
        np.testing.assert_allclose(picture[row, column], sum_ / total, rtol=1e-5)


@pytest.mark.parametrize(("samples", "most"), [(2, 0.86), (4, 0.91)])
def test_straight_edges_are_nearer_to_the_truth(mi, samples, most):
    """Of half planes in all directions.

    The bounds are a twentieth above what block kriging gives, where two points' difference grows with their distance,
    as for lines anywhere: 0.82, 0.83 and 0.87 of the means' error.
    """
    row, column = np.divmod(np.arange(WIDTH * HEIGHT), WIDTH)
    x, y = places_of(mi, samples) + np.stack([column, row])[..., None]
    fine = (np.arange(32) + 0.5) / 32
    fx, fy = (column[:, None, None] + fine[None, None]), (row[:, None, None] + fine[None, :, None])
    errors = []
    rng = generator(3)
    for _ in range(24):
        angle, away = rng.uniform(0.0, math.tau), rng.uniform(-8.0, 8.0)
        a, b = math.cos(angle), math.sin(angle)

        def inside(x, y, a=a, b=b, away=away):
            return (a * (x - WIDTH / 2) + b * (y - HEIGHT / 2) < away).astype(np.float32)

        truth, found = inside(fx, fy).mean(axis=(1, 2)), inside(x, y)
        picture = filtered(mi, np.repeat(found[..., None], 3, axis=2), lambda b, u, v: mi.UInt32(0))
        errors.append([np.square(picture[..., 0].ravel() - truth).sum(), np.square(found.mean(axis=1) - truth).sum()])
    soft, plain = np.sqrt(np.sum(errors, axis=0))
    assert soft < most * plain


def test_an_infinite_sample_stays_where_it_counts(mi):
    """A pixel that is given none of it keeps its own colour."""
    colours = np.ones((WIDTH * HEIGHT, 4, 3))
    middle = 75 * WIDTH + 20
    colours[middle] = np.inf
    picture = filtered(mi, colours, lambda b, u, v: mi.UInt32(0)).reshape(-1, 3)
    assert not np.isnan(picture).any()
    touched = np.flatnonzero(np.isinf(picture[:, 0]))
    assert set(touched) <= {middle, middle - 1, middle + 1, middle - WIDTH, middle + WIDTH}
    assert middle in touched
    # One sample is near no more than one side along each axis, at least one is a quarter of a pixel from all.
    colours[middle, 1:] = 1.0
    assert len(np.flatnonzero(np.isinf(filtered(mi, colours, lambda b, u, v: mi.UInt32(0))[..., 0]))) <= 3


def slanted(mi):
    """A slanted plane, and a source that looks straight at it: a depth is a linear function of the place."""
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], 35.0).rotate([1, 0, 0], 20.0).scale([900.0, 900.0, 1.0])
    card = {"type": "rectangle", "to_world": turn, "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse"}}}
    scene = scene_of({"type": "scene", "card": card}, Placement(near_mm=100.0, far_mm=-100.0))

    def lines(b, u, v, square):
        x, y = mi.Float(u), mi.Float(v)
        return Lines((x, y, 0.0 * x), (0.0 * x, 0.0 * x, 0.0 * x + 1.0), mi.Bool(True))

    normal = np.array(turn @ mi.ScalarNormal3f(0, 0, 1)).ravel()
    return scene, RaySource(WIDTH, HEIGHT, lines, owner=number_of(mi)), normal


@pytest.mark.parametrize("samples", [2, 3, 4])
def test_a_renderers_samples_lie_where_the_filter_takes_them_to_be(mi, samples):
    scene, source, (a, b, c) = slanted(mi)
    settings = Settings(samples, integrator="depth", seed=3, shading="each")
    picture = render_rays(scene, source, settings).radiance
    row, column = np.divmod(np.arange(WIDTH * HEIGHT), WIDTH)
    x, y = places_of(mi, samples) + np.stack([column, row])[..., None]
    depths = 100.0 + (a * x + b * y) / c
    wanted = filtered(mi, np.repeat(depths[..., None], 3, axis=2), number_of(mi))
    np.testing.assert_allclose(picture, wanted, atol=1e-3)
    # A second pass, of other places, is the plain mean.
    renderer = Renderer(scene, source, settings)
    renderer.move(scene.placement, 1)
    x, y = places_of(mi, samples, number=1) + np.stack([column, row])[..., None]
    plain = (100.0 + (a * x + b * y) / c).mean(axis=1).reshape(HEIGHT, WIDTH)
    np.testing.assert_allclose(renderer.render(0)[0][..., 0], plain, atol=1e-3)
    assert np.abs(wanted[..., 0] - plain).max() > 0.05


def test_which_pixels_share(mi):
    plain, stripes = focused_display("square", subpixels="none"), focused_display("square", subpixels="rgb")
    shared = display_source(plain, "exact", 4)
    assert [samples for samples in range(1, 9) if is_filtered(shared, samples)] == list(range(2, MAX_SAMPLES + 1))
    assert not is_filtered(display_source(stripes, "exact", 4), 4)
    for engine in ("golden", "twin", "rtl"):
        assert not is_filtered(display_source(plain, "exact", 4, engine=engine), 4)
    assert is_filtered(eye_source((0.0, 0.0, 600.0), Window(10.0, 10.0, 8, 8)), 4)


def changes(source, row):
    return np.flatnonzero(np.diff(owners(source, row + 0.5).astype(np.int64))) + 1


def test_the_lenslets_of_a_display(mi):
    """Eight pixels each, and the panel's middle is one's."""
    display = focused_display("square", width_px=40, height_px=40, pixel_pitch=1.0 / 8.0)
    assert changes(display_source(display, "exact", 4), 3).tolist() == [8, 16, 24, 32]


def test_the_lenslets_of_a_captured_picture(mi):
    """They are as far apart as on the display that shows it."""
    setup = load_setup(repository() / "scenes/setups/fig8a.toml")
    pitch = setup.array.pitches_mm[0] / setup.display.panel.coarsest_mm
    found = changes(capture_source(setup), 1000)
    np.testing.assert_allclose(found - found[0], pitch * np.arange(len(found)), atol=1.0)
    assert len(found) > 50

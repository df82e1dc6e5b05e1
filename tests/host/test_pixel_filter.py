"""The pixels' filter: against sums written out, and by what it is for."""

import math

import drjit as dr
import numpy as np
import pytest
from lippmann.capturing.rays import capture_source
from lippmann.capturing.setup import load_setup
from lippmann.optics.backend import DrJitBackend
from lippmann.optics.sampling import points_in_pixel
from lippmann.rendering.pixel_filter import MOST_SAMPLES, PixelFilter, is_filtered, softness
from lippmann.rendering.samples import Seeds
from lippmann.rendering.sources import RaySource, Window, display_source, eye_source
from lippmann.sim.tools import repository
from lippmann.variant import current_device
from scene_cases import focused_display, generator

WIDTH, HEIGHT = 40, 150


def source_of(part):
    return RaySource(WIDTH, HEIGHT, lambda *_: None, part=part)


def places_of(mi, samples, seed=3, number=0):
    """The places of all samples in their pixels, (2, pixels, samples)."""
    pixel = np.repeat(np.arange(WIDTH * HEIGHT), samples)
    sample = np.tile(np.arange(samples), WIDTH * HEIGHT)
    x, y = points_in_pixel(mi.UInt32(pixel), mi.UInt32(sample), samples, seed, number)
    return np.array([np.array(x), np.array(y)]).reshape(2, -1, samples)


def filtered(mi, colours, part, seed=3, number=0):
    """The picture (HEIGHT, WIDTH, 3) of samples' colours (pixels, samples, 3), given in two pieces."""
    samples = colours.shape[1]
    made = PixelFilter(source_of(part), samples, range(HEIGHT))
    half = WIDTH * HEIGHT // 3
    for pixels in (np.arange(half, WIDTH * HEIGHT), np.arange(half)):
        flat = colours[pixels].reshape(-1, 3).T.astype(np.float32)
        seeds = Seeds(mi.UInt32(seed), mi.UInt32(number))
        made.add(mi.Color3f(*flat), mi.UInt32(pixels), mi.Bool(True), seeds)
    return np.stack([np.array(plane) for plane in made.colours()], axis=-1).reshape(HEIGHT, WIDTH, 3)


def number_of(mi):
    """Parts seven pixels wide and eleven high."""

    def part(b, u, v):
        return mi.UInt32(mi.Int32(b.floor(u / 7.0))) * 0x10001 + mi.UInt32(mi.Int32(b.floor(v / 11.0)))

    return part


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


def test_nothing_crosses_from_one_lenslet_to_another(mi):
    """Each lenslet has a colour of its own, and all its pixels have it."""
    row, column = np.divmod(np.arange(WIDTH * HEIGHT), WIDTH)
    own = generator(2).uniform(0.1, 9.0, (6, 14, 3))[column // 7, row // 11]
    picture = filtered(mi, np.repeat(own[:, None], 4, axis=1), number_of(mi))
    np.testing.assert_allclose(picture.reshape(-1, 3), own, rtol=1e-6)


@pytest.mark.parametrize(("samples", "most"), [(2, 0.86), (3, 0.87), (4, 0.91)])
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
    print(f"{samples} samples: the error is {soft / plain:.3f} of the means'")
    assert soft < most * plain


def test_a_second_pass_is_the_plain_mean(mi):
    """Their mean over many passes has no softness."""
    colours = generator(4).uniform(0.0, 2.0, (WIDTH * HEIGHT, 4, 3))
    picture = filtered(mi, colours, lambda b, u, v: mi.UInt32(0), number=1)
    np.testing.assert_allclose(picture.reshape(-1, 3), colours.mean(axis=1), rtol=1e-4)


def test_which_pixels_share(mi):
    plain, stripes = focused_display("square", subpixels="none"), focused_display("square", subpixels="rgb")
    shared = display_source(plain, "exact", 4)
    assert [samples for samples in range(1, 9) if is_filtered(shared, samples)] == list(range(2, MOST_SAMPLES + 1))
    assert not is_filtered(display_source(stripes, "exact", 4), 4)
    for engine in ("golden", "twin", "rtl"):
        assert not is_filtered(display_source(plain, "exact", 4, engine=engine), 4)
    assert is_filtered(eye_source((0.0, 0.0, 600.0), Window(10.0, 10.0, 8, 8)), 4)


def changes(mi, source, row):
    """The columns where another lenslet's pixels begin."""
    b = DrJitBackend(current_device())
    u = dr.arange(mi.Float64, source.width_px) + 0.5
    numbers = np.array(source.part(b, u, mi.Float64(row + 0.5) + 0.0 * u))
    return np.flatnonzero(np.diff(numbers.astype(np.int64))) + 1


def test_the_lenslets_of_a_display(mi):
    """Eight pixels each, and the panel's middle is one's."""
    display = focused_display("square", width_px=40, height_px=40, pixel_pitch=1.0 / 8.0)
    assert changes(mi, display_source(display, "exact", 4), 3).tolist() == [8, 16, 24, 32]


def test_the_lenslets_of_a_captured_picture(mi):
    """They are as far apart as on the display that shows it."""
    setup = load_setup(repository() / "scenes/setups/fig8a.toml")
    pitch = setup.array.pitches_mm[0] / setup.display.panel.coarsest_mm
    found = changes(mi, capture_source(setup), 1000)
    np.testing.assert_allclose(found - found[0], pitch * np.arange(len(found)), atol=1.0)
    assert len(found) > 50

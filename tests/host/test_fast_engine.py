"""The fast engine (Dr.Jit, float32 inside a lenslet) against the golden one (float64).

The golden engine is held to physics elsewhere; here the two differ in rounding only. Where rounding
is magnified by the optics themselves (a panel in the dome's valley, rays near grazing), the bound
is measured: what golden makes of a change by one rounding of float32.
"""

import functools
import itertools
import math

import lippmann
import numpy as np
import pytest
import scene_cases
from lippmann.optics.rays import MODELS, Status
from optics_cases import (
    GRIDS,
    KEYS,
    SIDES,
    cases,
    display_of,
    lattice,
    random_display,
    random_in_cell,
    random_pixels,
    with_random_eye,
)

SEED = 5664
#: Rounding of a float32 as large as a lenslet, in pitches: half a unit of its last place.
ROUNDING = 2.0**-24
MICRORADIAN, NANOMETRE = 1e-6, 1e-6  # in rad and mm
COUNTED = (Status.OK, Status.CROSSTALK)

everywhere = pytest.mark.parametrize(("grid", "side"), list(itertools.product(GRIDS, SIDES)))
generator = functools.partial(scene_cases.generator, SEED)


def panel_of(pitch, width, ratio):
    """A panel of `width` mm, `ratio` as high, with 20 pixels a lenslet, under an array that is shifted."""
    across = width / (pitch / 20)
    size = {"width_px": int(across), "height_px": int(ratio * across)}
    return size | {"pixel_pitch": pitch / 20, "offset": (0.31, -0.17)}


def trace_both(display, pixels, aperture, model):
    """Rays by golden and by fast, the angles between them, rad, and their exit points' distances, mm."""
    golden, fast = (lippmann.trace(display, pixels, aperture, model, engine) for engine in ("golden", "fast"))
    angles, distances = (getattr(fast, name) - getattr(golden, name) for name in ("direction", "local_mm"))
    return golden, fast, np.linalg.norm(angles, axis=1), np.linalg.norm(distances, axis=1)


def both_counted(golden, fast) -> np.ndarray:
    return np.isin(golden.status, COUNTED) & np.isin(fast.status, COUNTED)


def near_edge(display, pixels, aperture, model, wanted) -> np.ndarray:
    """Tell for each ray whether golden, its inputs changed by float32's rounding, has the status
    that is wanted: 1e-6 px, or four roundings of the lenslet where these are more.
    """
    step_mm = max(4 * ROUNDING * display.array.coarsest_mm, 1e-6 * display.panel.pixel_pitch_mm)
    found = np.zeros(len(pixels), bool)
    for angle in np.arange(8) * math.pi / 4:
        step = step_mm * np.array([math.cos(angle), math.sin(angle)])
        for pixel_moves in (0, 1):
            moved = pixels + pixel_moves * step / display.panel.pixel_pitch_mm
            aim = None if aperture is None else aperture + (1 - pixel_moves) * step
            found |= lippmann.trace(display, moved, aim, model).status == wanted
    return found


def same_statuses(display, pixels, aperture, model, golden, fast) -> int:
    """Assert that statuses differ at edges only; return how many do."""
    odd = np.flatnonzero(golden.status != fast.status)
    if odd.size:
        aim = None if aperture is None else aperture[odd]
        assert near_edge(display, pixels[odd], aim, model, fast.status[odd]).all()
    return odd.size


@pytest.mark.parametrize(("kind", "model"), cases(((model,) for model in MODELS), ("exact",)))
@everywhere
def test_two_microradians_and_fifty_nanometres(grid, side, kind, model):
    """Chief rays and aperture points in the cell; a phone's panel and one 700 mm wide; turned too.

    The panel is anywhere from contact to beyond the focus.
    """
    rng = generator(grid, side, model, *KEYS[kind])
    n = 2000
    rays = odd = 0
    for wide, turn, chief in itertools.product(
        (True,) if kind == "near" else (False, True), (0.0, 33.3), (True, False)
    ):
        pitch = float(rng.uniform(0.3, 2.0))
        radius = pitch * float(rng.uniform(1.0, 3.0))
        index = float(rng.uniform(1.4, 1.9))
        width = 700.0 if wide else 60.0
        thickness = pitch * float(rng.uniform(0.5, 2.0))
        gap = float(rng.choice((0.0, rng.uniform(0.0, 1.2)))) * radius / (index - 1)
        lens = {"pitch": pitch, "radius": radius, "index": index, "thickness": thickness, "gap": gap, "rotation": turn}
        display = display_of(grid, side, **lens, **panel_of(pitch, width, 0.6), **lattice(rng, kind, pitch))
        if kind == "near":
            display = with_random_eye(rng, display)
        pixels = random_pixels(rng, display, n)
        aperture = None if chief else random_in_cell(rng, display, n)
        golden, fast, apart, aside = trace_both(display, pixels, aperture, model)
        assert fast.direction.dtype == golden.direction.dtype == np.float64
        odd += same_statuses(display, pixels, aperture, model, golden, fast)
        good = both_counted(golden, fast)
        np.testing.assert_array_equal(fast.lenslet[good], golden.lenslet[good])
        # Centres are float64 in both engines.
        assert np.abs(fast.centre_mm - golden.centre_mm)[good].max() < 1e-12
        assert (apart <= 2 * MICRORADIAN)[good].all(), display
        assert (aside[good] <= 50 * NANOMETRE).all(), display
        rays += np.count_nonzero(good)
    assert odd <= 2  # of 16,000: float32's rounding is 1e-7 of a cell wide
    assert rays > (8000 if kind == "far" else 1000)


@pytest.mark.parametrize(("kind", "model"), cases(((model,) for model in MODELS), ("exact",)))
@everywhere
def test_any_display_within_four_roundings(grid, side, kind, model):
    """Displays drawn wide, panels in contact, aims into cells three pitches away.

    The change that one rounding of the point and the aim, in x and y, makes to golden's ray is
    magnified as the engine's own roundings are; four times that is allowed on top.
    """
    rng = generator(2, grid, side, model, *KEYS[kind])
    n, rays, odd = 1500, 0, 0
    for _ in range(3 if model == "exact" else 2):
        display = random_display(rng, grid, side, kind=kind)
        pixels = random_pixels(rng, display, n)
        aperture = random_in_cell(rng, display, n) * rng.choice((0.0, 1.0, 5.0), (n, 1))
        golden, fast, apart, aside = trace_both(display, pixels, aperture, model)
        odd += same_statuses(display, pixels, aperture, model, golden, fast)

        # A thousand roundings, so that golden's own do not show.
        step = 1000 * ROUNDING * display.array.coarsest_mm
        turned, moved = np.zeros(n), np.zeros(n)
        alike = both_counted(golden, fast) & (fast.lenslet == golden.lenslet).all(axis=1)
        for k, axis in itertools.product((0, 1), np.eye(2)):
            changed = pixels + k * step / display.panel.pixel_pitch_mm * axis
            other = lippmann.trace(display, changed, aperture + (1 - k) * step * axis, model)
            turned += np.linalg.norm(other.direction - golden.direction, axis=1) / 1000
            moved += np.linalg.norm(other.local_mm - golden.local_mm, axis=1) / 1000
            # Near a seam or total reflection the changed ray is no measure.
            alike &= (other.lenslet == golden.lenslet).all(axis=1)
            alike &= np.isin(other.status, COUNTED)
        assert (apart <= 2 * MICRORADIAN + 4 * turned)[alike].all(), display
        assert (aside <= 50 * NANOMETRE + 4 * moved)[alike].all(), display
        rays += np.count_nonzero(alike)
    assert odd <= 3
    # Half of the skewed arrays end on the panel, and many a ray beside them.
    assert rays > (n / 2 if kind == "skewed" else n)


@everywhere
def test_statuses_right_at_the_edges(grid, side):
    """Golden bisects between rays of two fates; at the edge itself fast takes either of the two,
    and a thousandth of a pitch away from it the same as golden.
    """
    rng = generator(3, grid, side)
    display = display_of(
        grid, side, radius=0.75 if grid == "square" else 0.62, index=1.6, thickness=None, gap=0.2, rotation=12.0
    )
    n = 4000
    low, high = (random_pixels(rng, display, n) for _ in range(2))
    high = low + (high - low) * 0.05
    aperture = random_in_cell(rng, display, n) * 1.5

    def fate(pixels):
        return lippmann.trace(display, pixels, aperture).status

    first, last = fate(low), fate(high)
    differ = first != last
    low, high, aperture = low[differ], high[differ], aperture[differ]
    first, last = first[differ], last[differ]
    for _ in range(45):
        middle = (low + high) / 2
        as_first = (fate(middle) == first)[:, None]
        low, high = np.where(as_first, middle, low), np.where(as_first, high, middle)
    # The bisection may have ended at a third fate.
    last = fate(high)
    fast = lippmann.trace(display, low, aperture, engine="fast").status
    assert len(low) > 500
    assert {(a, b) for a, b in zip(first.tolist(), last.tolist(), strict=True)} >= {(0, 2), (2, 0)}
    # There it is left to rounding; but rays that graze a face are traced in double, as golden traces them.
    assert np.mean(fast == first) > 0.4
    odd = (fast != first) & (fast != last)
    # Corners where three fates meet are rare, and then golden finds the third within rounding.
    assert np.mean(odd) < 0.01
    assert near_edge(display, low[odd], aperture[odd], "exact", fast[odd]).all()

    away = rng.normal(size=low.shape)
    away *= 1e-3 * display.array.pitch_mm / display.panel.pixel_pitch_mm
    golden = fate(low + away)
    fast = lippmann.trace(display, low + away, aperture, engine="fast").status
    mixed = np.flatnonzero(fast != golden)
    assert len(mixed) <= 0.001 * len(low) + 1
    assert near_edge(display, (low + away)[mixed], aperture[mixed], "exact", fast[mixed]).all()


@pytest.mark.parametrize("side", SIDES)
def test_all_fates_alike(side):
    """Thin, steep lenslets seen at all angles: every status that can be is met and is golden's."""
    rng = generator(4, side)
    n = 20000
    display = display_of("square", side, radius=0.715, index=1.25, thickness=None, gap=0.0)
    pixels = random_pixels(rng, display, n)
    angle = rng.uniform(-math.pi, math.pi, n)
    reach = rng.choice((0.3, 1.0, 4.0), n)
    aperture = reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    golden, fast, *_ = trace_both(display, pixels, aperture, "exact")
    counts = np.bincount(golden.status, minlength=5)
    assert (counts[[0, 2, 3, 4]] > 20).all()
    # Grazing rays make float32's rounding many times as wide as elsewhere.
    mixed = np.flatnonzero(golden.status != fast.status)
    assert len(mixed) <= 20
    assert np.isfinite(fast.origin_mm).all()
    assert np.isfinite(fast.direction).all()
    assert np.abs(np.linalg.norm(fast.direction, axis=1) - 1).max() < 4e-7


@pytest.mark.parametrize(("kind", "model"), cases(((model,) for model in MODELS), ("exact",)))
@everywhere
def test_world_to_panel(grid, side, kind, model):
    """The panel point is as far off as eight roundings of the ray's place and direction carry.

    A float32 ray is off by 2^-24 pitches in place and 2^-24 in each component of its direction;
    golden traces rays with a thousand times these changes, and so tells what they do on the panel.
    For R >= p and 30 degrees aside 99 % stay below 1e-4 of a pixel, a twentieth pitch wide.
    """
    rng = generator(5, grid, side, model, *KEYS[kind])
    n = 2000
    hit = odd = 0
    for wide in (False, True):
        pitch = float(rng.uniform(0.3, 2.0))
        radius = pitch * float(rng.uniform(1.0, 3.0))
        width = 700.0 if wide else 60.0
        lens = {"pitch": pitch, "radius": radius, "thickness": pitch * 0.8, "gap": 1.5 * radius}
        lens["rotation"] = float(rng.uniform(-180, 180))
        display = display_of(grid, side, **lens, **panel_of(pitch, width, 1.0), **lattice(rng, kind, pitch))
        if kind == "near":
            display = with_random_eye(rng, display)
        eye = np.array([0.1 * width, -0.05 * width, width])
        target = np.column_stack([rng.uniform(-0.52, 0.52, (n, 2)) * width, np.zeros(n)])
        direction = target - eye
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        origin = np.broadcast_to(eye, (n, 3))
        golden = lippmann.trace_to_panel(display, origin, direction, model)
        fast = lippmann.trace_to_panel(display, origin, direction, model, "fast")

        blur = np.zeros(n)
        shifts = 1000 * ROUNDING * np.eye(3)[:2]
        sure = np.ones(n, bool)
        for place, turn in [*((pitch * s, 0) for s in shifts), *((0, s) for s in shifts)]:
            start = target + place  # turned about the array, not about the eye
            other = lippmann.trace_to_panel(display, start, direction + turn, model)
            blur += np.linalg.norm(other.pixel - golden.pixel, axis=1) / 1000
            sure &= other.status == golden.status
            sure &= (other.lenslet == golden.lenslet).all(axis=1)
        odd += np.count_nonzero(fast.status != golden.status)
        np.testing.assert_array_equal(fast.status[sure], golden.status[sure])
        good = sure & np.isin(golden.status, COUNTED)
        np.testing.assert_array_equal(fast.lenslet[good], golden.lenslet[good])
        error = np.linalg.norm(fast.pixel - golden.pixel, axis=1)[good]
        assert (error <= 8 * blur[good]).all(), display
        assert np.quantile(error, 0.99) < 1e-4, display
        hit += np.count_nonzero(good)
    assert odd <= 3
    assert hit > n


@pytest.mark.parametrize("engine", ["golden", "fast"])
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("side", SIDES)
def test_the_same_ray_comes_out_the_same(side, model, engine):
    """Run after run, in any company: order and number of the rays do not matter; there may be none."""
    rng = generator(6, side)
    display = display_of("hex", side, radius=0.7, gap=0.1, rotation=5.0)
    pixels, n = random_pixels(rng, display, 3000), 3000
    aperture = random_in_cell(rng, display, n) * 1.5
    once = lippmann.trace(display, pixels, aperture, model, engine)
    back = lippmann.trace_to_panel(display, once.origin_mm, -once.direction, model, engine)
    for some in (rng.permutation(n), np.arange(7), np.arange(1), np.arange(0)):
        again = lippmann.trace(display, pixels[some], aperture[some], model, engine)
        for field in ("lenslet", "centre_mm", "local_mm", "direction", "status"):
            np.testing.assert_array_equal(getattr(again, field), getattr(once, field)[some])
        twin = lippmann.trace_to_panel(display, once.origin_mm[some], -once.direction[some], model, engine)
        for field in ("pixel", "lenslet", "status"):
            np.testing.assert_array_equal(getattr(twin, field), getattr(back, field)[some])

"""The golden engine's model `exact` against physics: carried back, and in 50 digits.

The reverse trace is truth.py's, which shares no code with the engine. Seeds are fixed and shown when a
test fails.
"""

import itertools
import math

import lippmann
import numpy as np
import pytest
import truth
from optics_cases import (
    GRIDS,
    KEYS,
    LONG_PI,
    SIDES,
    display_of,
    exit_cosine,
    farthest_corner,
    kinds,
    long_optics_of,
    optics_of,
    random_display,
    random_in_cell,
    random_pixels,
    somewhere,
    with_random_eye,
)
from scene_cases import generator
from truth import BLOCKED, CROSSTALK, MISSED, OK, REFLECTED

SEED = 20050117
#: Rays nearer than this to an edge between two fates (truth's margin) may have either in float64,
#: whose rounding across a 700 mm panel is 1e-13 mm, 1e-12 of the finest pitch.
TIE = 1e-9

long_needed = pytest.mark.skipif(not truth.has_long_longdouble(), reason="longdouble of this machine is too short")
everywhere = pytest.mark.parametrize(("grid", "side"), list(itertools.product(GRIDS, SIDES)))


def far(p, q) -> float:
    """The largest difference of two vectors' components, subtracted in 50 digits."""
    return max(
        float(abs(truth.mp.mpf(float(a)) - (b if isinstance(b, truth.mp.mpf) else float(b))))
        for a, b in zip(p, q, strict=True)
    )


def owners(display, points) -> tuple[np.ndarray, np.ndarray]:
    """The lenslet that owns each panel point, and the point from its centre, array's axes.

    points: (n, 2) panel mm, longdouble. By search: of the centres round the place where the straight line from the eye
    to the point passes the aperture plane, the nearest.
    """
    array = display.array
    turn = np.longdouble(array.rotation_deg) * LONG_PI / 180
    c, s = np.cos(turn), np.sin(turn)

    def in_array(point):
        x, y = (point - array.offset_mm).T
        return np.stack([c * x + s * y, c * y - s * x], axis=1)

    passed, D = points, display.aperture_distance_mm
    if display.viewing_distance_mm is not None:
        to_eye = np.longdouble(display.viewing_distance_mm) + D
        passed = points + (np.array(display.viewing_axis_mm, np.longdouble) - points) * D / to_eye
    passed, own = in_array(passed), in_array(points)
    # Nearest on the regular lattice of pitch 1, of which this one is an affine image.
    px, py = (np.longdouble(pitch) for pitch in array.pitches_mm)
    row = np.longdouble(1) if array.grid == "square" else np.sqrt(np.longdouble(0.75))
    passed = np.stack([(passed[:, 0] - array.shear * passed[:, 1]) / px, passed[:, 1] / py], axis=1)
    nearest = np.full(len(points), np.inf)
    lenslet, best = np.zeros((len(points), 2)), np.zeros_like(own)
    for dj, di in itertools.product((-1, 0, 1), repeat=2):
        j = np.round(passed[:, 1] / row) + dj
        shift = 0 if array.grid == "square" else j / 2
        i = np.round(passed[:, 0] - shift) + di
        centre = np.stack([i + shift, j * row], axis=1)
        far_off = ((passed - centre) ** 2).sum(axis=1)
        nearer = far_off < nearest
        nearest[nearer] = far_off[nearer]
        lenslet[nearer] = np.stack([i, j], axis=1)[nearer]
        y = py * centre[:, 1]
        best[nearer] = (own - np.stack([px * centre[:, 0] + array.shear * y, y], axis=1))[nearer]
    return lenslet, best


def missing(display, lenslets) -> np.ndarray:
    """Which lenslets (n, 2) lie outside the array's extent."""
    array, (i, j) = display.array, np.asarray(lenslets, np.longdouble).T
    if array.extent_mm is None:
        return np.zeros(len(lenslets), bool)
    hexagonal = array.grid == "hex"
    across = j * array.pitches_mm[1] * (np.sqrt(np.longdouble(0.75)) if hexagonal else 1)
    along = (i + hexagonal * j / 2) * array.pitches_mm[0]
    return (2 * abs(along) > array.extent_mm[0]) | (2 * abs(across) > array.extent_mm[1])


@long_needed
@kinds
@everywhere
def test_every_ray_leads_back_to_its_pixel(grid, side, kind):
    """25,000 rays of 125 random displays each: within 1e-11 mm of the pixel, in longdouble, and through
    the lenslet that owns it, which is the one that the straight line to the eye passes.

    1e-11 mm is the rounding of a 700 mm panel's coordinates (1e-13 mm) magnified a hundredfold, as
    grazing rays do. That is why both ends of the ray must be more than 3 degrees (cosine 0.05)
    from grazing; all others, with a panel closer to the dome than that is deep, stay within 1e-10.
    """
    rng = generator(SEED, grid, side, *KEYS[kind])
    rays = grazing = crossed = ended = 0
    for case in range(250):
        if case % 2 == 0:
            display = random_display(rng, grid, side, kind=kind)
        pixels = random_pixels(rng, display, 100)
        chief = case % 2 == 0
        aperture = np.zeros((100, 2)) if chief else random_in_cell(rng, display, 100)
        out = lippmann.trace(display, pixels, None if chief else aperture)

        points, off = truth.back_to_panel_many(out.origin_mm, out.direction, out.lenslet, **long_optics_of(display))
        half = np.array([display.panel.width_px, display.panel.height_px]) / np.longdouble(2)
        wanted = (pixels.astype(np.longdouble) - half) * (1, -1)
        wanted *= np.longdouble(display.panel.pixel_pitch_mm)
        error = np.abs(points - wanted).max(axis=1)
        good = np.isin(out.status, (OK, CROSSTALK))
        good &= exit_cosine(display, out.local_mm, out.direction) >= 0.05
        owner, start = owners(display, wanted)
        flat = np.cos(np.arctan2(np.hypot(*(aperture - start).T), display.aperture_distance_mm)) < 0.05
        # NaN, where no reverse ray exists, must not pass.
        assert (error[good & ~flat] <= 1e-11).all(), display
        assert (error[good & flat] <= 1e-10).all(), display
        # The origins lie on the last face, but for the rounding of panel coordinates.
        assert (off[good] <= 1e-13).all(), display
        # Pixels within 1e-9 of a cell's edge are rare: none of these is.
        beside = missing(display, owner) | missing(display, out.lenslet)
        assert (out.status[missing(display, owner)] == BLOCKED).all(), display
        assert not (good & beside).any(), display
        ended += np.count_nonzero(beside)
        # By the front door, from elsewhere on the ray; one that starts or leaves at an edge may come back beside it.
        back = lippmann.trace_to_panel(display, out.origin_mm + 7 * out.direction, -out.direction)
        steep = (exit_cosine(display, out.local_mm, out.direction) > 0.1) & (out.direction[:, 2] > 0.1)
        same = (back.status == out.status) & (back.lenslet == out.lenslet).all(axis=1)
        assert np.count_nonzero(good & steep & ~same) <= 1
        error = np.abs(back.pixel - pixels)[good & steep & same] * display.panel.pixel_pitch_mm
        assert error.max(initial=0) < 1e-9, display
        own = (out.lenslet == owner).all(axis=1)
        np.testing.assert_array_equal(own[good], (out.status == OK)[good])
        rays += np.count_nonzero(good)
        grazing += np.count_nonzero(good & flat)
        crossed += np.count_nonzero(good & (out.status == CROSSTALK))
    # Most must have been looked at; the rest is total internal reflection of dense, steep lenslets.
    print(rays, grazing, crossed, ended)
    assert rays > (10000 if kind == "skewed" else 14000)
    assert (ended > 1000) == (kind == "skewed")
    assert grazing < 0.02 * rays
    # In glass a ray falls short of its aperture point: from the cell to the cell it stays there. Towards an eye aside
    # it comes from beside the cell, and may leave through the neighbour.
    assert (crossed > 0) == (side == "viewer" or kind != "far")


def wild_rays(rng, grid, side, fate, kind):
    """A display and 30 rays (100 of the rare kind) that favour one fate."""
    turn, offset = float(rng.uniform(-180, 180)), (float(rng.uniform(-1, 1)), 0.3)
    common = {"rotation": turn, "offset": offset}
    n = 30
    drawn = "skewed" if kind == "skewed" else "far"
    if kind == "skewed":
        common |= {"shear": float(rng.uniform(-0.4, 0.4)), "row_pitch": float(rng.uniform(0.6, 1.6))}
    corner = farthest_corner(grid, 1.0, common.get("row_pitch", 1.0), common.get("shear", 0.0))
    if fate in (OK, REFLECTED):
        display = random_display(rng, grid, side, kind=drawn)
        return display, random_pixels(rng, display, n), random_in_cell(rng, display, n)
    if fate == CROSSTALK:
        display = random_display(rng, grid, side, index=(1.3, 1.6), steepest=1.3, kind=drawn)
        aperture = random_in_cell(rng, display, n) * 4
        return display, random_pixels(rng, display, n), aperture
    if fate == BLOCKED:
        # Thin glass of low index, steep domes and rays all but in the panel's plane.
        display = display_of(grid, side, radius=1.02 * corner, index=1.25, thickness=None, gap=0.0, **common)
        n = 100
        angle = rng.uniform(-math.pi, math.pi, n)
        aperture = 4 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return display, random_pixels(rng, display, n), aperture
    # Missed: along the canyon between two rows of a nearly flat array in contact with its panel.
    display = display_of(grid, side, radius=400.0, thickness=None, gap=0.0)
    y = (0.5 if grid == "square" else math.sqrt(3) / 4) * rng.uniform(0.99, 0.999, n)
    pixels = np.column_stack([100 + rng.uniform(-2, 2, n), 80 - 16 * y])
    return display, pixels, np.column_stack([rng.choice((-1, 1), n) * rng.uniform(80, 200, n), y])


#: At every commit each grid and each side once with kind "far", and one case each of the other kinds, with three
#: displays for each fate. The exhaustive tests draw six, and all cases.
@pytest.mark.parametrize(
    ("kind", "grid", "side", "displays"),
    [
        *((kind, "hex", "viewer", 3) for kind in KEYS),
        ("far", "square", "panel", 3),
        *(
            pytest.param(kind, grid, side, 6, marks=pytest.mark.full)
            for kind in KEYS
            for grid, side in itertools.product(GRIDS, SIDES)
        ),
    ],
)
def test_statuses_lenslets_origins_directions_in_50_digits(grid, side, kind, displays):
    rng = generator(SEED, 2, grid, side, *KEYS[kind])
    seen = dict.fromkeys(range(5), 0)
    compared = skipped = ended = 0
    for fate, _ in itertools.product((OK, REFLECTED, CROSSTALK, BLOCKED, MISSED), range(displays)):
        display, pixels, aperture = wild_rays(rng, grid, side, fate, kind)
        if kind == "near":
            display = with_random_eye(rng, display)
        optics, out = optics_of(display), lippmann.trace(display, pixels, aperture)
        assert np.isfinite(out.origin_mm).all()
        for k in range(len(pixels)):
            true = truth.trace(optics, *pixels[k], *aperture[k])
            if true.margin < TIE:
                skipped += 1
                continue
            compared += 1
            where = (display, pixels[k].tolist(), aperture[k].tolist())
            assert out.status[k] == true.status, where
            seen[true.status] += 1
            # Rounding of the pixel's place is 1e-13 mm; near grazing at either face or at launch it
            # is magnified by 1 / cosine each time.
            start = truth.panel_point(optics, *pixels[k])
            home = truth.owner_of(optics, *start[:2])
            if not (truth.there(optics, home) and truth.there(optics, true.lenslet)):
                ended += 1
                continue
            launch = truth.chief_or_aperture_direction(optics, *start[:2], home, *aperture[k])
            blur = 1 / min(float(launch[2]), 1.0) ** 2 / max(float(true.cos_theta_t), 0.01)
            array = display.array
            blur *= 1 + 1 / min(array.finest_mm, array.radius_mm, display.aperture_distance_mm)
            assert far(out.direction[k], true.direction) < 2e-13 * blur, where
            if true.status == MISSED:
                on_line(out.origin_mm[k], true, 1e-12 * blur)
                continue
            assert tuple(out.lenslet[k]) == true.lenslet, where
            assert far(out.centre_mm[k], truth.centre_of(optics, true.lenslet)) < 2e-13, where
            if true.status == BLOCKED:
                # truth's origin is where it was stopped: ahead on the line from the dome it left.
                on_line(out.origin_mm[k], true, 1e-12 * blur)
                back = truth.back_to_panel(optics, out.origin_mm[k], out.direction[k], true.lenslet)
                assert back.off_mm < 1e-12
                assert far((back.x, back.y), start[:2]) < 1e-10
                continue
            assert far(out.origin_mm[k], true.origin) < 4e-13 * blur, where
    # Enough of each fate. Light that goes into a dome can be blocked by its valleys only, where
    # truth has no margin; light in the glass is too steep to pass 16 cells while it rises.
    print(seen, skipped, ended)
    assert compared > 100 * displays
    assert (ended > 5 * displays) == (kind == "skewed")
    assert seen[OK] > 10 * displays
    assert seen[CROSSTALK] > 10 * displays
    assert seen[REFLECTED] > 3 * displays
    if side == "panel":
        assert seen[BLOCKED] > 5
    else:
        assert seen[MISSED] > 5


def on_line(point, true, tolerance: float) -> None:
    """Assert that a point lies on the line of a true ray."""
    mp = truth.mp
    apart = [mp.mpf(float(p)) - q for p, q in zip(point, true.origin, strict=True)]
    t = sum(a * d for a, d in zip(apart, true.direction, strict=True))
    off = [a - t * d for a, d in zip(apart, true.direction, strict=True)]
    assert max(abs(q) for q in off) < tolerance * (1 + abs(t)), (point, true)


@somewhere
def test_world_to_panel_in_50_digits(grid, side, kind):
    """Random lines through the array, and lines that leave the display, back."""
    rng = generator(SEED, 3, grid, side, *KEYS[kind])
    seen = dict.fromkeys(range(5), 0)
    for case in range(24):
        steep = case % 3 == 2
        display = random_display(
            rng,
            grid,
            side,
            steepest=1.01,
            shallowest=1.1 if steep else 30.0,
            widest_mm=700.0 if case % 2 else 20.0,
            kind=kind,
        )
        optics, n = optics_of(display), 20
        p = display.array.finest_mm
        # From around the panel, up to 60 degrees aside; steep lenslets see grazing light as well.
        half = 0.5 * np.array([display.panel.width_mm, display.panel.height_mm])
        through = rng.uniform(-1.05, 1.05, (n, 2)) * half
        sideways = rng.normal(size=(n, 2)) * (3.0 if steep else rng.uniform(0, 1.0, (n, 1)))
        direction = np.column_stack([sideways, -np.ones(n)])
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        start = np.column_stack([through, np.zeros(n)])
        origin = start + direction * rng.choice((0.0, -30 * p, -500.0, 2 * p), (n, 1))
        out = lippmann.trace_to_panel(display, origin, direction)
        assert np.isfinite(out.pixel).all()
        for k in range(n):
            true = truth.world_to_panel(optics, origin[k], direction[k])
            if true.margin < TIE * max(1.0, 1 / p):
                continue
            where = (display, origin[k].tolist(), direction[k].tolist())
            assert out.status[k] == true.status, where
            seen[true.status] += 1
            if true.status in (OK, CROSSTALK):
                assert tuple(out.lenslet[k]) == true.lenslet, where
                # 500 mm away, directions of 16 digits are 1e-13 mm off at the array; a lenslet
                # magnifies by 1 / cosine at a face, twice.
                flat = min(float(-true.direction[2]), 1.0)
                bound = 4e-12 / max(true.margin, 1e-3) / flat**2 / display.panel.pixel_pitch_mm
                assert far(out.pixel[k], true.pixel) < float(bound), where
    print(seen)
    assert seen[OK] > 30
    assert seen[CROSSTALK] > 60
    assert seen[REFLECTED] > 2
    assert seen[BLOCKED] > 10


def test_world_rays_that_do_not_head_for_the_array():
    for grid, side in itertools.product(GRIDS, SIDES):
        out = lippmann.trace_to_panel(display_of(grid, side), np.zeros((3, 3)), [(0, 0, 1), (1, 0, 0), (0.6, 0, 0.8)])
        assert out.status.tolist() == [MISSED] * 3
        assert np.isfinite(out.pixel).all()


@pytest.mark.parametrize("side", SIDES)
def test_edges_and_corners_of_squares_have_one_owner(side):
    """Half-open cells, by hand: in binary-exact numbers the edges are hit exactly.

    Pixels of 1/16 mm, lenslets of 1 mm, panel of 200 x 160: u = 100 + 16 X, v = 80 - 16 Y.
    """
    display = display_of("square", side)
    corners = list(itertools.product(np.arange(-5, 6) / 2, repeat=2))
    pixels = [(100 + 16 * x, 80 - 16 * y) for x, y in corners]
    out = lippmann.trace(display, pixels)
    wanted = [(math.floor(x + 0.5), math.floor(y + 0.5)) for x, y in corners]
    assert [tuple(k) for k in out.lenslet.tolist()] == wanted
    np.testing.assert_array_equal(out.centre_mm, wanted)


#: Hexagon of pitch 1 mm: its vertices are (0, +-1/sqrt 3) and (+-1/2, +-1/(2 sqrt 3)).
EDGES = [(0.5, 0.0, (1, 0)), (-0.5, 0.0, (0, 0)), (0.5, 0.125, (1, 0)), (-0.5, -0.125, (0, 0))]


@pytest.mark.parametrize("side", SIDES)
def test_upright_edges_of_hexagons_have_one_owner(side):
    display = display_of("hex", side)
    pixels = [(100 + 16 * (x + i), 80 - 16 * y) for x, y, _ in EDGES for i in range(-3, 4)]
    wanted = [(i + di, dj) for _, _, (di, dj) in EDGES for i in range(-3, 4)]
    assert [tuple(k) for k in lippmann.trace(display, pixels).lenslet.tolist()] == wanted

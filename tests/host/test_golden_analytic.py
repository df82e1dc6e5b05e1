"""The golden engine against closed forms of optics, 50-digit algebra, and rayoptics.

A ray aimed at the point above its pixel leaves the panel parallel to the axis: the array then is a
lens in a beam, and textbooks say where it crosses the axis.
"""

import itertools
import math

import lippmann
import numpy as np
import pytest
import truth
from independent import sequential_lenslet
from optics_cases import (
    GRIDS,
    KEYS,
    SIDES,
    display_of,
    kinds,
    optics_of,
    random_display,
    random_in_cell,
    random_pixels,
)
from scene_cases import generator
from truth import CROSSTALK, MISSED, OK, REFLECTED, mp

SEED = 1908

everywhere = pytest.mark.parametrize(("grid", "side"), list(itertools.product(GRIDS, SIDES)))
FIRST = {"panel": "flat", "viewer": "curved"}


def pixels_above(display, points):
    """Pixel coordinates of array-frame points (n, 2), mm; the array neither turned nor moved."""
    half = 0.5 * np.array([display.panel.width_px, display.panel.height_px])
    return half + np.asarray(points) / display.panel.pixel_pitch_mm * (1, -1)


def crossings(display, heights, model="exact"):
    """Where rays parallel to the axis at the given heights cross it behind the last vertex, mm."""
    points = np.column_stack([heights, np.zeros(len(heights))])
    out = lippmann.trace(display, pixels_above(display, points), points, model)
    assert (out.status == OK).all()
    z_last = 0.0 if display.array.plano_side == "panel" else display.array.thickness_mm
    x, z = out.local_mm[:, 0], out.local_mm[:, 2]
    return z - z_last - x * out.direction[:, 2] / out.direction[:, 0]


@pytest.mark.parametrize("index", [1.33, 1.5, 1.9, 2.4])
@pytest.mark.parametrize("thickness", [0.5, 2.0])
@everywhere
def test_back_focal_length_from_paraxial_rays(grid, side, thickness, index):
    """Lensmaker's f; f - T / n behind the flat face when the dome comes first.

    At h = R / 6144 the aberration is 3e-8 of f; it is taken out by its third-order formula, and the
    fifth order is 1e-15. Heights are whole binary fractions, so that the pixel is where it is said
    to be; rounding of 1e-16 against a slope of 1e-4 leaves some 1e-11.
    """
    display = display_of(grid, side, index=index, thickness=thickness, radius=1.5, gap=0.3)
    h = 2.0**-12
    focus = truth.back_focal_length(1.5, index, thickness, FIRST[side])
    bent = truth.third_order_longitudinal_aberration(1.5, index, thickness, h, FIRST[side])
    assert abs(crossings(display, [h])[0] - float(focus + bent)) < 2e-11
    # In the paraxial model it is the focus at any height.
    for height in (2.0**-10, 0.1875, 0.4375):
        assert abs(crossings(display, [height], "paraxial")[0] - float(focus)) < 1e-12
    # A thin lens has no thickness and brings it together at f, from the vertices.
    at_f = crossings(display, [0.1875], "thin")[0]
    z_last = 0.0 if side == "panel" else thickness
    assert abs(at_f + z_last - float(truth.lensmaker_focal_length(1.5, index))) < 1e-13


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("index", "thickness"), [(1.4, 0.6), (1.5168, 1.0), (1.9, 2.5)])
def test_third_order_spherical_aberration(side, index, thickness):
    """From f/16 to f/2.5: L(h) - L(0) is Seidel's h^2 term, and what is left over grows as h^4."""
    radius = 2.0
    display = display_of("square", side, pitch=2.0, radius=radius, index=index, thickness=thickness, gap=1.0)
    f = radius / (index - 1)
    focus = float(truth.back_focal_length(radius, index, thickness, FIRST[side]))
    f_numbers = np.array([16.0, 12.0, 8.0, 6.0, 4.0])
    heights = f / (2 * f_numbers)
    heights = heights[heights < 0.25 * radius]
    third = np.array(
        [
            float(truth.third_order_longitudinal_aberration(radius, index, thickness, float(h), FIRST[side]))
            for h in heights
        ]
    )
    aberration = crossings(display, heights) - focus
    left = aberration - third
    assert (aberration < 0).all()  # the rim focuses short
    # Seidel's term is right to a share that is itself of order (h / R)^2 ...
    share = np.abs(left / third) / (heights / radius) ** 2
    assert (share < 12).all()
    assert share.max() / share.min() < 1.25
    # ... so that the remainder follows h^4.
    order = np.diff(np.log(np.abs(left))) / np.diff(np.log(heights))
    assert (np.abs(order - 4) < 0.25).all()
    # Nearer and nearer to 4 towards the axis.
    assert abs(order[0] - 4) < abs(order[-1] - 4)
    # Seidel's term itself: slope 2 at small h.
    small = crossings(display, np.array([0.02, 0.04]) * radius) - focus
    assert abs(math.log2(small[1] / small[0]) - 2) < 0.01


def test_the_flat_face_to_the_beam_is_the_worse_way_round():
    """n = 1.5, thin: 4.5 against 7/6 times h^2 / f (Jenkins and White)."""
    h = 0.01
    for side, factor in (("panel", 4.5), ("viewer", 7 / 6)):
        display = display_of("square", side, radius=1.5, index=1.5, thickness=0.5)
        f = 3.0
        focus = f - (0.5 / 1.5 if side == "viewer" else 0.0)
        lsa = crossings(display, [h])[0] - focus
        thick = factor
        if side == "viewer":
            # T shortens the path after the dome: (n f - T) for n f in the second term.
            n = 1.5
            thick = f / (2 * n**2) * (f + (n * f - 0.5) * (n**2 - 1) * (n - 1) ** 2 / n) / 2.25
        assert abs(lsa / (-thick * h**2 / f) - 1) < 1e-3


# --- the ideal models, by hand --------------------------------------------------------------------


def local_of(display, pixels):
    """Lens-local array-frame points of pixels by nearest centre, 50 digits rounded at the end."""
    optics = optics_of(display)
    rows = []
    for u, v in pixels:
        x, y, _ = truth.panel_point(optics, u, v)
        lenslet = truth.owner_of(optics, x, y)
        cx, cy = truth.centre_of(optics, lenslet)
        turn = mp.mpf(display.array.rotation_deg) * mp.pi / 180
        c, s = mp.cos(turn), mp.sin(turn)
        rows.append((c * (x - cx) + s * (y - cy), c * (y - cy) - s * (x - cx)))
    return rows


@pytest.mark.parametrize("model", ["pinhole", "thin", "paraxial"])
@kinds
@everywhere
def test_ideal_models_against_their_formulas_in_50_digits(grid, side, kind, model):
    """Chief and other rays; the ABCD matrices are multiplied out by hand here. Backwards they undo themselves.

    Only the first rays are traced in 50 digits. A pinhole's rays all leave through the centre.
    """
    rng = generator(SEED, grid, side, model, *KEYS[kind])
    for _ in range(10):
        display = random_display(rng, grid, side, kind=kind, ends=False)
        array, n = display.array, 200
        pixels = random_pixels(rng, display, n)
        aperture = random_in_cell(rng, display, n) * 0.999
        aperture[0] = 0
        out = lippmann.trace(display, pixels, aperture, model)
        assert (out.status == OK).all()
        chief = lippmann.trace(display, pixels[:1], None, model)
        np.testing.assert_array_equal(chief.direction[0], out.direction[0])
        T, index, gap = (mp.mpf(q) for q in (array.thickness_mm, array.index, display.gap_mm))
        f = mp.mpf(array.radius_mm) / (index - 1)
        D = truth.aperture_distance(optics_of(display))
        turn = mp.mpf(array.rotation_deg) * mp.pi / 180
        c, s = mp.cos(turn), mp.sin(turn)
        for k, (x, y) in enumerate(local_of(display, pixels[:8])):
            slopes, heights = [], []
            for from_, to in ((x, mp.mpf(aperture[k][0])), (y, mp.mpf(aperture[k][1]))):
                aim = (to - from_) / D
                if model == "pinhole":
                    slopes.append(-from_ / D)
                    heights.append(mp.mpf(0))
                elif model == "thin":
                    slopes.append(aim - to / f)
                    heights.append(to)
                elif side == "panel":
                    # Reaches the dome at height h, having crossed T of glass at slope aim / n.
                    h = from_ + gap * aim + T * aim / index
                    slopes.append(aim - h / f)
                    heights.append(h)
                else:
                    h = from_ + gap * aim
                    slopes.append(aim - h / f)
                    heights.append(h + T * slopes[-1] / index)
            length = mp.sqrt(1 + slopes[0] ** 2 + slopes[1] ** 2)
            z = T if (model, side) == ("paraxial", "viewer") else mp.mpf(0)
            wanted = (c * slopes[0] - s * slopes[1], s * slopes[0] + c * slopes[1], mp.mpf(1))
            place = (c * heights[0] - s * heights[1], s * heights[0] + c * heights[1], z)
            # The pixel's place is rounded to 1e-13 mm on a wide panel; over D and f that turns.
            small = float(min(D, f, 1))
            for got, true in zip(out.direction[k], wanted, strict=True):
                assert abs(got - true / length) < 4e-13 / small, display
            for got, true in zip(out.local_mm[k], place, strict=True):
                assert abs(got - true) < 4e-13 * float(1 + T / small), display

        cell = np.ones(n, bool)
        if model == "paraxial":
            # The reverse trace takes the cell of the point on the last face.
            back_there = lippmann.trace_to_panel(display, out.origin_mm, -out.direction, model)
            cell = (back_there.lenslet == out.lenslet).all(axis=1)
        back = lippmann.trace_to_panel(display, out.origin_mm + out.direction * 3.0, -out.direction, model)
        np.testing.assert_array_equal(back.lenslet[cell], out.lenslet[cell])
        # A pixel right at its cell's edge may come back on the other side.
        assert np.count_nonzero(back.status[cell] != OK) <= 1
        # 1e-13 mm of panel rounding, magnified by the lever D / f and by slopes aside.
        lever = 1 + (display.gap_mm + array.thickness_mm) / min(array.focal_length_mm, display.aperture_distance_mm)
        slope = 1 / out.direction[:, 2].min() ** 2
        error = np.abs(back.pixel - pixels)[cell].max(initial=0) * display.panel.pixel_pitch_mm
        assert error < 1e-12 * lever**2 * slope, display


@everywhere
def test_rayoptics_agrees(grid, side):
    """2,500 rays each through one lenslet, to 1e-13 of unit directions and of the lens' size.

    Where a ray leaves or launches near grazing (cosine below 0.1) rounding counts more: left out.
    """
    pytest.importorskip("rayoptics")
    rng = generator(SEED, 4, grid, side)
    compared = 0
    while compared < 2500:
        drawn = random_display(rng, grid, side, steepest=1.1)
        # One lenslet around the panel's centre, not turned and not moved: the same place for both.
        a = drawn.array
        lens = {"pitch": a.pitch_mm, "radius": a.radius_mm, "index": a.index, "thickness": a.thickness_mm}
        display = display_of(grid, side, **lens, gap=drawn.gap_mm, pixel_pitch=2.0**-10)
        points = random_in_cell(rng, display, 100) * 0.999
        aims = random_in_cell(rng, display, 100) * 0.999
        pixels = pixels_above(display, points)
        half = 0.5 * np.array([display.panel.width_px, display.panel.height_px])
        points = (pixels - half) * 2.0**-10 * (1, -1)  # as rounded, exactly
        out = lippmann.trace(display, pixels, aims)
        depth = display.aperture_distance_mm
        leaving = np.column_stack([aims - points, np.full(100, depth)])
        leaving /= np.linalg.norm(leaving, axis=1)[:, None]
        place, direction, status = sequential_lenslet(optics_of(display)).trace(points, leaving)
        normal = place / a.radius_mm + (0, 0, 1) if side == "panel" else np.array((0, 0, 1.0))
        cosine = np.abs((normal * direction).sum(axis=1))
        # rayoptics knows no cells: a ray that changes lenslet is none of its own.
        assert (status[out.status == OK] == 0).all()
        assert (status[(out.status == REFLECTED) & (out.lenslet == 0).all(axis=1)] == 2).all()
        good = (out.status == OK) & (cosine > 0.1) & (leaving[:, 2] > 0.1)
        size = display.gap_mm + a.thickness_mm + a.pitch_mm
        apart = np.abs(out.direction - direction).max(axis=1)
        assert (apart[good] <= 1e-13).all(), display
        aside = np.abs(out.local_mm - place).max(axis=1)
        assert (aside[good] <= 1e-13 * size).all(), display
        compared += np.count_nonzero(good)


@pytest.mark.parametrize("model", ["pinhole", "thin", "paraxial", "exact"])
@everywhere
def test_unit_directions(grid, side, model):
    """To 4e-16, four roundings: whatever the fate of the ray, with the array turned too."""
    rng = generator(SEED, 7, grid, side, model)
    for _ in range(10):
        display = random_display(rng, grid, side)
        aperture = random_in_cell(rng, display, 2000) * rng.choice((1, 4), (2000, 1))
        out = lippmann.trace(display, random_pixels(rng, display, 2000), aperture, model)
        length = np.sqrt((out.direction.astype(np.longdouble) ** 2).sum(axis=1))
        assert np.abs(length - 1).max() <= 4.5e-16, display
        assert np.isfinite(out.origin_mm).all()
        np.testing.assert_array_equal(out.origin_mm[:, 2], out.local_mm[:, 2])


def test_status_codes_are_those_of_the_page():
    assert [s.name for s in lippmann.Status] == ["OK", "MISSED", "INTERNAL_REFLECTION", "BLOCKED", "CROSSTALK"]
    assert [int(s) for s in lippmann.Status] == [OK, MISSED, REFLECTED, 3, CROSSTALK] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("side", SIDES)
def test_total_reflection_sets_in_where_snell_says(side):
    """Parallel light: at h = R / n from inside the dome; from the flat face at asin(1 / n)."""
    radius, index = 0.72, 1.9
    display = display_of("square", side, radius=radius, index=index, thickness=2.0, gap=0.5)
    if side == "panel":
        onset, direction = radius / index, np.array([1.0, 0.0])
    else:
        turn = mp.findroot(
            lambda h: mp.asin(h / radius) - mp.asin(h / (index * radius)) - mp.asin(1 / mp.mpf(index)),
            (0.6, 0.7),
            solver="anderson",
        )
        onset, direction = float(turn), np.array([1.0, 1.0]) / math.sqrt(2)
    points = np.array([(onset * (1 + e)) * direction for e in (-1e-9, 1e-9)])
    out = lippmann.trace(display, pixels_above(display, points), points)
    assert out.status.tolist() == [OK, REFLECTED]
    # A lost ray keeps the direction that it had in the glass.
    if side == "panel":
        np.testing.assert_allclose(out.direction[1], (0, 0, 1), 0, 1e-15)

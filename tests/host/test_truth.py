"""Tests of the judges: truth.py (50 digits, longdouble) and independent.py (rayoptics)."""

import itertools
import math
import random
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import truth
from independent import sequential_lenslet
from truth import BLOCKED, CROSSTALK, MISSED, OK, REFLECTED, Optics, mp

GRIDS = ("square", "hex")
SIDES = ("panel", "viewer")
TINY = mp.mpf(10) ** -40

LENS = {"pitch_mm": 1.0, "radius_mm": 1.5, "index": 1.5, "thickness_mm": 2.0, "gap_mm": 0.5}
PLAIN = Optics(width_px=100, height_px=80, pixel_pitch_mm=0.0625, grid="square", plano_side="panel", **LENS)
#: A dome as steep as 100 % fill allows, of dense glass: total reflection at every face.
STEEP = replace(PLAIN, radius_mm=0.72, index=1.9)

long_needed = pytest.mark.skipif(not truth.has_long_longdouble(), reason="longdouble of this machine is too short")


def random_optics(rng: random.Random, steepest: float = 1.02) -> Optics:
    """A random display; R from steepest half diagonals upwards, one third in contact."""
    grid, pitch = rng.choice(GRIDS), rng.uniform(0.2, 2)
    rho = pitch / math.sqrt({"square": 2, "hex": 3}[grid])
    radius = rho * rng.choice((rng.uniform(steepest, 1.5), rng.uniform(1.5, 5)))
    sag = radius - math.sqrt(radius**2 - rho**2)
    return Optics(
        width_px=rng.randint(100, 2000),
        height_px=rng.randint(100, 2000),
        pixel_pitch_mm=pitch / rng.uniform(4, 40),
        grid=grid,
        pitch_mm=pitch,
        radius_mm=radius,
        index=rng.uniform(1.3, 1.9),
        thickness_mm=sag + rng.choice((0.0, rng.uniform(0, 2 * radius))),
        gap_mm=rng.choice((0.0, rng.uniform(0, pitch), rng.uniform(0, 3 * radius))),
        plano_side=rng.choice(SIDES),
        rotation_rad=rng.choice((0.0, rng.uniform(-math.pi, math.pi))),
        offset_mm=(rng.uniform(-1, 1), rng.uniform(-1, 1)),
    )


def random_ray(rng: random.Random, optics: Optics) -> tuple[float, float, float, float]:
    """A pixel and an aperture point: chief ray, through the own cell, or wide of it."""
    wide = rng.choice((0.0, 0.5, 1.5)) * optics.pitch_mm
    u, v = rng.uniform(0, optics.width_px), rng.uniform(0, optics.height_px)
    return u, v, rng.uniform(-wide, wide), rng.uniform(-wide, wide)


def far(p, q):
    """The largest difference of two vectors' components."""
    return max(abs(a - b) for a, b in zip(p, q, strict=True))


# --- frames and lattice ---------------------------------------------------------------------------


def test_panel_corners_and_pixels():
    assert truth.panel_point(PLAIN, 0, 0) == (-3.125, 2.5, -2.5)
    assert truth.panel_point(PLAIN, 100, 80) == (3.125, -2.5, -2.5)
    assert truth.panel_point(replace(PLAIN, plano_side="viewer"), 50, 40) == (0, 0, -0.5)
    assert truth.pixel_of(PLAIN, 3.125, -2.5) == (100, 80)


@pytest.mark.parametrize("grid", GRIDS)
def test_half_open_cells_take_every_point_once(grid):
    """Exact rationals on a mesh that holds centres, edges and vertices; the rule is spelled out."""
    half = Fraction(1, 2)
    for a, b in itertools.product(range(-12, 13), repeat=2):
        u, w = Fraction(a, 8), Fraction(b, 8)
        owners = []
        for i, j in itertools.product(range(-5, 6), repeat=2):
            if grid == "square":
                q = (u - i, w - j)
            else:
                # Projections on 0, 60 and 120 degrees; w is sqrt(3) Y / p.
                du, dw = u - i - Fraction(j, 2), w - Fraction(3 * j, 2)
                q = (du, du / 2 + dw / 2, dw / 2 - du / 2)
            if all(-half <= k < half for k in q):
                owners.append((i, j))
        assert owners == [truth.cell_of(grid, u, w)]


def test_edges_and_vertices_by_hand():
    half = Fraction(1, 2)
    assert truth.cell_of("square", half, Fraction(0)) == (1, 0)
    assert truth.cell_of("square", -half, -half) == (0, 0)
    assert truth.cell_of("square", half, half) == (1, 1)
    # Hexagon: edge at 0 degrees, then the vertices at 30, 90, ... 330 degrees.
    assert truth.cell_of("hex", half, Fraction(0)) == (1, 0)
    vertices = ((1, 1), (0, 2), (-1, 1), (-1, -1), (0, -2), (1, -1))
    owners = [truth.cell_of("hex", Fraction(a, 2), Fraction(b, 2)) for a, b in vertices]
    assert owners == [(0, 1), (0, 1), (-1, 1), (0, 0), (0, 0), (1, 0)]


@pytest.mark.parametrize("grid", GRIDS)
def test_cell_is_the_nearest_centre(grid):
    rng = random.Random(11)
    optics = replace(PLAIN, grid=grid, pitch_mm=0.73, rotation_rad=0.4, offset_mm=(0.21, -0.34))
    indices = list(itertools.product(range(-9, 10), repeat=2))
    centres = {lenslet: truth.centre_of(optics, lenslet) for lenslet in indices}
    for _ in range(60):
        x, y = rng.uniform(-2, 2), rng.uniform(-2, 2)
        nearest = min(indices, key=lambda k: (centres[k][0] - x) ** 2 + (centres[k][1] - y) ** 2)
        assert truth.lenslet_of(optics, x, y) == nearest


def test_owner_is_passed_on_the_way_to_the_eye_by_hand():
    """D = 1/2 + 4/3 = 11/6 and an eye 9 D further, before x = 1: the line passes the aperture plane at 0.9 x + 0.1."""
    optics = replace(PLAIN, eye_mm=mp.mpf(11) / 6 * 9, axis_mm=(1.0, 0.0))
    assert far(truth.seen_through(optics, 5, -2), (mp.mpf(46) / 10, mp.mpf(-18) / 10)) < TINY
    # 0.9 x + 0.1 = 1/2 at x = 4/9, and 9.5 at x = 94/9; y is cut at 0.9 y = 1/2.
    edges = ((mp.mpf(4) / 9, 0, (0, 0), (1, 0)), (mp.mpf(94) / 9, 0, (9, 0), (10, 0)))
    for x, y, below, above in edges:
        assert truth.owner_of(optics, x - TINY, y) == below
        assert truth.owner_of(optics, x + TINY, y) == above
    assert [truth.owner_of(optics, 1, y)[1] for y in (0.55, 0.56, -0.55, -0.56)] == [0, 1, 0, -1]
    assert [truth.lenslet_of(optics, 1, y)[1] for y in (0.55, -0.55)] == [1, -1]


def test_aperture_point_turns_with_the_array():
    """By hand: a quarter turn carries the aperture point (a, 0) to (0, a) of the panel."""
    optics = replace(PLAIN, rotation_rad=mp.pi / 2, offset_mm=(0.25, 0.5))
    d = truth.chief_or_aperture_direction(optics, 0.25, 0.5, (0, 0), 0.375, 0)
    depth = mp.mpf(1) / 2 + mp.mpf(4) / 3
    assert far([d[0], d[1] / d[2]], [0, mp.mpf(0.375) / depth]) < TINY


def test_rotation_is_counter_clockwise():
    optics = replace(PLAIN, rotation_rad=math.pi / 2, offset_mm=(0.25, 0.5))
    x, y = truth.centre_of(optics, (2, 0))
    assert far((x, y), (0.25, 2.5)) < 1e-15


# --- rays known by hand ---------------------------------------------------------------------------


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("gap", [0.0, 0.75])
def test_axis_ray_goes_straight(grid, side, gap):
    optics = replace(PLAIN, grid=grid, plano_side=side, gap_mm=gap)
    ray = truth.trace(optics, 50, 40)
    assert ray.status == OK
    assert ray.lenslet == (0, 0)
    assert ray.origin == (0, 0, 0 if side == "panel" else 2)
    assert ray.direction == (0, 0, 1)
    assert ray.cos_theta_t == 1


def test_aperture_distance_by_hand():
    assert far([truth.aperture_distance(PLAIN)], [0.5 + mp.mpf(4) / 3]) < TINY
    viewer = replace(PLAIN, plano_side="viewer")
    sag = mp.mpf(3) / 2 - mp.sqrt(mp.mpf(7)) / 2  # R = 3/2, rho^2 = 1/2
    assert far([truth.sag(viewer)], [sag]) < TINY
    assert truth.aperture_distance(viewer) == 0.5
    assert truth.aperture_distance(replace(viewer, gap_mm=0.0)) == truth.sag(viewer)


@pytest.mark.parametrize("side", SIDES)
def test_nearly_flat_dome_is_a_plane_parallel_plate(side):
    """A plate shifts a ray by T (tan i - tan r) along itself and keeps its direction."""
    optics = replace(PLAIN, radius_mm=1e18, plano_side=side, thickness_mm=0.25)
    x, a = mp.mpf(3) / 16, mp.mpf(-1) / 4
    ray = truth.trace(optics, 53, 40, a=-0.25)
    slope = (a - x) / truth.aperture_distance(optics)
    sin_i = slope / mp.sqrt(1 + slope**2)
    tan_r = sin_i / mp.sqrt(mp.mpf(1.5) ** 2 - sin_i**2)
    assert ray.status == OK
    expected = x + slope * optics.gap_mm + tan_r * optics.thickness_mm
    assert abs(ray.origin[0] - expected) < 1e-17
    assert abs(ray.direction[0] - sin_i) < 1e-17


@pytest.mark.parametrize("height_px", [1, 3, 7])
def test_vertical_ray_turns_by_the_two_angles(height_px):
    """Aimed at the point above its pixel a ray runs parallel to the axis; one face bends it."""
    h = mp.mpf(height_px) / 16
    x, n, r = float(h), mp.mpf(1.5), mp.mpf(1.5)
    turn = mp.asin(n * h / r) - mp.asin(h / r)
    ray = truth.trace(PLAIN, 50 + height_px, 40, a=x)
    assert far(ray.origin, (h, 0, mp.sqrt(r**2 - h**2) - r)) < TINY
    assert far(ray.direction, (-mp.sin(turn), 0, mp.cos(turn))) < TINY
    assert far([ray.cos_theta_t], [mp.sqrt(1 - (n * h / r) ** 2)]) < TINY

    turn = mp.asin(h / r) - mp.asin(h / (n * r))
    ray = truth.trace(replace(PLAIN, plano_side="viewer"), 50 + height_px, 40, a=x)
    depth = 2 - (r - mp.sqrt(r**2 - h**2))
    sin_out = n * mp.sin(turn)
    assert far(ray.origin, (h - depth * mp.tan(turn), 0, 2)) < TINY
    assert far(ray.direction, (-sin_out, 0, mp.sqrt(1 - sin_out**2))) < TINY


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("grid", GRIDS)
def test_symmetries_of_the_lattice(grid, side):
    """Mirrors in x and y, and a step by one pitch (16 pixels), carry rays over into rays."""
    optics = replace(PLAIN, grid=grid, plano_side=side)
    x, y, a, b = 0.15, 0.21, 0.07, -0.11

    def traced(x, y, a, b):
        return truth.trace(optics, 50 + mp.mpf(x) * 16, 40 - mp.mpf(y) * 16, a, b)

    ray = traced(x, y, a, b)
    assert ray.status == OK
    mirrored = traced(-x, y, -a, b)
    assert far(mirrored.origin, (-ray.origin[0], *ray.origin[1:])) < TINY
    assert far(mirrored.direction, (-ray.direction[0], *ray.direction[1:])) < TINY
    mirrored = traced(x, -y, a, -b)
    assert far(mirrored.origin, (ray.origin[0], -ray.origin[1], ray.origin[2])) < TINY
    stepped = traced(mp.mpf(x) + 1, y, a, b)
    assert stepped.lenslet == (1, 0)
    assert far(stepped.origin, (ray.origin[0] + 1, *ray.origin[1:])) < TINY
    assert far(stepped.direction, ray.direction) < TINY


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("grid", GRIDS)
def test_turned_and_moved_array_turns_and_moves_the_rays(grid, side):
    optics = replace(PLAIN, grid=grid, plano_side=side)
    moved = replace(optics, rotation_rad=0.7, offset_mm=(0.125, -0.375))
    c, s = mp.cos(mp.mpf(0.7)), mp.sin(mp.mpf(0.7))
    # Mesh points of several cells; the aperture point reaches into the neighbour at times.
    for x, y in itertools.product((-1.3, 0.1, 0.45), (-0.8, 0.3)):
        xm, ym = c * x - s * y + mp.mpf(0.125), s * x + c * y - mp.mpf(0.375)
        a, b = mp.mpf(0.3), mp.mpf(-0.2)
        ray = truth.trace(optics, 50 + mp.mpf(x) * 16, 40 - mp.mpf(y) * 16, a, b)
        # The aperture point is given along the array's axes, and so turns with it.
        turned = truth.trace(moved, 50 + xm * 16, 40 - ym * 16, a, b)
        ox, oy, oz = ray.origin
        dx, dy, dz = ray.direction
        assert (turned.status, turned.lenslet) == (ray.status, ray.lenslet)
        origin = (c * ox - s * oy + mp.mpf(0.125), s * ox + c * oy - mp.mpf(0.375), oz)
        assert far(turned.origin, origin) < TINY
        assert far(turned.direction, (c * dx - s * dy, s * dx + c * dy, dz)) < TINY


# --- status ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("outside", [-1e-12, 1e-12])
def test_total_reflection_at_the_dome_sets_in_at_asin_1_over_n(outside):
    """A ray parallel to the axis meets the dome from inside under asin(h / R)."""
    h = float(mp.mpf(STEEP.radius_mm) / mp.mpf(STEEP.index)) * (1 + outside)
    ray = truth.trace(STEEP, 50 + mp.mpf(h) * 16, 40, a=h)
    assert ray.status == (REFLECTED if outside > 0 else OK)
    assert 0 < ray.margin < 1e-11
    if outside < 0:
        expected = mp.sqrt(1 - (mp.mpf(STEEP.index) * h / mp.mpf(STEEP.radius_mm)) ** 2)
        assert far([ray.cos_theta_t], [expected]) < TINY
    else:
        assert far(ray.direction, (0, 0, 1)) < TINY
        assert far([ray.origin[0]], [h]) < TINY


@pytest.mark.parametrize("outside", [-1e-12, 1e-12])
def test_total_reflection_at_the_flat_face(outside):
    """The dome turns a ray parallel to the axis by i - r; the flat face reflects at asin(1 / n)."""
    optics = replace(STEEP, plano_side="viewer")
    n, r = mp.mpf(optics.index), mp.mpf(optics.radius_mm)

    def past_critical(h):
        return mp.asin(h / r) - mp.asin(h / (n * r)) - mp.asin(1 / n)

    # Along the diagonal, for on the axis the cell ends before the onset.
    onset = mp.findroot(past_critical, (mp.mpf(0.6), mp.mpf(0.7)), solver="anderson")
    assert onset < optics.pitch_mm / mp.sqrt(2)
    x = onset * (1 + mp.mpf(outside)) / mp.sqrt(2)
    ray = truth.trace(optics, 50 + x * 16, 40 - x * 16, a=x, b=x)
    assert ray.status == (REFLECTED if outside > 0 else OK)
    assert ray.margin < 1e-10


@pytest.mark.parametrize("side", SIDES)
def test_crosstalk_leaves_through_the_neighbour(side):
    optics = replace(PLAIN, plano_side=side, radius_mm=3.0, thickness_mm=1.0, gap_mm=2.0)
    ray = truth.trace(optics, 50, 40, a=1.0)
    assert ray.status == CROSSTALK
    assert ray.lenslet == (1, 0)
    assert abs(ray.origin[0] - 1) < 0.5


def test_missed_when_the_canyon_between_the_domes_is_long():
    """Along the seams at y = p / 2 the domes hang p^2 / (8 R) deep or deeper, ever again.

    A panel in contact aims along that line at the rims' plane, twice as deep, a pitches ahead: the
    first dome comes after about a / 2.
    """
    optics = replace(PLAIN, plano_side="viewer", radius_mm=100.0, gap_mm=0.0)
    assert truth.trace(optics, 50, 32, a=100, b=-0.5).status == MISSED
    ray = truth.trace(optics, 50, 32, a=20, b=-0.5)
    # Level all but a trace, it comes to the flat face past the critical angle; the dome is met.
    assert ray.status == REFLECTED
    assert abs(ray.lenslet[0] - 10) <= 1
    # The seam belongs to two lenslets all along, so nobody should rely on it.
    assert ray.margin == 0


def test_missed_when_the_ray_does_not_head_for_the_array():
    for direction in ((0, 0, 1), (1.0, 0.0, 0.0)):
        landing = truth.world_to_panel(PLAIN, (0, 0, 1), direction)
        assert (landing.status, landing.lenslet, landing.pixel) == (MISSED, None, None)


def test_world_rays_outside_the_panel_and_in_the_wrong_cell():
    outside = truth.world_to_panel(PLAIN, (4.0, 0, 5), (0, 0, -1))
    assert outside.status == BLOCKED
    assert far(outside.pixel, (114, 40)) < TINY
    # Parallel light at 45 degrees lands about f = 3 mm aside of a 1 mm cell.
    slanted = truth.world_to_panel(PLAIN, (0, 0, 0), (-0.6, 0, -0.8))
    assert (slanted.status, slanted.lenslet) == (CROSSTALK, (0, 0))


def height(optics: Optics, x: float, y: float) -> float:
    """The curved face at (x, y) in floats: the plain definition, nearest centre and sphere."""
    u, w = (float(q) for q in truth._lattice(optics, mp.mpf(x), mp.mpf(y)))
    i, j = truth.cell_of(optics.grid, u, w)
    cx, cy = (float(q) for q in truth.centre_of(optics, (i, j)))
    drop = optics.radius_mm - math.sqrt(optics.radius_mm**2 - (x - cx) ** 2 - (y - cy) ** 2)
    return -drop if optics.plano_side == "panel" else drop


def clear_until(optics: Optics, p, d, t_end: float, in_glass: bool, steps: int = 120) -> bool:
    """March along a ray and tell whether it stays in its medium."""
    for t in (t_end * (k + 0.5) / steps for k in range(steps)):
        x, y, z = (float(a + t * b) for a, b in zip(p, d, strict=True))
        glass = (z < height(optics, x, y)) == (optics.plano_side == "panel")
        if glass != in_glass:
            return False
    return True


@pytest.mark.parametrize("grid", GRIDS)
def test_blocked_rays_stand_on_a_neighbour(grid):
    """Blocking takes thin glass of low index, steep domes and rays all but in the panel's plane."""
    rng = random.Random(6)
    radius = 0.72 if grid == "square" else 0.59
    optics = replace(PLAIN, grid=grid, radius_mm=radius, index=1.25, gap_mm=0.0)
    optics = replace(optics, thickness_mm=float(truth.sag(optics)))
    blocked = 0
    for _ in range(3000):
        u, v = rng.uniform(40, 60), rng.uniform(30, 50)
        angle = rng.uniform(-math.pi, math.pi)
        ray = truth.trace(optics, u, v, 4 * math.cos(angle), 4 * math.sin(angle))
        if ray.status != BLOCKED or ray.margin < 1e-6:
            continue
        x, y, z = (float(q) for q in ray.origin)
        assert abs(z - height(optics, x, y)) < 1e-12
        assert truth.lenslet_of(optics, x, y) != ray.lenslet
        # The dome that it left lies behind it on the same line, and the pixel behind that.
        x, y, _ = truth.back_to_panel(optics, ray.origin, ray.direction, ray.lenslet)
        assert far((x, y), truth.panel_point(optics, u, v)[:2]) < TINY
        # Air before the neighbour, glass behind it.
        ahead = [o + mp.mpf(1e-9) * d for o, d in zip(ray.origin, ray.direction, strict=True)]
        assert clear_until(optics, ahead, ray.direction, 1e-9, in_glass=True)
        back = [-d for d in ray.direction]
        assert clear_until(optics, ray.origin, back, 1e-8, in_glass=False)
        blocked += 1
        if blocked == 10:
            return
    pytest.fail(f"only {blocked} rays were blocked")


def test_marching_finds_the_same_first_meeting():
    """Small steps against the plain height field find the lenslet, and nothing on the way out."""
    rng = random.Random(5)
    wanted = itertools.product(SIDES, GRIDS, (OK, REFLECTED, CROSSTALK))
    left = dict.fromkeys(wanted, 4)
    for _ in range(4000):
        side, grid = rng.choice(SIDES), rng.choice(GRIDS)
        radius = 0.72 if grid == "square" else 0.6
        optics = replace(STEEP, grid=grid, plano_side=side, radius_mm=radius)
        thickness = float(truth.sag(optics)) + rng.choice((0.0, 0.3))
        optics = replace(optics, thickness_mm=thickness, gap_mm=rng.choice((0.0, 0.3)))
        u, v = rng.uniform(40, 60), rng.uniform(30, 50)
        a, b = rng.uniform(-1, 1), rng.uniform(-1, 1)
        ray = truth.trace(optics, u, v, a, b)
        if not left.get((side, grid, ray.status)) or ray.margin < 0.02:
            continue
        left[side, grid, ray.status] -= 1

        x, y, z = (float(q) for q in truth.panel_point(optics, u, v))
        home = truth.lenslet_of(optics, x, y)
        d = [float(q) for q in truth.chief_or_aperture_direction(optics, x, y, home, a, b)]
        if side == "panel":
            x, y, z = x + d[0] / d[2] * optics.gap_mm, y + d[1] / d[2] * optics.gap_mm, -thickness
            d = [d[0] / optics.index, d[1] / optics.index]
            d.append(math.sqrt(1 - d[0] ** 2 - d[1] ** 2))
        t = 0.0
        while clear_until(optics, (x, y, z), d, t, in_glass=side == "panel", steps=1):
            t += 4e-3
        # clear_until looks at half the way.
        lenslet = truth.lenslet_of(optics, x + t / 2 * d[0], y + t / 2 * d[1])
        assert lenslet == ray.lenslet
        assert (lenslet != home) == (ray.status == CROSSTALK) or ray.status == REFLECTED
        if side == "panel" and ray.status != REFLECTED:
            t_out = float(-ray.origin[2] / ray.direction[2])
            assert clear_until(optics, ray.origin, ray.direction, t_out, in_glass=False)
        if not any(left.values()):
            return
    pytest.fail(f"too few rays: {left}")


def test_margin_is_zero_when_light_crosses_a_steep_shoulder():
    """Found by search: down into a dome near its rim and out of the glass again on its far side."""
    optics = replace(PLAIN, radius_mm=0.72, index=1.3, thickness_mm=1.0)
    landing = truth.world_to_panel(optics, (-0.68, -0.93, 0.0), (-1.44, 1.23, -0.13))
    assert landing.lenslet == (-2, 0)
    assert landing.margin == 0
    # The same on a shallower dome is an ordinary ray.
    shallow = replace(optics, radius_mm=1.0)
    assert truth.world_to_panel(shallow, (-0.68, -0.93, 0.0), (-1.44, 1.23, -0.13)).margin > 1e-3


# --- reversibility --------------------------------------------------------------------------------


def test_way_back_to_1e_40():
    rng = random.Random(7)
    good = 0
    while good < 60:
        optics = random_optics(rng)
        u, v, a, b = random_ray(rng, optics)
        ray = truth.trace(optics, u, v, a, b)
        if ray.status not in {OK, CROSSTALK}:
            continue
        good += 1
        x, y, off = truth.back_to_panel(optics, ray.origin, ray.direction, ray.lenslet)
        assert far((x, y, off), (*truth.panel_point(optics, u, v)[:2], 0)) < TINY
        if ray.margin > 1e-20:
            # The same through the front door, from somewhere else on the ray's line.
            start = [o + 7 * d for o, d in zip(ray.origin, ray.direction, strict=True)]
            landing = truth.world_to_panel(optics, start, [-d for d in ray.direction])
            assert (landing.status, landing.lenslet) == (ray.status, ray.lenslet)
            assert far(landing.pixel, (u, v)) < TINY


def test_way_back_tells_how_far_the_origin_was_off():
    for side, lift in itertools.product(SIDES, (1e-9, -1e-9)):
        optics = replace(PLAIN, plano_side=side)
        ray = truth.trace(optics, 53, 38, 0.1, 0.2)
        moved = [o + mp.mpf(lift) * d for o, d in zip(ray.origin, ray.direction, strict=True)]
        x, y, off = truth.back_to_panel(optics, moved, ray.direction, ray.lenslet)
        assert far((x, y), truth.panel_point(optics, 53, 38)[:2]) < TINY
        # Moved along the ray, off the face by the cosine of the angle to its normal.
        assert far([off], [abs(lift) * ray.cos_theta_t]) < 1e-17


def test_way_back_refuses_rays_from_nowhere():
    with pytest.raises(ValueError, match="misses the dome"):
        truth.back_to_panel(PLAIN, (9.0, 0, 0), (0, 0, 1), (0, 0))
    with pytest.raises(ValueError, match="total internal reflection"):
        truth.back_to_panel(STEEP, (0.7, 0, -0.55), (-0.999, 0, 0.03), (0, 0))


# --- closed cases ---------------------------------------------------------------------------------


def crossing(side: str, index: float, thickness: float, h) -> object:
    """Distance behind the last vertex at which a ray parallel to the axis at height h crosses it.

    The plano side to the panel is the flat face first.
    """
    optics = replace(PLAIN, plano_side=side, index=index, thickness_mm=thickness)
    ray = truth.trace(optics, 50 + h * 16, 40, a=h)
    z_last = 0 if side == "panel" else mp.mpf(thickness)
    return ray.origin[2] - z_last - ray.origin[0] * ray.direction[2] / ray.direction[0]


@pytest.mark.parametrize("index", [1.33, 1.5, 1.9])
@pytest.mark.parametrize("thickness", [0.4, 2.0])
@pytest.mark.parametrize(("side", "first"), [("panel", "flat"), ("viewer", "curved")])
def test_focus_and_third_order_aberration(index, thickness, side, first):
    h = mp.mpf(10) ** -8
    focus = truth.back_focal_length(1.5, index, thickness, first)
    lsa = truth.third_order_longitudinal_aberration(1.5, index, thickness, h, first)
    shift = crossing(side, index, thickness, h) - focus
    assert abs(shift) < 1e-13
    assert abs(shift / lsa - 1) < 1e-13  # the fifth order is h^2 smaller


def test_textbook_numbers_of_the_thin_lens():
    """n = 1.5: 4.5 and 7/6 times h^2 / f, flat and curved face first."""
    f = truth.lensmaker_focal_length(1.5, 1.5)
    assert f == 3
    for first, factor in (("flat", mp.mpf(9) / 2), ("curved", mp.mpf(7) / 6)):
        lsa = truth.third_order_longitudinal_aberration(1.5, 1.5, 0, 0.25, first)
        assert far([lsa], [-factor / 16 / f]) < TINY
    assert truth.back_focal_length(1.5, 1.5, 2.0, "flat") == 3
    assert far([truth.back_focal_length(1.5, 1.5, 2.0, "curved")], [mp.mpf(5) / 3]) < TINY


# --- longdouble -----------------------------------------------------------------------------------


@long_needed
def test_longdouble_way_back_agrees_with_50_digits():
    rng = random.Random(3)
    cases = []
    while len(cases) < 150:
        optics = random_optics(rng)
        ray = truth.trace(optics, *random_ray(rng, optics))
        if ray.status in {OK, CROSSTALK} and ray.cos_theta_t > 0.01:
            # Floats, as an engine hands them over: rounded, so off the face and not quite unit.
            origin, direction = [float(q) for q in ray.origin], [float(q) for q in ray.direction]
            cases.append((optics, origin, direction, ray.lenslet))
    every = [optics for optics, *_ in cases]
    points, off = truth.back_to_panel_many(
        [origin for _, origin, _, _ in cases],
        [direction for _, _, direction, _ in cases],
        [lenslet for *_, lenslet in cases],
        hexagonal=[o.grid == "hex" for o in every],
        plano_viewer=[o.plano_side == "viewer" for o in every],
        **{name: [getattr(o, name) for o in every] for name in (*LENS, "rotation_rad", "offset_mm")},
    )
    assert points.dtype == np.longdouble
    for (optics, origin, direction, lenslet), xy, d in zip(cases, points, off, strict=True):
        exact = truth.back_to_panel(optics, origin, direction, lenslet)
        # str keeps all digits of a longdouble; float would not.
        got = [mp.mpf(str(q)) for q in (*xy, d)]
        assert far(got, exact) < 1e-15


@long_needed
def test_longdouble_takes_one_display_for_all_and_marks_lost_rays():
    ray = truth.trace(PLAIN, 53, 38, 0.1, 0.2)
    points, off = truth.back_to_panel_many(
        np.array([[float(q) for q in ray.origin], [9.0, 0.0, 0.0]]),
        np.array([[float(q) for q in ray.direction], [0.0, 0.0, 1.0]]),
        np.array([ray.lenslet, (0, 0)]),
        **{"hexagonal": False, "plano_viewer": False, **LENS},
    )
    assert far([float(q) for q in points[0]], truth.panel_point(PLAIN, 53, 38)[:2]) < 1e-14
    assert off[0] < 1e-15
    assert np.isnan(points[1]).all()


# --- rayoptics ------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("grid", GRIDS)
def test_rayoptics_agrees_with_50_digits(grid, side):
    pytest.importorskip("rayoptics")
    rng = random.Random(9)
    good = 0
    while good < 40:
        optics = replace(random_optics(rng), grid=grid, plano_side=side)
        optics = replace(optics, offset_mm=(0.0, 0.0), rotation_rad=0.0)
        if optics.radius_mm * 1.4 < optics.pitch_mm:  # drawn for a hexagon, too small for a square
            continue
        half = optics.pitch_mm / 2
        x, y, a, b = (rng.uniform(-half, half) for _ in range(4))
        u, v = truth.pixel_of(optics, x, y)
        ray = truth.trace(optics, u, v, a, b)
        if ray.status != OK or ray.lenslet != (0, 0) or ray.cos_theta_t < 0.1:
            continue
        good += 1
        d = truth.chief_or_aperture_direction(optics, x, y, (0, 0), a, b)
        origin, direction, status = sequential_lenslet(optics).trace([(x, y)], [[float(q) for q in d]])
        assert status[0] == 0
        # Rounding of the inputs is magnified where a ray leaves near grazing, hence cos > 0.1.
        assert far(origin[0], ray.origin) < 1e-13 * (optics.thickness_mm + optics.gap_mm + half)
        assert far(direction[0], ray.direction) < 1e-13


def test_rayoptics_reflects_where_truth_does():
    pytest.importorskip("rayoptics")
    h = STEEP.radius_mm / STEEP.index
    points = [(h * 0.999, 0.0), (h * 1.001, 0.0), (STEEP.radius_mm * 1.01, 0.0)]
    *_, status = sequential_lenslet(STEEP).trace(points, [(0.0, 0.0, 1.0)] * 3)
    assert status.tolist() == [0, 2, 1]


def test_rayoptics_comes_without_qt_and_matplotlib():
    pytest.importorskip("rayoptics")
    code = (
        "import sys, independent, truth\n"
        "lens = independent.sequential_lenslet(truth.Optics("
        "9, 9, 0.1, 'square', 1.0, 1.5, 1.5, 2.0, 0.5, 'panel'))\n"
        "lens.trace([(0.1, 0.0)], [(0.0, 0.0, 1.0)])\n"
        "tops = {name.partition('.')[0].lower() for name in sys.modules}\n"
        "print(sorted(tops & {'pyside6', 'qtpy', 'qtconsole', 'ipython', 'matplotlib', 'pandas',"
        " 'opticalglass', 'lippmann'}))\n"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"

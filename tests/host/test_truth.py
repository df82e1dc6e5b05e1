"""truth.py's turns by hand, and its first meeting by marching. That the rest is right follows from its users.

The golden engine, rayoptics and `lippmann.conformance.fifty_digits` share no code with it, and agree.
"""

import itertools
import math
import random
from dataclasses import replace

import pytest
import truth
from truth import CROSSTALK, OK, REFLECTED, Optics, mp

GRIDS = ("square", "hex")
SIDES = ("panel", "viewer")
LENS = {"pitch_mm": 1.0, "radius_mm": 1.5, "index": 1.5, "thickness_mm": 2.0, "gap_mm": 0.5}
PLAIN = Optics(width_px=100, height_px=80, pixel_pitch_mm=0.0625, grid="square", plano_side="panel", **LENS)
#: A dome as steep as 100 % fill allows, of dense glass: total reflection at every face.
STEEP = replace(PLAIN, radius_mm=0.72, index=1.9)
TINY = mp.mpf(10) ** -40


def far(p, q):
    """The largest difference of two vectors' components."""
    return max(abs(a - b) for a, b in zip(p, q, strict=True))


def test_centres_and_aperture_points_turn_with_the_array():
    """By hand: a quarter turn counter-clockwise carries (a, 0) to (0, a) of the panel."""
    optics = replace(PLAIN, rotation_rad=mp.pi / 2, offset_mm=(0.25, 0.5))
    assert far(truth.centre_of(optics, (2, 0)), (0.25, 2.5)) < TINY
    d = truth.chief_or_aperture_direction(optics, 0.25, 0.5, (0, 0), 0.375, 0)
    depth = mp.mpf(1) / 2 + mp.mpf(4) / 3
    assert far([d[0], d[1] / d[2]], [0, mp.mpf(0.375) / depth]) < TINY


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


def test_marching_finds_the_same_first_meeting():
    """Small steps against the plain height field find the lenslet, and nothing on the way out."""
    rng = random.Random(5)
    wanted = itertools.product(SIDES, GRIDS, (OK, REFLECTED, CROSSTALK))
    left = dict.fromkeys(wanted, 2)
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

"""Step 5: the point where a ray meets a dome, and the step to the next lenslet's dome (rtl/optics)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lippmann.display.description import Grid
from lippmann.fixed.roots import sqrt
from lippmann.fixed.words import (
    GUARD,
    Bools,
    Ints,
    above_one,
    beyond,
    extra_bits,
    fits,
    guarded,
    halved,
    multiplier,
    saturate,
    wrapped,
)


class Meeting(NamedTuple):
    """Unit normal N at the point met (near words), cosine to it, squared sine (F + 3 fraction bits).

    `missed` where the ray passes the sphere by, `beyond` where a word wraps or saturates.
    """

    nx: Ints
    ny: Ints
    nz: Ints
    cos: Ints
    s: Ints
    missed: Bools
    beyond: Bools


def meet_dome(
    hx: Ints, hy: Ints, dx: Ints, dy: Ints, dz: Ints, depth: int, depth_rest: int, f: int, upward: bool
) -> Meeting:
    """Meet the unit sphere around the origin with rays from V = (hx, hy, zc).

    Words as integers, a b >> k the product that `multiplier` cuts by k places, M = 2^(F+3) - 1:

        b    = ((hx dx >> F-4+E) + (hy dy >> F-4+E) + (zc dz >> F-4+3E) + 1) >> 1
        C    = (1 - zc^2) - (hx hx >> F-3) - (hy hy >> F-3) + (b b >> F+5)
        cos  = sqrt(min(max(C, 0), M)),  s = min(max(2^(F+3) - C, 0), M)
        l    = (8 cos - b + 8) >> 4,  downward (-8 cos - b + 8) >> 4, missed (2^(F+3) - b + 8) >> 4
        N_x  = saturate(((hx << 4) + (l dx >> F-3+E) + 4) >> 3),  N_y likewise
        N_z  = saturate(((zc << 4) + (l dz >> F-3+3E) + 4) >> 3)

    dx and dy are near words with E = `extra_bits` more fraction bits, dz has 3 E more. b has F + 4 fraction bits, C and
    s have F + 3, l has F. Missed: C < 0. Beyond: b or l outside its word, C above 1
    or, unless missed, a coordinate of N outside [-1, 1], by more than roundings. Upward zc is `depth` and `depth_rest`
    is 1 - zc^2. Downward zc = 1, and `dz` is |dz|: its products are cut, then subtracted.
    A ray that passes the sphere by downward goes on for half a radius from its point nearest to the centre.
    """
    near, wide, far, foot = f + 2, f + 3, f + 4, f + 8
    extra = extra_bits(f)
    near_d, axial = near + extra, near + 3 * extra
    drop = f - 1 - GUARD
    total = multiplier(hx, dx, wide, near_d, drop + extra) + multiplier(hy, dy, wide, near_d, drop + extra)
    along = (
        multiplier(np.int64(depth) + 0 * dz, dz, far, axial, drop + 3 * extra) if upward else -(dz << 4 >> 3 * extra)
    )
    b = halved(total + along)
    over = ~fits(b, foot)
    b = wrapped(b, foot)

    drop = f - 3
    h2 = multiplier(hx, hx, wide, wide, drop) + multiplier(hy, hy, wide, wide, drop)
    square = (depth_rest if upward else 0) - h2
    c = wrapped(square + multiplier(b, b, foot, foot, drop + 8), 2 * far - drop)
    top = (1 << (f + 3)) - 1
    cos = sqrt(np.clip(c, 0, top), f)
    s = np.clip((1 << (f + 3)) - c, 0, top)
    s = np.where(c > top, 0, s)

    missed = c < 0
    length = ((8 * cos if upward else np.where(missed, 1 << (f + 3), -8 * cos)) - b + 8) >> 4
    over = over | ~fits(length, far) | above_one(c, f)
    length = wrapped(length, far)
    drop = f - GUARD
    lx, ly = (multiplier(length, d, far, near_d, drop + extra) for d in (dx, dy))
    lz = multiplier(length, dz, far, axial, drop + 3 * extra)
    z = (np.int64(depth) << (GUARD + 1)) + lz if upward else (1 << (f + 1 + GUARD)) - lz
    point = [guarded(n) for n in ((hx << (GUARD + 1)) + lx, (hy << (GUARD + 1)) + ly, z)]
    over = over | (~missed & np.any([beyond(n, near) for n in point], axis=0))
    nx, ny, nz = (saturate(n, near) for n in point)
    return Meeting(nx, ny, nz, cos, s, missed, over)


def cell_step(
    nx: Ints, ny: Ints, half: int, half_y: int, rise: int, lean: int, grid: Grid, f: int, shear: bool
) -> tuple[Ints, Ints, Bools]:
    """Return the step (di, dj), and a mask of the points inside their own cell.

    Near words, `half` is px / (2 R), `half_y` py / (2 R); `rise` is h = (sqrt(3)/2) px / py - s / 2, a word of W + 2
    bits and F + 1 fraction bits; `lean` is the shear s, a wide word. Square: the sign of each of q0 and q1 = ny that is
    outside [-half, half) or [-half_y, half_y). Hexagonal: across the flat with the largest of |q0|, |q1|, |q2|, where
    q1 = nx / 2 + h ny, q2 = q1 - q0, and |q| is ~q below 0. q0 is nx, in a build with `shear` nx - s ny. As integers,
    a b >> k the product that `multiplier` cuts by k places:

        q0   = ((nx << 3) - (ny s >> F-3) + 4) >> 3
        q1   = ((ny m >> F-2) + (nx << 2) + (n ny << 3) + 4) >> 3,  h = n 2^(F+1) + m

    with 0 <= m < 2^(F+1).
    """
    word = f + 2
    q0 = guarded((nx << GUARD) - multiplier(ny, lean, word, word, f - GUARD)) if shear else nx

    def side(q: Ints, half: int) -> Ints:
        return np.where(q >= half, 1, np.where(q < -half, -1, 0))

    if grid == "square":
        di, dj = side(q0, half), side(ny, half_y)
        return di, dj, (di == 0) & (dj == 0)
    units, part = rise >> (f + 1), rise & ((1 << (f + 1)) - 1)
    climb = multiplier(ny, part, word, word, f + 1 - GUARD) + (units * ny << GUARD)
    q = np.stack([q0, guarded(climb + (nx << (GUARD - 1))), np.zeros_like(nx)])
    q[2] = q[1] - q[0]
    inside = (np.stack([side(k, half) for k in q]) == 0).all(axis=0)
    size = np.where(q < 0, ~q, q)
    sign = np.where(q < 0, -1, 1)
    first = np.where((size[0] >= size[1]) & (size[0] >= size[2]), 0, np.where(size[1] >= size[2], 1, 2))
    di = np.where(first == 0, sign[0], np.where(first == 2, -sign[2], 0))
    dj = np.where(first == 1, sign[1], np.where(first == 2, sign[2], 0))
    return np.where(inside, 0, di), np.where(inside, 0, dj), inside


def move_lenslet(
    hx: Ints, hy: Ints, di: Ints, dj: Ints, cx: int, cy: int, rx: int, grid: Grid, f: int, shear: bool
) -> tuple[Ints, Ints, Bools]:
    """Return (hx - di cx - dj rx, hy - dj cy), F fraction bits, and where a word does not hold it.

    Without `shear` rx is 0 on a square grid, and floor(cx / 2) on a hexagonal one.
    """
    if not shear:
        rx = cx >> 1 if grid == "hex" else 0
    word = f + 3
    hx, hy = hx - di * cx - dj * rx, hy - dj * cy
    return wrapped(hx, word), wrapped(hy, word), ~fits(hx, word) | ~fits(hy, word)

"""Step 5: the point where the ray meets the dome (rtl/optics/lipp_meet_dome.sv)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.saturate import beyond, saturate
from lippmann.fixed.sqrt import sqrt
from lippmann.fixed.words import GUARD, Bools, Ints, above_one, extra_bits, fits, guarded, halved, wrapped


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
    rest = (depth_rest if upward else 0) - h2
    c = wrapped(rest + multiplier(b, b, foot, foot, drop + 8), 2 * far - drop)
    most = (1 << (f + 3)) - 1
    cos = sqrt(np.clip(c, 0, most), f)
    s = np.clip((1 << (f + 3)) - c, 0, most)
    s = np.where(c > most, 0, s)

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

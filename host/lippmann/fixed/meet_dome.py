"""Step 5: the point where the ray meets the dome (rtl/optics/meet_dome.sv)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.saturate import saturate
from lippmann.fixed.sqrt import sqrt
from lippmann.fixed.words import GUARD, Bools, Ints, guarded, halved, wrapped


class Meeting(NamedTuple):
    """Unit normal N at the point met (near words), cosine to it, squared sine (F + 3 fraction bits), missed."""

    nx: Ints
    ny: Ints
    nz: Ints
    cos: Ints
    s: Ints
    missed: Bools


def meet_dome(
    hx: Ints, hy: Ints, dx: Ints, dy: Ints, dz: Ints, depth: int, depth_rest: int, f: int, upward: bool
) -> Meeting:
    """Meet the unit sphere around the origin with rays from V = (hx, hy, zc).

    Words as integers, a b >> k the product that `multiplier` cuts by k places, M = 2^(F+3) - 1:

        b    = ((hx dx >> F-2) + (hy dy >> F-2) + (zc dz >> F-2) + 1) >> 1
        C    = (1 - zc^2) - (hx hx >> F-3) - (hy hy >> F-3) + (b b >> F+1)
        cos  = sqrt(min(max(C, 0), M)),  s = min(max(2^(F+3) - C, 0), M)
        l    = (2 cos - b + 2) >> 2,  downward (-2 cos - b + 2) >> 2
        N_x  = saturate(((hx << 4) + (l dx >> F-3) + 4) >> 3),  N_y likewise
        N_z  = saturate(((zc << 4) + (l dz >> F-3) + 4) >> 3)

    b has F + 2 fraction bits, C and s have F + 3, l has F. Missed: C < 0. Upward zc is `depth` and `depth_rest`
    is 1 - zc^2. Downward zc = 1, and `dz` is |dz|: its products are cut, then subtracted.
    """
    near, point, far, foot = f + 2, f + 3, f + 4, f + 6
    drop = f + 1 - GUARD
    total = multiplier(hx, dx, point, near, drop) + multiplier(hy, dy, point, near, drop)
    along = multiplier(np.int64(depth) + 0 * dz, dz, far, near, drop) if upward else -(dz << (GUARD - 1))
    b = wrapped(halved(total + along), foot)

    drop = f - 3
    h2 = multiplier(hx, hx, point, point, drop) + multiplier(hy, hy, point, point, drop)
    rest = (depth_rest if upward else 0) - h2
    c = wrapped(rest + multiplier(b, b, foot, foot, drop + 4), 2 * far - drop)
    most = (1 << (f + 3)) - 1
    cos = sqrt(np.clip(c, 0, most), f)
    s = np.clip((1 << (f + 3)) - c, 0, most)
    s = np.where(c > most, 0, s)

    length = wrapped(((2 * cos if upward else -2 * cos) - b + 2) >> 2, far)
    drop = f - GUARD
    lx, ly, lz = (multiplier(length, d, far, near, drop) for d in (dx, dy, dz))
    nx = saturate(guarded((hx << (GUARD + 1)) + lx), near)
    ny = saturate(guarded((hy << (GUARD + 1)) + ly), near)
    z = (np.int64(depth) << (GUARD + 1)) + lz if upward else (1 << (f + 1 + GUARD)) - lz
    return Meeting(nx, ny, saturate(guarded(z), near), cos, s, c < 0)

"""Step 5: the ray meets the dome (rtl/optics/meet_dome.sv)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.saturate import saturate
from lippmann.fixed.sqrt import sqrt
from lippmann.fixed.words import GUARD, Ints, guarded, halved, wrapped


class Meeting(NamedTuple):
    """Unit normal N at the point met (near words), cosine to it, squared sine (F + 3 fraction bits), missed."""

    nx: Ints
    ny: Ints
    nz: Ints
    cos: Ints
    s: Ints
    missed: npt.NDArray[np.bool_]


def meet_dome(
    hx: Ints, hy: Ints, dx: Ints, dy: Ints, dz: Ints, depth: int, depth_rest: int, f: int, upward: bool
) -> Meeting:
    """Meet the unit sphere around the origin with rays from V = (hx, hy, zc); the formulas are the RTL module's.

    Upward zc is `depth` and `depth_rest` 1 - zc^2; downward zc = 1 and dz is the size of the direction's part.
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

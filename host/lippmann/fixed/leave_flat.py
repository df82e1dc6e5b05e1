"""Step 6, plano side to the viewer: to the flat face and out of it (rtl/optics/leave_flat.sv)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lippmann.fixed.enter_flat import left_of_unit
from lippmann.fixed.leave_dome import cosine_behind
from lippmann.fixed.meet_dome import Meeting
from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.rsqrt import rsqrt
from lippmann.fixed.saturate import saturate
from lippmann.fixed.words import GUARD, Bools, Ints, guarded, halved, wrapped


class FlatExit(NamedTuple):
    """Point on the flat face (F + 1 fraction bits, far words' width), direction (near words), reflected."""

    x: Ints
    y: Ints
    dx: Ints
    dy: Ints
    dz: Ints
    reflected: Bools


def leave_flat(met: Meeting, dx: Ints, dy: Ints, depth: int, index: int, index_square: int, f: int) -> FlatExit:
    """Carry rays in the glass from the dome to the flat face and refract them.

    Words as integers, a b >> k the product that `multiplier` cuts by k places, M = 2^(F+3) - 1:

        g    = max((dx dx >> F-3) + (dy dy >> F-3), 0) >> 2
        y    = M - g
        r    = min(rsqrt(y), 2^(F+1) - 1)
        u    = (N_z + 1 - 2 zc) >> 1
        l    = ((u r >> F-1) + 1) >> 1
        X    = ((N_x << 3) + (l dx >> F-3) + 4) >> 3,  Y likewise
        C'   = 2^(F+3) - (g n2 >> F)
        d'_x = saturate(((dx n >> F-3) + 4) >> 3),  d'_y likewise
        d'_z = sqrt(min(max(C', 0), M)),  reflected ((y r >> F+1) + 1) >> 1

    g, y and C' have F + 3 fraction bits, and rsqrt reads y as 4 y: r = 1 / (2 dz). u is the remaining depth and l the
    length, both far words; zc = 1 - T/R (`depth`), n2 is n^2 (`index_square`). Reflected where C' <= 0; such a ray
    keeps its direction in the glass.
    """
    near, far = f + 2, f + 4
    rest = left_of_unit(dx, dy, f)
    half_inverse = np.minimum(rsqrt(rest, f), (1 << (f + 1)) - 1)  # 1 does not fit a near word
    to_go = wrapped((met.nz + (1 - 2 * depth)) >> 1, far)
    path = wrapped(halved(multiplier(to_go, half_inverse, far, near, f - 1)), far)
    drop = f - GUARD
    x = wrapped(guarded((met.nx << GUARD) + multiplier(path, dx, far, near, drop)), far)
    y = wrapped(guarded((met.ny << GUARD) + multiplier(path, dy, far, near, drop)), far)

    g = ((1 << (f + 3)) - 1) - rest
    c, dz_air = cosine_behind(g, index_square, f)
    dx_air = saturate(guarded(multiplier(dx, index, near, near + 1, drop)), near)
    dy_air = saturate(guarded(multiplier(dy, index, near, near + 1, drop)), near)
    dz_glass = wrapped(halved(multiplier(rest, half_inverse, far, near, f + 1)), near)
    reflected = c <= 0
    return FlatExit(
        x,
        y,
        np.where(reflected, dx, dx_air),
        np.where(reflected, dy, dy_air),
        np.where(reflected, dz_glass, dz_air),
        reflected,
    )

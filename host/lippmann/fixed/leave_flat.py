"""Step 6, plano side to the viewer: to the flat face and out of it (rtl/optics/lipp_leave_flat.sv)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lippmann.fixed.enter_flat import below_quarter, left_of_unit
from lippmann.fixed.leave_dome import cosine_behind
from lippmann.fixed.meet_dome import Meeting
from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.rsqrt import rsqrt
from lippmann.fixed.saturate import beyond, saturate
from lippmann.fixed.words import GUARD, Bools, Ints, above_one, fits, guarded, halved, wrapped


class FlatExit(NamedTuple):
    """Point on the flat face (F + 1 fraction bits, far words' width), direction (near words), reflected, overflow."""

    x: Ints
    y: Ints
    dx: Ints
    dy: Ints
    dz: Ints
    reflected: Bools
    beyond: Bools


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
    keeps its direction in the glass. Overflow: g 1 or more, C' above 1, or, unless reflected, y below 1/4, which
    `rsqrt` does not take, u, l, X or Y outside its word, or d'_x or d'_y outside [-1, 1], by more than roundings.
    """
    near, far = f + 2, f + 4
    rest, over = left_of_unit(dx, dy, f)
    half_inverse = np.minimum(rsqrt(rest, f), (1 << (f + 1)) - 1)  # 1 does not fit a near word
    to_go = (met.nz + (1 - 2 * depth)) >> 1
    path = halved(multiplier(wrapped(to_go, far), half_inverse, far, near, f - 1))
    drop = f - GUARD
    x, y = (
        guarded((n << GUARD) + multiplier(wrapped(path, far), d, far, near, drop))
        for n, d in ((met.nx, dx), (met.ny, dy))
    )

    g = ((1 << (f + 3)) - 1) - rest
    c, dz_air = cosine_behind(g, index_square, f)
    dx_air, dy_air = (guarded(multiplier(d, index, near, near + 1, drop)) for d in (dx, dy))
    dz_glass = wrapped(halved(multiplier(rest, half_inverse, far, near, f + 1)), near)
    reflected = c <= 0
    lost = np.any([~fits(w, far) for w in (to_go, path, x, y)], axis=0) | below_quarter(rest, f)
    over = over | above_one(c, f) | (~reflected & (lost | beyond(dx_air, near) | beyond(dy_air, near)))
    return FlatExit(
        wrapped(x, far),
        wrapped(y, far),
        np.where(reflected, dx, saturate(dx_air, near)),
        np.where(reflected, dy, saturate(dy_air, near)),
        np.where(reflected, dz_glass, dz_air),
        reflected,
        over,
    )

"""Step 6: refraction out of the glass, at a dome or at the flat face (rtl/optics)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lippmann.fixed.enter_glass import below_quarter, cosine_behind, left_of_unit
from lippmann.fixed.meet_dome import Meeting
from lippmann.fixed.roots import rsqrt
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


def leave_dome(
    met: Meeting, ex: Ints, ey: Ints, dz: Ints, index: int, index_square: int, f: int
) -> tuple[Ints, Ints, Ints, Bools, Bools]:
    """Return the direction in the air (near words), and masks of the rays that are totally reflected, and of overflow.

    Words as integers, a b >> k the product that `multiplier` cuts by k places, M = 2^(F+3) - 1:

        C'   = 2^(F+3) - (s n2 >> F)
        cos' = sqrt(min(max(C', 0), M))
        k    = (4 cos' - (cos n >> F-2) + 4) >> 3
        d'_x = saturate(((e_x << 3-E) + (k N_x >> F-3) + 4) >> 3),  d'_y likewise
        d'_z = saturate(((dz n >> F-3+3E) + (k N_z >> F-3) + 4) >> 3)

    e_x and e_y have E = `extra_bits` more fraction bits than near words, dz has 3 E more. s = 1 - cos^2 and C' have
    F + 3 fraction bits, k is a wide word, n2 is n^2. Totally reflected: C' <= 0. Overflow: C' above 1, or, unless
    reflected, k outside its word or the direction outside [-1, 1], by more than roundings.
    """
    near = f + 2
    c, cos_air = cosine_behind(met.s, index_square, f)
    glass = multiplier(met.cos, index, near, near + 1, f - 2)
    bend = guarded((cos_air << 2) - glass)
    over = ~fits(bend, near)
    bend = wrapped(bend, near)
    drop, extra = f - GUARD, extra_bits(f)
    kx, ky, kz = (multiplier(bend, n, near, near, drop) for n in (met.nx, met.ny, met.nz))
    axial = multiplier(dz, index, near + 3 * extra, near + 1, drop + 3 * extra)
    out = [guarded(d) for d in ((ex << (GUARD - extra)) + kx, (ey << (GUARD - extra)) + ky, axial + kz)]
    reflected = c <= 0
    over = above_one(c, f) | (~reflected & (over | np.any([beyond(d, near) for d in out], axis=0)))
    dx, dy, dz = (saturate(d, near) for d in out)
    return dx, dy, dz, reflected, over


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
    square, over = left_of_unit(dx, dy, f)
    half_inverse = np.minimum(rsqrt(square, f), (1 << (f + 1)) - 1)  # 1 does not fit a near word
    to_go = (met.nz + (1 - 2 * depth)) >> 1
    path = halved(multiplier(wrapped(to_go, far), half_inverse, far, near, f - 1))
    drop = f - GUARD
    x, y = (
        guarded((n << GUARD) + multiplier(wrapped(path, far), d, far, near, drop))
        for n, d in ((met.nx, dx), (met.ny, dy))
    )

    g = ((1 << (f + 3)) - 1) - square
    c, dz_air = cosine_behind(g, index_square, f)
    dx_air, dy_air = (guarded(multiplier(d, index, near, near + 1, drop)) for d in (dx, dy))
    dz_glass = wrapped(halved(multiplier(square, half_inverse, far, near, f + 1)), near)
    reflected = c <= 0
    lost = np.any([~fits(w, far) for w in (to_go, path, x, y)], axis=0) | below_quarter(square, f)
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

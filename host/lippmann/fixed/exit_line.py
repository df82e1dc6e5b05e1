"""From an exit ray to its line in the array's frame (rtl/scene/lipp_exit_line.sv)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.quadratic import quadratic
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.words import MUL_BITS, Bools, Ints, fits, guarded, wrapped
from lippmann.optics.rays import gets_through

#: Fraction bits of the lattice's words, and of a lenslet's index on its way to the multiplier.
LATTICE_FRACTION = 30
_INDEX_SHIFT = 6


class Lines(NamedTuple):
    """Lines (N,): where they meet the plane z = 0, radii (F - 3 fraction bits), slopes (F + 1), and which draw."""

    x: Ints
    y: Ints
    slope_x: Ints
    slope_y: Ints
    draws: Bools


def exit_line(rays: FixedRays, xi: int, xj: int, yj: int, f: int) -> Lines:
    """Return the lines of exit rays; `xi`, `xj` and `yj` are the lattice's words, 30 fraction bits.

    Words as integers, a b >> k the product that `multiplier` cuts by k places, q the reciprocal root of 4 dz:

        r        = q q >> F+2                                    1 / dz, F + 4 fraction bits
        slope_x  = ((dx r >> F+1) + 4) >> 3,  slope_y likewise    F + 1 fraction bits
        x_o      = ((xi i >> 31-F) + (xj j >> 31-F) + (x >> 2) - (slope_x z >> F+3) + 2) >> 2
        y_o      = ((yj j >> 31-F) + (y >> 2) - (slope_y z >> F+3) + 2) >> 2

    A ray draws when it has an exit, dz is 1/4 or more, and x_o and y_o are in [-2048, 2048).
    """
    length, inverse = f + 4, f + 8
    q = quadratic((rays.dz & ((1 << (f + 1)) - 1)) << 2, "reciprocal", f)
    r = wrapped(multiplier(q, q, f + 6, f + 6, f + 2), inverse)
    slope_x, slope_y = (wrapped(guarded(multiplier(d, r, f + 2, inverse, f + 1)), length) for d in (rays.dx, rays.dy))

    drop = LATTICE_FRACTION + _INDEX_SHIFT + 1 - f

    def centre(lattice: int, index: Ints) -> Ints:
        return multiplier(np.asarray(lattice, np.int64), index << _INDEX_SHIFT, 32, MUL_BITS, drop)

    centres = centre(xi, rays.i) + centre(xj, rays.j), centre(yj, rays.j)
    places = []
    for c, local, slope in zip(centres, (rays.x, rays.y), (slope_x, slope_y), strict=True):
        places.append((c + (local >> 2) - multiplier(slope, rays.z, length, length, f + 3) + 2) >> 2)
    bits = f + 9
    draws = gets_through(rays.status) & (rays.dz >= 1 << (f - 1)) & fits(places[0], bits) & fits(places[1], bits)
    x, y = (wrapped(place, bits) for place in places)
    return Lines(x, y, slope_x, slope_y, np.asarray(draws))

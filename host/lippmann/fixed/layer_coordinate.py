"""The texture coordinate at which a ray's line meets a layer (rtl/scene/lipp_layer_coordinate.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.fixed.exit_line import Lines
from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.scene_words import LayerWords
from lippmann.fixed.words import Bools, Ints, fits, wrapped

#: Bits of a coordinate, and its fraction bits.
COORDINATE_BITS, COORDINATE_FRACTION = 20, 8
#: Half a texel less half a unit of the coordinate, 16 fraction bits: what bilinear coordinates are moved by.
_BILINEAR = (1 << 7) - (1 << 15)


def coefficient_bits(f: int) -> int:
    """Return A, the fraction bits that a build reads of the 24 of a coefficient."""
    return min(f + 4, 24)


def layer_coordinate(lines: Lines, layer: LayerWords, bilinear: bool, f: int) -> tuple[Ints, Ints, Bools]:
    """Return the coordinates s, t (8 fraction bits) where lines meet a layer, and which are beyond the words' range.

    Words as integers, a b >> k the product that `multiplier` cuts by k places:

        X'  = (2 (infinite ? 0 : x) + 1 + (depth slope_x >> F)) >> 1       F - 3 fraction bits
        Y'  = (2 (infinite ? 0 : y) + 1 + (depth slope_y >> F)) >> 1
        s_o = (s0 + h + (a X' >> A+F-19) + (b Y' >> A+F-19)) >> 8           8 fraction bits
        t_o = (t0 + h + (c X' >> A+F-19) + (d Y' >> A+F-19)) >> 8

    with depth in F - 3 of its fraction bits, a to d in A; h = 2^7 - 2^15 for bilinear, else 0.
    """
    bits, fraction = f + 9, coefficient_bits(f)
    depth = np.asarray(layer.depth >> (23 - f), np.int64)
    plane, beyond = [], np.zeros(lines.x.shape, np.bool_)
    for place, slope in ((lines.x, lines.slope_x), (lines.y, lines.slope_y)):
        start = np.zeros_like(place) if layer.infinite else place
        met = (2 * start + 1 + multiplier(depth, slope, bits, f + 4, f)) >> 1
        beyond = beyond | ~fits(met, bits)
        plane.append(wrapped(met, bits))

    coordinates = []
    for zero, *factors in ((layer.s0, layer.a, layer.b), (layer.t0, layer.c, layer.d)):
        total = np.full_like(lines.x, zero + (_BILINEAR if bilinear else 0))
        for factor, at in zip(factors, plane, strict=True):
            word = np.asarray(factor >> (24 - fraction), np.int64)
            total += multiplier(word, at, fraction + 8, bits, fraction + f - 19)
        total >>= 8
        beyond = beyond | ~fits(total, COORDINATE_BITS)
        coordinates.append(wrapped(total, COORDINATE_BITS))
    return coordinates[0], coordinates[1], np.asarray(beyond)

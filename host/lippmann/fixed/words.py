"""Define fixed-point word formats, and the twin's rounding, saturation, products and roots.

F is the number of fraction bits of an RTL build, and W = F + 2. Near words have W bits,
F + 1 of them fraction bits, and span [-1, 1). Wide words have W bits, F of them fraction
bits, and span [-2, 2). Far words have W + 2 bits, F of them fraction bits, and span
[-8, 8).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]

#: Bits and fraction bits of a signed pixel coordinate, from the panel's centre.
PIXEL_BITS = 18
PIXEL_FRACTION = 4
#: Bits and fraction bits of signed coefficients and offsets that map pixels to the lattice.
SLOPE_BITS = 35
SLOPE_FRACTION = 36
OFFSET_BITS = 52
OFFSET_FRACTION = 40
#: Bits of a signed lenslet index.
INDEX_BITS = 12
#: Bits of a signed operand of a hardware multiplier.
MUL_BITS = 18
#: Guard bits that a step keeps until its final rounding.
GUARD = 3
#: Last-bit units by which rounding errors can exceed the range of a word, and of a square.
SLACK, SQUARE_SLACK = 1 << 6, 1 << 9
#: Allowed numbers of fraction bits F.
FRACTIONS = range(14, 24)
#: Fraction bits of the widest RTL build, and of the compact build.
WIDEST, COMPACT = 23, 16


def extra_bits(f: int) -> int:
    """Return E, the extra bits of slopes and lateral directions: 0 if words fit a multiplier, else 1.

    Only exact builds with the plano side to the panel use E; dz has 3 E extra bits.
    """
    return 1 if f + 2 > MUL_BITS else 0


def share_bits(f: int) -> int:
    """Return the word width of converge_share (F + 11 fraction bits) and converge_x, converge_y (F + 2)."""
    return f + 9


def guarded(x: Ints, more: int = 0) -> Ints:
    """Round from 3 to K = `more` guard bits, as (x + (4 >> K)) >> (3 - K)."""
    return (x + (1 << (GUARD - 1) >> more)) >> (GUARD - more)


def halved(x: Ints) -> Ints:
    """Halve a number and round it: floor((x + 1) / 2)."""
    return (x + 1) >> 1


def wrapped(x: Ints, bits: int) -> Ints:
    """Return the lowest `bits` bits of a number as a signed number."""
    half = 1 << (bits - 1)
    return ((x + half) & ((1 << bits) - 1)) - half


def above_one(square: Ints, f: int) -> Bools:
    """Mark squared cosines, F + 3 fraction bits, that exceed 1 by more than rounding errors."""
    return square >= (1 << (f + 3)) + SQUARE_SLACK


def fits(x: Ints | npt.NDArray[np.float64], bits: int) -> Bools:
    """Mark the numbers that fit a signed word of `bits` bits."""
    return (x >= -(1 << (bits - 1))) & (x < 1 << (bits - 1))


def saturate(x: Ints, bits: int) -> Ints:
    """Clip numbers to the range of a signed word of `bits` bits."""
    return np.clip(x, -(1 << (bits - 1)), (1 << (bits - 1)) - 1)


def beyond(x: Ints, bits: int, slack: int = SLACK) -> Bools:
    """Mark the numbers more than `slack` units outside a signed word's range."""
    top = 1 << (bits - 1)
    return (x < -top - slack) | (x >= top + slack)


def multiplier(a: Ints, b: Ints | int, a_bits: int, b_bits: int, drop: int) -> Ints:
    """Multiply two words, omit the product of their lower parts, and truncate `drop` bits.

    Each word is split: a = ah 2^la + al, where la is the number of bits beyond 18, and
    b likewise:

        (ah bh >> drop-la-lb) + ((ah bl 2^la + al bh 2^lb) >> drop)
    """
    b = np.asarray(b, np.int64)
    la, lb = max(a_bits - MUL_BITS, 0), max(b_bits - MUL_BITS, 0)
    ah, bh = a >> la, b >> lb
    al, bl = a - (ah << la), b - (bh << lb)
    upper: Ints = (ah * bh) >> (drop - la - lb)
    cross: Ints = (ah * bl << la) + (al * bh << lb)
    return upper + (cross >> drop)


# ---- roots by tables of quadratics (rtl/math) ----

Root = Literal["reciprocal", "square"]


@dataclass(frozen=True)
class RootTable:
    """Coefficients of the quadratics that approximate a root, one per segment.

    c0 has F + 4 fraction bits, c1 has `slope_fraction` fraction bits, and c2 has two
    more than c1. A position in a segment has `place_bits` bits.
    """

    segment_bits: int
    place_bits: int
    slope_fraction: int
    c0: Ints
    c1: Ints
    c2: Ints


@cache
def root_table(root: Root, f: int) -> RootTable:
    """Return quadratics that interpolate a root at each segment's Chebyshev nodes, 0 and +-sqrt(3)/4."""
    a = f // 3
    place_bits = min(f + 2 - a, MUL_BITS)
    slope_fraction = min(a + 18, f + 4)
    node = math.sqrt(3.0) / 4.0

    def at(segment: int, z: float) -> float:
        m = 1.0 + (segment % (1 << a) + 0.5 + z) / (1 << a)
        x = m if segment < 1 << a else 2.0 * m
        return 1.0 / math.sqrt(x) if root == "reciprocal" else 0.5 * math.sqrt(x)

    def words(values: list[float], fraction: int) -> Ints:
        scaled = np.array(values) * float(1 << fraction)
        return np.trunc(scaled + np.copysign(0.5, scaled)).astype(np.int64)

    segments = range(2 << a)
    slopes = [(at(k, node) - at(k, -node)) / (2.0 * node) for k in segments]
    bends = [(at(k, node) + at(k, -node) - 2.0 * at(k, 0.0)) * (8.0 / 3.0) for k in segments]
    return RootTable(
        a,
        place_bits,
        slope_fraction,
        words([at(k, 0.0) for k in segments], f + 4),
        words(slopes, slope_fraction),
        words(bends, slope_fraction + 2),
    )


def quadratic(x: Ints, root: Root, f: int) -> Ints:
    """Return the root y (F + 4 fraction bits) of x in [1, 4) (F + 1 fraction bits) from the table.

    z is the position in the segment; c2 z has one fraction bit more than c1:

        slope = c1 + ((floor(c2 z) + 1) >> 1),  y = c0 + floor(slope z)
    """
    table = root_table(root, f)
    a, d, s1 = table.segment_bits, table.place_bits, table.slope_fraction
    upper = x >> (f + 2)
    fraction = np.where(upper == 1, x & ((1 << (f + 2)) - 1), (x & ((1 << (f + 1)) - 1)) << 1)
    segment = (upper << a) + (fraction >> (f + 2 - a))
    place = ((fraction >> (f + 2 - a - d)) & ((1 << d) - 1)) - (1 << (d - 1))
    bend = multiplier(table.c2[segment], place, s1 + 3 - 2 * a, d, d + 1)
    slope = table.c1[segment] + halved(bend)
    return table.c0[segment] + multiplier(slope, place, s1 - a, d, s1 + d - (f + 4))


def rsqrt(x: Ints, f: int, extra: int = 0) -> Ints:
    """Return 1 / sqrt(x), with `extra` more bits (at most 3), for x in [1, 4) with F + 1 fraction bits.

    K is `extra`, and q is the result of `quadratic`:

        y    = (q + (4 >> K)) >> (3 - K).
    """
    return guarded(quadratic(x, "reciprocal", f), extra)


def sqrt(x: Ints, f: int, normalise: bool = True, extra: int = 0) -> Ints:
    """Return sqrt(x), a near word with `extra` more bits (at most 3), for x in [0, 1) with F + 3 fraction bits.

    K is `extra`, and q is the root (`quadratic`) of 4^k x in [1/4, 1). k is at most 15,
    and 0 if `normalise` is false. The root of 0 is 0; else

        y    = min(((q >> k) + (4 >> K)) >> (3 - K), 2^(F+1+K) - 1).
    """
    k = np.zeros_like(x)
    if normalise:
        for step in (8, 4, 2, 1):
            clear = (x >> (f + 3 - 2 * step)) == 0
            x = np.where(clear, (x << 2 * step) & ((1 << (f + 3)) - 1), x)
            k = k + np.where(clear, step, 0)
    root = quadratic(x, "square", f) >> k
    if normalise:
        root = np.where(x == 0, 0, root)
    return np.minimum(guarded(root, extra), (1 << (f + 1 + extra)) - 1)

"""Formats of fixed-point words, integer operations of all steps, and roots.

F is a build's number of fraction bits and W = F + 2 the bits of its words. `near` words
have F + 1 fraction bits and span [-1, 1); `wide` words have F and span [-2, 2). `far`
words have W + 2 bits, F of them fraction bits: [-8, 8).
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

#: Pixel coordinates: signed, 4 fraction bits, from the panel's centre.
PIXEL_BITS = 18
PIXEL_FRACTION = 4
#: Affine coefficients and offsets: signed, with 36 and 40 fraction bits.
SLOPE_BITS = 35
SLOPE_FRACTION = 36
OFFSET_BITS = 52
OFFSET_FRACTION = 40
#: Lenslet indices: signed.
INDEX_BITS = 12
#: Operands of one hardware multiplier: signed.
MUL_BITS = 18
#: Bits kept below the last place until a step's final rounding.
GUARD = 3
#: Units by which rounding may move a saturated word, a clamped square out of its range.
SLACK, SQUARE_SLACK = 1 << 6, 1 << 9
#: Fraction bits that the RTL can be built with.
FRACTIONS = range(14, 24)
#: Fraction bits of the widest and compact configurations.
WIDEST, COMPACT = 23, 16


def extra_bits(f: int) -> int:
    """Return E, the additional bits of slopes and lateral directions if words exceed a multiplier's.

    Only exact builds with the plano side to the panel have them; there dz has 3 E.
    """
    return 1 if f + 2 > MUL_BITS else 0


def share_bits(f: int) -> int:
    """Return the bits of the words of `converge`: its share has F + 11 fraction bits, its offsets F + 2."""
    return f + 9


def guarded(x: Ints, more: int = 0) -> Ints:
    """Round all guard bits but K = `more` away: (x + (4 >> K)) >> (3 - K)."""
    return (x + (1 << (GUARD - 1) >> more)) >> (GUARD - more)


def halved(x: Ints) -> Ints:
    """Round one bit away: floor((x + 1) / 2)."""
    return (x + 1) >> 1


def wrapped(x: Ints, bits: int) -> Ints:
    """Return the lowest bits of a word as a signed number."""
    half = 1 << (bits - 1)
    return ((x + half) & ((1 << bits) - 1)) - half


def above_one(square: Ints, f: int) -> Bools:
    """Tell which squared cosines, F + 3 fraction bits, are above 1 by more than rounding error."""
    return square >= (1 << (f + 3)) + SQUARE_SLACK


def fits(x: Ints | npt.NDArray[np.float64], bits: int) -> Bools:
    """Tell which numbers fit a signed word."""
    return (x >= -(1 << (bits - 1))) & (x < 1 << (bits - 1))


def saturate(x: Ints, bits: int) -> Ints:
    """Return the nearest numbers that fit a signed word."""
    return np.clip(x, -(1 << (bits - 1)), (1 << (bits - 1)) - 1)


def beyond(x: Ints, bits: int, slack: int = SLACK) -> Bools:
    """Tell which numbers are more than `slack` units outside a signed word's range."""
    top = 1 << (bits - 1)
    return (x < -top - slack) | (x >= top + slack)


def multiplier(a: Ints, b: Ints | int, a_bits: int, b_bits: int, drop: int) -> Ints:
    """Return the product of two words without its last `drop` bits, and without that of their lower parts.

    With a = ah 2^la + al, where la are a's bits beyond 18, and b likewise:

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
    """Coefficients of a root's segments in both octaves.

    c0 has F + 4 fraction bits, c1 `slope_fraction` and c2 two more; a place in a
    segment has `place_bits` bits.
    """

    segment_bits: int
    place_bits: int
    slope_fraction: int
    c0: Ints
    c1: Ints
    c2: Ints


@cache
def root_table(root: Root, f: int) -> RootTable:
    """Return the quadratics that equal a root at the Chebyshev nodes 0 and +-sqrt(3)/4 of each segment [-1/2, 1/2)."""
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
    """Return the root y, F + 4 fraction bits, of x in [1, 4), F + 1 fraction bits.

    c2 z has one bit below c1's last; z is the place in the segment:

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
    """Return 1 / sqrt(x) in [1/2, 1], with `extra` more bits (up to 3), of x in [1, 4) with F + 1 fraction bits.

    With K = `extra` and q from `quadratic`:

        y    = (q + (4 >> K)) >> (3 - K).
    """
    return guarded(quadratic(x, "reciprocal", f), extra)


def sqrt(x: Ints, f: int, normalise: bool = True, extra: int = 0) -> Ints:
    """Return sqrt(x), a near word with `extra` more bits (up to 3), of x in [0, 1) with F + 3 fraction bits.

    With K = `extra` and the root q (`quadratic`) of 4^k x in [1/4, 1), where k is at
    most 15, and 0 without `normalise`; 0 gives 0:

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

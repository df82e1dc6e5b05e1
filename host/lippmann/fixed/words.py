"""Formats of the fixed-point words, the integer operations that all steps share, and the roots.

F is the number of fraction bits of a build, W = F + 2 its word: `near` words have F + 1 fraction bits and span
[-1, 1), `wide` words F and [-2, 2), `far` words W + 2 bits with F fraction bits, [-8, 8). A pixel's point from its
lenslet's centre is a wide word, in a build with `converge` a far one.
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
#: Bits kept below the last place until the final rounding of a step.
GUARD = 3
#: Roundings may bring a saturated word, or a clamped square (F + 3 fraction bits), this many units beyond its range.
SLACK, SQUARE_SLACK = 1 << 6, 1 << 9
#: Fraction bits that the RTL can be built with.
FRACTIONS = range(14, 24)
#: Fraction bits of the configurations named widest and compact.
WIDEST, COMPACT = 23, 16


def extra_bits(f: int) -> int:
    """Return E, the bits more of slopes and directions on their way into the glass: where words take more than a cell.

    They are in exact builds with the plano side to the panel: slopes and lateral directions have E, dz has 3 E.
    """
    return 1 if f + 2 > MUL_BITS else 0


def share_bits(f: int) -> int:
    """Return the bits of the words of `converge`: a share with F + 11 fraction bits, and offsets with F + 2."""
    return f + 9


def guarded(x: Ints, more: int = 0) -> Ints:
    """Round the guard bits away, but for K that are kept: (x + (4 >> K)) >> (3 - K)."""
    return (x + (1 << (GUARD - 1) >> more)) >> (GUARD - more)


def halved(x: Ints) -> Ints:
    """Round one bit away: floor((x + 1) / 2)."""
    return (x + 1) >> 1


def wrapped(x: Ints, bits: int) -> Ints:
    """Keep the lowest bits of a word as a signed number, as a register does."""
    half = 1 << (bits - 1)
    return ((x + half) & ((1 << bits) - 1)) - half


def above_one(square: Ints, f: int) -> Bools:
    """Tell which squared cosines, F + 3 fraction bits, are above 1 by more than roundings."""
    return square >= (1 << (f + 3)) + SQUARE_SLACK


def fits(x: Ints | npt.NDArray[np.float64], bits: int) -> Bools:
    """Tell which numbers a signed word of so many bits can hold."""
    return (x >= -(1 << (bits - 1))) & (x < 1 << (bits - 1))


def saturate(x: Ints, bits: int) -> Ints:
    """Return the number nearest to `x` that a signed word of `bits` bits can hold."""
    return np.clip(x, -(1 << (bits - 1)), (1 << (bits - 1)) - 1)


def beyond(x: Ints, bits: int, slack: int = SLACK) -> Bools:
    """Tell which numbers are outside a signed word's range by more than `slack` units."""
    top = 1 << (bits - 1)
    return (x < -top - slack) | (x >= top + slack)


def multiplier(a: Ints, b: Ints | int, a_bits: int, b_bits: int, drop: int) -> Ints:
    """Return the product of two words less its last `drop` places, without the product of their lower parts.

    With a = ah 2^la + al, la the bits beyond 18: floor(ah bh 2^(la + lb) / 2^drop) plus
    floor((ah bl 2^la + al bh 2^lb) / 2^drop).
    """
    b = np.asarray(b, np.int64)
    la, lb = max(a_bits - MUL_BITS, 0), max(b_bits - MUL_BITS, 0)
    ah, bh = a >> la, b >> lb
    al, bl = a - (ah << la), b - (bh << lb)
    upper: Ints = (ah * bh) >> (drop - la - lb)
    cross: Ints = (ah * bl << la) + (al * bh << lb)
    product: Ints = upper + (cross >> drop)
    return product


# ---- roots by tables of quadratics (rtl/math/lipp_quadratic.sv, lipp_rsqrt.sv, lipp_sqrt.sv) ----

Root = Literal["reciprocal", "square"]


@dataclass(frozen=True)
class RootTable:
    """Coefficients of a root's segments, both octaves, and the formats that go with them.

    c0 has F + 4 fraction bits, c1 `slope_fraction`, c2 two more; a segment's place has `place_bits`.
    """

    segment_bits: int
    place_bits: int
    slope_fraction: int
    c0: Ints
    c1: Ints
    c2: Ints


@cache
def root_table(root: Root, f: int) -> RootTable:
    """Return the table of a root for F fraction bits.

    The quadratic through the root at the Chebyshev nodes z = 0, +-sqrt(3)/4 of each segment, z in [-1/2, 1/2).
    """
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
        return np.where(scaled < 0.0, -np.floor(0.5 - scaled), np.floor(scaled + 0.5)).astype(np.int64)

    segments = range(2 << a)
    return RootTable(
        a,
        place_bits,
        slope_fraction,
        words([at(k, 0.0) for k in segments], f + 4),
        words([(at(k, node) - at(k, -node)) / (2.0 * node) for k in segments], slope_fraction),
        words([(at(k, node) + at(k, -node) - 2.0 * at(k, 0.0)) * (8.0 / 3.0) for k in segments], slope_fraction + 2),
    )


def quadratic(x: Ints, root: Root, f: int) -> Ints:
    """Return the root with F + 4 fraction bits of x, F + 1 fraction bits, in [1, 4).

    slope = c1 + floor((floor(c2 z) + 1) / 2), one bit kept below c1's last; y = c0 + floor(slope z).
    """
    table = root_table(root, f)
    a, d, s1 = table.segment_bits, table.place_bits, table.slope_fraction
    upper = x >> (f + 2)
    fraction = np.where(upper == 1, x & ((1 << (f + 2)) - 1), (x & ((1 << (f + 1)) - 1)) << 1)
    segment = (upper << a) + (fraction >> (f + 2 - a))
    place = ((fraction >> (f + 2 - a - d)) & ((1 << d) - 1)) - (1 << (d - 1))
    turn = multiplier(table.c2[segment], place, s1 + 3 - 2 * a, d, d + 1)
    slope = table.c1[segment] + ((turn + 1) >> 1)
    return table.c0[segment] + multiplier(slope, place, s1 - a, d, s1 + d - (f + 4))


def rsqrt(x: Ints, f: int, extra: int = 0) -> Ints:
    """Return 1 / sqrt(x), F + 1 + K fraction bits and in [1/2, 1], of x in [1, 4) with F + 1 fraction bits.

    K is `extra`, up to 3. With q from `quadratic`:

        y    = (q + (4 >> K)) >> (3 - K)
    """
    return guarded(quadratic(x, "reciprocal", f), extra)


def sqrt(x: Ints, f: int, normalise: bool = True, extra: int = 0) -> Ints:
    """Return sqrt(x), a near word, of x in [0, 1) with F + 3 fraction bits; [1/4, 1) unless `normalise`.

    The root has K = `extra` more bits, up to 3. 4^k x is brought up to [1/4, 1), k at most 15, and its root q
    (`quadratic`) shifted back by k; 0 gives 0:

        y    = min(((q >> k) + (4 >> K)) >> (3 - K), 2^(F+1+K) - 1)
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

"""Formats of the fixed-point words, and the integer operations that all steps share.

F is the number of fraction bits of a build, W = F + 2 its word: `near` words have F + 1 fraction bits and span
[-1, 1), `wide` words F and [-2, 2), `far` words W + 2 bits with F fraction bits, [-8, 8). A pixel's point from its
lenslet's centre is a wide word, in a build with `converge` a far one.
"""

from __future__ import annotations

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

"""Step 3, displays for a near eye: the pixel measured from its lenslet's centre (rtl/optics/converge.sv)."""

from __future__ import annotations

from typing import NamedTuple

from lippmann.display import Grid
from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.words import MUL_BITS, Bools, Ints, fits, share_bits, wrapped


class Converged(NamedTuple):
    """The pixel's point from the lenslet's centre, F + 4 bits; `beyond` where they do not hold it."""

    x: Ints
    y: Ints
    beyond: Bools


def converge(
    i: Ints, j: Ints, x: Ints, y: Ints, share: int, offset_x: int, offset_y: int, grid: Grid, f: int
) -> Converged:
    """Add the lenslet's own part, s (C - A), to points that the line to the eye has in its cell.

    Words as integers, a b >> k the product that `multiplier` cuts by k places, C = (2 i + j, 2 j) half pitches and rows
    (square: (2 i, 2 j)):

        t_x  = (x << 2) + (16 C_x s >> 14) + o_x + 2,   x' = t_x >> 2,   y' likewise

    s has F + 11 fraction bits; o = -s A has F + 2.
    """

    def measured(point: Ints, half_steps: Ints, offset: int) -> Ints:
        product = multiplier(half_steps << 4, share, MUL_BITS, share_bits(f), 14)
        return ((point << 2) + product + offset + 2) >> 2

    x = measured(x, 2 * i + j if grid == "hex" else 2 * i, offset_x)
    y = measured(y, 2 * j, offset_y)
    word = f + 4
    return Converged(wrapped(x, word), wrapped(y, word), ~fits(x, word) | ~fits(y, word))

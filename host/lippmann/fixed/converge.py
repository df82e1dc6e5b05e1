"""Step 3, displays for a near eye: the pixel measured from its lenslet's centre (rtl/optics/lipp_converge.sv)."""

from __future__ import annotations

from typing import NamedTuple

from lippmann.display.description import Grid
from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.words import MUL_BITS, Bools, Ints, fits, share_bits, wrapped


class Converged(NamedTuple):
    """The pixel's point from the lenslet's centre, words of F + 4 bits; `beyond` where it overflows them."""

    x: Ints
    y: Ints
    beyond: Bools


def converge(
    i: Ints, j: Ints, x: Ints, y: Ints, share: int, offset_x: int, offset_y: int, grid: Grid, f: int
) -> Converged:
    """Add s (C - A) to the points where the lines from the pixels to the eye cross their lenslets' cells.

    C is the lenslet's centre, A the point in front of the eye. Words are integers; a b >> k is the product that
    `multiplier` cuts by k places. In half pitches and half rows C is (2 i + j, 2 j), on the square grid (2 i, 2 j):

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

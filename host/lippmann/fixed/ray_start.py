"""Step 3: a ray's point at its lenslet, its slope and its unit direction (rtl/optics)."""

from __future__ import annotations

import numpy as np

from lippmann.display.description import Grid
from lippmann.fixed.roots import rsqrt
from lippmann.fixed.words import GUARD, MUL_BITS, Bools, Ints, fits, guarded, multiplier, share_bits, wrapped


def converge(
    i: Ints, j: Ints, x: Ints, y: Ints, share: int, offset_x: int, offset_y: int, grid: Grid, f: int
) -> tuple[Ints, Ints, Bools]:
    """Add s (C - A) to the points where the lines from the pixels to the eye cross their lenslets' cells.

    Return the pixels' points from their lenslets' centres, words of F + 4 bits, and where these do not hold them.

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
    return wrapped(x, word), wrapped(y, word), ~fits(x, word) | ~fits(y, word)


def shear(x: Ints, y: Ints, g: int, f: int, bits: int) -> tuple[Ints, Bools]:
    """Return x + g y, F + 4 bits, and where these do not hold it; x and y of `bits` bits, in pitches and rows.

    g is a far word.

    Words as integers, y g >> k the product that `multiplier` cuts by k places:

        x'   = ((x << 3) + (y g >> F-3) + 4) >> 3
    """
    word = f + 4
    total = guarded((x << GUARD) + multiplier(y, g, bits, word, f - GUARD))
    return wrapped(total, word), ~fits(total, word)


def blend(
    k: int,
    x: Ints,
    l: int,  # noqa: E741
    a: Ints | None,
    f: int,
    y_bits: int,
    x_bits: int = 0,
    a_bits: int = 0,
    extra: int = 0,
) -> tuple[Ints, Bools]:
    """Return k x + l a, without `a` the first product alone, and where its `y_bits` do not hold it.

    Factors are wide words, with `extra` more fraction bits, as y then has; x has `x_bits` bits where that is given, and
    a `a_bits`, both F fraction bits. Words as integers, a b >> k the
    product that `multiplier` cuts by k places:

        y    = ((k x >> F-3) + (l a >> F-3) + 4) >> 3
    """
    word = f + 2
    total = multiplier(x, k, x_bits or word, word + extra, f - GUARD)
    if a is not None:
        total = total + multiplier(a, l, a_bits or word, word + extra, f - GUARD)
    y = guarded(total)
    return wrapped(y, y_bits), ~fits(y, y_bits)


def unit_slope(mx: Ints, my: Ints, f: int, extra: int = 0) -> tuple[Ints, Ints, Ints, Bools]:
    """Return (m_x, m_y, 1) / sqrt(1 + m^2), near words, of a slope in wide words, and where m^2 >= 3.

    All have E = `extra` more fraction bits than such words. Words as integers, a b >> k the product that `multiplier`
    cuts by k places:

        x    = ((m_x m_x >> F-4+2E) + (m_y m_y >> F-4+2E) + 2^(F+4) + 4) >> 3
        e_z  = min(rsqrt(x), 2^(F+1+E) - 1)
        e_x  = ((m_x e_z >> F-3+E) + 4) >> 3,  e_y likewise

    Those slopes, 60 degrees and more, overflow: x and e_x keep their lowest bits, as the registers do.
    """
    word, drop = f + 2 + extra, f - 4 + 2 * extra
    square = multiplier(mx, mx, word, word, drop) + multiplier(my, my, word, word, drop)
    x = guarded(square) + (1 << (f + 1))
    beyond = x >= 1 << (f + 3)
    ez = np.minimum(rsqrt(x & ((1 << (f + 3)) - 1), f, extra), (1 << (f + 1 + extra)) - 1)  # 1 does not fit a near word
    ex = wrapped(guarded(multiplier(mx, ez, word, word, f - GUARD + extra)), word)
    ey = wrapped(guarded(multiplier(my, ez, word, word, f - GUARD + extra)), word)
    return ex, ey, ez, beyond

"""Compute steps 1 to 3 of a ray (rtl/optics): lenslet, point, slope and direction.

The last mask that a function returns marks rays with a word that overflows and wraps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lippmann.display.description import Grid
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.words import (
    GUARD,
    INDEX_BITS,
    MUL_BITS,
    OFFSET_BITS,
    SLOPE_BITS,
    Bools,
    Ints,
    fits,
    guarded,
    multiplier,
    rsqrt,
    share_bits,
    wrapped,
)

LOW_BITS = SLOPE_BITS - MUL_BITS


def pixel_to_lattice(u: Ints, v: Ints, from_u: int, from_v: int, offset: int, f: int) -> tuple[Ints, Bools]:
    """Return one lattice coordinate (F fraction bits) of pixels at (u, v) from the panel's centre.

    Each coefficient and offset is 2^17 ah + al, so that products fit a multiplier:

        hi   = (u ah_u + v ah_v) + oh,  lo = (u al_u + v al_v) + ol
        x    = floor((hi + floor(lo / 2^17)) / 2^(23 - F))
    """
    mask = (1 << LOW_BITS) - 1
    hi = u * (from_u >> LOW_BITS) + v * (from_v >> LOW_BITS) + (offset >> LOW_BITS)
    lo = u * (from_u & mask) + v * (from_v & mask) + (offset & mask)
    total = hi + (lo >> LOW_BITS)
    return wrapped(total >> (23 - f), INDEX_BITS + f), ~fits(total, OFFSET_BITS - LOW_BITS)


def lenslet_square(x: Ints, y: Ints, f: int) -> tuple[Ints, Ints, Ints, Ints, Bools]:
    """Return the indices (i, j), i = floor(x + 1/2), of a point's lenslet, and the point relative to the lenslet."""
    half = 1 << (f - 1)
    i, j = (x + half) >> f, (y + half) >> f
    beyond = ~fits(i, INDEX_BITS) | ~fits(j, INDEX_BITS)
    return wrapped(i, INDEX_BITS), wrapped(j, INDEX_BITS), x - (i << f), y - (j << f), beyond


def lenslet_hex(x: Ints, y: Ints, f: int) -> tuple[Ints, Ints, Ints, Ints, Bools]:
    """Return the same values as `lenslet_square`, for a hexagonal lattice."""
    # q0 and q1 select the nearest of the four lattice points around (s, t) = (x - y / 2, y).
    s = 2 * x - y  # s has F + 1 fraction bits
    i, j = s >> (f + 1), y >> f
    fs, ft = s - (i << (f + 1)), y - (j << f)
    q0, q1 = fs + ft, fs + 4 * ft  # q0 in units of 2^-(F + 1), q1 of 2^-(F + 2)
    near = (q0 < 1 << f) & (q1 < 1 << (f + 1))
    far = (q0 >= 1 << (f + 1)) & (q1 >= 1 << (f + 2))
    right = 2 * ft < fs
    di = (~near & (far | right)).astype(np.int64)
    dj = (~near & (far | ~right)).astype(np.int64)
    local_x = (q0 >> 1) - (di << f) - (dj << (f - 1))
    i, j = i + di, j + dj
    beyond = ~fits(i, INDEX_BITS) | ~fits(j, INDEX_BITS)
    return wrapped(i, INDEX_BITS), wrapped(j, INDEX_BITS), local_x, ft - (dj << f), beyond


def pixel_to_lenslet(
    u: Ints, v: Ints, config: Configuration, grid: Grid, f: int
) -> tuple[Ints, Ints, Ints, Ints, Bools]:
    """Return the same values as `lenslet_square`, for pixels at (u, v) from the panel's centre."""
    x, beyond_x = pixel_to_lattice(u, v, config.x_from_u, config.x_from_v, config.x_offset, f)
    y, beyond_y = pixel_to_lattice(u, v, config.y_from_u, config.y_from_v, config.y_offset, f)
    i, j, x, y, beyond = (lenslet_hex if grid == "hex" else lenslet_square)(x, y, f)
    return i, j, x, y, beyond | beyond_x | beyond_y


class Aimed(NamedTuple):
    """Lenslet (i, j) that a ray aims at; pixel (x, y) and aperture point (a, b) from the lenslet's centre."""

    i: Ints
    j: Ints
    x: Ints
    y: Ints
    a: Ints
    b: Ints
    stray: Bools
    beyond: Bools


def aim(i: Ints, j: Ints, x: Ints, y: Ints, a: Ints, b: Ints, grid: Grid, f: int) -> Aimed:
    """Express rays, in wide words, relative to the lenslet whose cell contains the aperture point.

    `stray` marks rays whose lenslet is not the pixel's lenslet.
    """
    di, dj, a, b, _ = (lenslet_hex if grid == "hex" else lenslet_square)(a, b, f)
    i, j = i + di, j + dj
    x = x - (di << f) - ((dj << (f - 1)) if grid == "hex" else 0)
    y = y - (dj << f)
    word, stray = f + 2, (di != 0) | (dj != 0)
    beyond = ~fits(x, word) | ~fits(y, word) | ~fits(i, INDEX_BITS) | ~fits(j, INDEX_BITS)
    i, j, x, y = wrapped(i, INDEX_BITS), wrapped(j, INDEX_BITS), wrapped(x, word), wrapped(y, word)
    return Aimed(i, j, x, y, a, b, stray, beyond)


def extent(i: Ints, j: Ints, along: int, across: int, grid: Grid) -> Bools:
    """Mark lenslets beyond the array: |2 i + j| > along (square: |2 i|), or |j| > across."""
    return (np.abs(2 * i + j if grid == "hex" else 2 * i) > along) | (np.abs(j) > across)


def converge(
    i: Ints, j: Ints, x: Ints, y: Ints, share: int, offset_x: int, offset_y: int, grid: Grid, f: int
) -> tuple[Ints, Ints, Bools]:
    """Return pixels' positions from their lenslets' centres, times (1 - s), F + 4 bits.

    (x, y) is the point where the line from pixel to eye crosses the lenslet's cell. A
    is the panel point in front of the eye. C is the lenslet's centre in half pitches
    and half rows, (2 i + j, 2 j) or, on the square grid, (2 i, 2 j).

        t_x  = (x << 2) + (16 C_x s >> 14) + o_x + 2,   x' = t_x >> 2,   y' likewise.

    s is `share`, with F + 11 fraction bits; o = -s A has F + 2 fraction bits.
    """

    def measured(point: Ints, half_steps: Ints, offset: int) -> Ints:
        product = multiplier(half_steps << 4, share, MUL_BITS, share_bits(f), 14)
        return ((point << 2) + product + offset + 2) >> 2

    x = measured(x, 2 * i + j if grid == "hex" else 2 * i, offset_x)
    y = measured(y, 2 * j, offset_y)
    word = f + 4
    return wrapped(x, word), wrapped(y, word), ~fits(x, word) | ~fits(y, word)


def shear(x: Ints, y: Ints, g: int, f: int, bits: int) -> tuple[Ints, Bools]:
    """Return the sheared coordinate x + g y, F + 4 bits.

    g is a far word; x and y have `bits` bits.

        x'   = ((x << 3) + (y g >> F-3) + 4) >> 3.
    """
    word = f + 4
    total = guarded((x << GUARD) + multiplier(y, g, bits, word, f - GUARD))
    return wrapped(total, word), ~fits(total, word)


def blend(
    k: int, x: Ints, m: int, a: Ints | None, f: int, y_bits: int, x_bits: int, a_bits: int, extra: int = 0
) -> tuple[Ints, Bools]:
    """Return y = k x + m a, or k x if `a` is None.

    k, m and y have F + `extra` fraction bits, x and a have F. The formula writes l for
    m:

        y    = ((k x >> F-3) + (l a >> F-3) + 4) >> 3.
    """
    word = f + 2 + extra
    total = multiplier(x, k, x_bits, word, f - GUARD)
    if a is not None:
        total = total + multiplier(a, m, a_bits, word, f - GUARD)
    y = guarded(total)
    return wrapped(y, y_bits), ~fits(y, y_bits)


def unit_slope(mx: Ints, my: Ints, f: int, extra: int = 0) -> tuple[Ints, Ints, Ints, Bools]:
    """Return the directions (m_x, m_y, 1) / sqrt(1 + m^2), near words, of slopes in wide words.

    Slopes of 60 degrees or more, m^2 >= 3, overflow: x and e_x keep only their lowest
    bits, as in the RTL. All words have E = `extra` more fraction bits:

        x    = ((m_x m_x >> F-4+2E) + (m_y m_y >> F-4+2E) + 2^(F+4) + 4) >> 3
        e_z  = min(rsqrt(x), 2^(F+1+E) - 1)
        e_x  = ((m_x e_z >> F-3+E) + 4) >> 3,  e_y likewise.
    """
    word, drop = f + 2 + extra, f - 4 + 2 * extra
    square = multiplier(mx, mx, word, word, drop) + multiplier(my, my, word, word, drop)
    x = guarded(square) + (1 << (f + 1))
    beyond = x >= 1 << (f + 3)
    ez = rsqrt(x & ((1 << (f + 3)) - 1), f, extra)
    ez = np.minimum(ez, (1 << (f + 1 + extra)) - 1)  # the value 1 does not fit a near word
    ex = wrapped(guarded(multiplier(mx, ez, word, word, f - GUARD + extra)), word)
    ey = wrapped(guarded(multiplier(my, ez, word, word, f - GUARD + extra)), word)
    return ex, ey, ez, beyond

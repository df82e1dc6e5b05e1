"""Steps 1 to 3: from a pixel to the lenslet that its ray goes through (rtl/optics)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lippmann.display.description import Grid
from lippmann.fixed.words import INDEX_BITS, MUL_BITS, OFFSET_BITS, SLOPE_BITS, Bools, Ints, fits, wrapped

LOW_BITS = SLOPE_BITS - MUL_BITS


def pixel_to_lattice(u: Ints, v: Ints, from_u: int, from_v: int, offset: int, f: int) -> tuple[Ints, Bools]:
    """Return one lattice coordinate, F fraction bits, of pixels u, v with 4 fraction bits from the panel's centre.

    The mask tells where the sum is outside [-2048, 2048), and wraps.

    hi = (u ah_u + v ah_v) + oh and lo = (u al_u + v al_v) + ol, each coefficient 2^17 ah + al;
    floor((hi + floor(lo / 2^17)) / 2^(23 - F)).
    """
    mask = (1 << LOW_BITS) - 1
    hi = u * (from_u >> LOW_BITS) + v * (from_v >> LOW_BITS) + (offset >> LOW_BITS)
    lo = u * (from_u & mask) + v * (from_v & mask) + (offset & mask)
    total = hi + (lo >> LOW_BITS)
    return wrapped(total >> (23 - f), INDEX_BITS + f), ~fits(total, OFFSET_BITS - LOW_BITS)


def lenslet_square(x: Ints, y: Ints, f: int) -> tuple[Ints, Ints, Ints, Ints, Bools]:
    """Return indices i = floor(x + 1/2), j, and the point from that centre; lattice coordinates, F fraction bits.

    The mask tells where an index wraps.
    """
    half = 1 << (f - 1)
    i, j = (x + half) >> f, (y + half) >> f
    beyond = ~fits(i, INDEX_BITS) | ~fits(j, INDEX_BITS)
    return wrapped(i, INDEX_BITS), wrapped(j, INDEX_BITS), x - (i << f), y - (j << f), beyond


def lenslet_hex(x: Ints, y: Ints, f: int) -> tuple[Ints, Ints, Ints, Ints, Bools]:
    """Return indices i, j, and the point from that centre; x in pitches, y in rows, F fraction bits.

    With s = x - y/2 and t = y, fs and ft their fractions, (i, j) is the nearest corner of the lattice's parallelogram.
    q0 = fs + ft/2 and q1 = fs/2 + ft select it, as in the table of the RTL module.
    The mask tells where an index wraps.
    """
    s = 2 * x - y  # F + 1 fraction bits
    i, j = s >> (f + 1), y >> f
    fs, ft = s - (i << (f + 1)), y - (j << f)
    q0, q1 = fs + ft, fs + 4 * ft  # units of 2^-(F + 1) and 2^-(F + 2)
    near = (q0 < 1 << f) & (q1 < 1 << (f + 1))
    far = (q0 >= 1 << (f + 1)) & (q1 >= 1 << (f + 2))
    right = 2 * ft < fs
    di = (~near & (far | right)).astype(np.int64)
    dj = (~near & (far | ~right)).astype(np.int64)
    local_x = (q0 >> 1) - (di << f) - (dj << (f - 1))
    i, j = i + di, j + dj
    beyond = ~fits(i, INDEX_BITS) | ~fits(j, INDEX_BITS)
    return wrapped(i, INDEX_BITS), wrapped(j, INDEX_BITS), local_x, ft - (dj << f), beyond


class Aimed(NamedTuple):
    """Lenslet (i, j); the pixel's point and the aperture point from its centre; flags for another cell and overflow."""

    i: Ints
    j: Ints
    x: Ints
    y: Ints
    a: Ints
    b: Ints
    stray: Bools
    beyond: Bools


def aim(i: Ints, j: Ints, x: Ints, y: Ints, a: Ints, b: Ints, grid: Grid, f: int) -> Aimed:
    """Make rays local to the lenslet whose cell their aperture point is in, all words wide.

    x' = x - di (hexagonal: x - di - dj/2), y' = y - dj; `beyond` where they leave [-2, 2), or an index
    wraps.
    """
    locate = lenslet_hex if grid == "hex" else lenslet_square
    di, dj, a, b, _ = locate(a, b, f)
    i, j = i + di, j + dj
    x = x - (di << f) - ((dj << (f - 1)) if grid == "hex" else 0)
    y = y - (dj << f)
    word = f + 2
    return Aimed(
        wrapped(i, INDEX_BITS),
        wrapped(j, INDEX_BITS),
        wrapped(x, word),
        wrapped(y, word),
        a,
        b,
        (di != 0) | (dj != 0),
        ~fits(x, word) | ~fits(y, word) | ~fits(i, INDEX_BITS) | ~fits(j, INDEX_BITS),
    )


def extent(i: Ints, j: Ints, along: int, across: int, grid: Grid) -> Bools:
    """Tell which lenslets are missing: |2 i + j| > along (square: |2 i|), or |j| > across."""
    return (np.abs(2 * i + j if grid == "hex" else 2 * i) > along) | (np.abs(j) > across)

"""Step 3: the lenslet that a ray aims at (rtl/optics/lipp_aim.sv)."""

from __future__ import annotations

from typing import NamedTuple

from lippmann.display.description import Grid
from lippmann.fixed.lenslet_hex import lenslet_hex
from lippmann.fixed.lenslet_square import lenslet_square
from lippmann.fixed.words import INDEX_BITS, Bools, Ints, fits, wrapped


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

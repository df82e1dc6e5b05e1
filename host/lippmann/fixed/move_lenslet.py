"""Step 5: the ray's point measured from the next dome (rtl/optics/lipp_move_lenslet.sv)."""

from __future__ import annotations

from lippmann.display.description import Grid
from lippmann.fixed.words import Bools, Ints, fits, wrapped


def move_lenslet(
    hx: Ints, hy: Ints, di: Ints, dj: Ints, cx: int, cy: int, rx: int, grid: Grid, f: int, shear: bool
) -> tuple[Ints, Ints, Bools]:
    """Return (hx - di cx - dj rx, hy - dj cy), F fraction bits, and where a word does not hold it.

    Without `shear` rx is 0 on a square grid, and floor(cx / 2) on a hexagonal one.
    """
    if not shear:
        rx = cx >> 1 if grid == "hex" else 0
    word = f + 3
    hx, hy = hx - di * cx - dj * rx, hy - dj * cy
    return wrapped(hx, word), wrapped(hy, word), ~fits(hx, word) | ~fits(hy, word)

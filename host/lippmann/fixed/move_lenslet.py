"""Step 5: the ray's point measured from the next dome (rtl/optics/move_lenslet.sv)."""

from __future__ import annotations

from lippmann.display import Grid
from lippmann.fixed.words import Ints, wrapped


def move_lenslet(hx: Ints, hy: Ints, di: Ints, dj: Ints, cx: int, cy: int, grid: Grid, f: int) -> tuple[Ints, Ints]:
    """Return (hx - di cx - dj floor(cx / 2), hy - dj cy); the half only on a hexagonal grid. F fraction bits."""
    step_x = di * cx + (dj * (cx >> 1) if grid == "hex" else 0)
    return wrapped(hx - step_x, f + 3), wrapped(hy - dj * cy, f + 3)

"""Whether the array has a lenslet (rtl/optics/lipp_extent.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.display.description import Grid
from lippmann.fixed.words import Bools, Ints


def extent(i: Ints, j: Ints, along: int, across: int, grid: Grid) -> Bools:
    """Tell which lenslets are missing: |2 i + j| > along (square: |2 i|), or |j| > across."""
    return (np.abs(2 * i + j if grid == "hex" else 2 * i) > along) | (np.abs(j) > across)

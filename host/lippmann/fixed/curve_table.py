"""The panel's byte of linear light, by a table (rtl/scene/lipp_curve_table.sv)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lippmann.fixed.words import Ints

Bytes = npt.NDArray[np.uint8]

#: Entries of the table, and the light from which an entry stands for 16 words.
ENTRIES = 1 << 13
COARSE_FROM = 1 << 12
#: The word of white.
WHITE = 255 * 255


def curve_table(light: Ints, table: Bytes) -> Bytes:
    """Return the bytes of light.

    With L a word of light

        rgb_o = table[L < 4096 ? L : 4096 + (L >> 4)]        for each of red, green and blue
    """
    return table[np.where(light < COARSE_FROM, light, COARSE_FROM + (light >> 4))]


def entry_light() -> npt.NDArray[np.float64]:
    """Return the light (8192,), 1 at white, in the middle of the words of each entry."""
    entry = np.arange(ENTRIES)
    # Of an entry of 16 words, word 7.5 is in the middle.
    return np.where(entry < COARSE_FROM, entry, 16 * (entry - COARSE_FROM) + 7.5) / WHITE

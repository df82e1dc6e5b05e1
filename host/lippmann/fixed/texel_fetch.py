"""The colours of the texels at a layer's coordinates, and their weights (rtl/scene/lipp_texel_fetch.sv)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lippmann.fixed.scene_build import SceneBuild
from lippmann.fixed.words import Bools, Ints

Bytes = npt.NDArray[np.uint8]

#: Weight of a whole texel, opacity of an opaque one, and light that nothing took: 16 fraction bits.
WHOLE = 1 << 16


def texel_fetch(s: Ints, t: Ints, hidden: Bools, slot: Bytes | None, build: SceneBuild) -> tuple[Ints, Ints]:
    """Return the colours (N, taps, 4) of the texels at coordinates (N,), 8 fraction bits, and their weights (N, taps).

    `slot` is what the layer's slot holds: its texels row by row, then the palette; None: the layer has no slot. With
    i = s >> 8, j = t >> 8, f = s & 255, g = t & 255:

        nearest: the texel (i, j) has the weight 65536
        bilinear: the texels (i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1) have the weights
            (256 - f) (256 - g), f (256 - g), (256 - f) g, f g; tap 2 (row & 1) + (column & 1) is the one of that row
            and column

    Texels outside of the texture, and those of hidden rays, have the weight 0, and here the colour 0.
    """
    i, j = s >> 8, t >> 8
    if not build.bilinear:
        columns, rows, weights = i[:, None], j[:, None], np.full((len(s), 1), WHOLE)
    else:
        f, g = s & 255, t & 255
        columns, rows, weights = (np.empty((len(s), 4), np.int64) for _ in range(3))
        every = np.arange(len(s))
        for right, down in np.ndindex(2, 2):
            tap = 2 * ((j + down) & 1) + ((i + right) & 1)
            columns[every, tap], rows[every, tap] = i + right, j + down
            weights[every, tap] = (f if right else 256 - f) * (g if down else 256 - g)
    there = (columns >= 0) & (columns < build.width) & (rows >= 0) & (rows < build.height) & ~hidden[:, None]
    if slot is None:
        there = np.zeros_like(there)
        slot = np.zeros(build.slot_bytes, np.uint8)
    index = slot[np.where(there, rows * build.width + columns, 0)]
    palette = slot[build.texels :].reshape(256, 4)
    colours = np.where(there[..., None], palette[index], 0).astype(np.int64)
    return colours, np.where(there, weights, 0)

"""Turns each elemental image by 180 degrees, in whole pixels: what shows a captured scene in its right depth.

**The rule.** A cell's pixels are those whose centres the lattice gives to one lenslet. Turned about a point of the
half-pixel lattice, pixel (c, r) goes to pixel (m - c, n - r), with m and n whole: no pixel falls between two others.
The true centre (u, v) of a lenslet asks for m = 2u - 1 and n = 2v - 1, which are seldom whole. Of the pairs of whole
numbers within 1 of them a cell takes the pair that brings most of its pixels onto pixels of its own; among equals the
nearest one. Pixels of its rim that would leave the cell stay where they are.

So the map is an involution and a permutation of each cell's pixels, for every lattice, turned and moved ones too; the
turn's centre is at most half a pixel off the lenslet's in x and in y. On an unturned square lattice every cell
inside the picture is a rectangle of pixels, and all of it is turned.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.display import Display
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.panel import PanelFrame

#: Rounding of pixel coordinates, pixels.
ROUNDING = 1e-9

Indices = npt.NDArray[np.int64]


def cells_of(display: Display) -> tuple[Indices, npt.NDArray[np.float64]]:
    """Tell which cell each pixel of a panel is in.

    Returns
    -------
    cell
        (height * width,) numbers from 0, pixels row by row.
    centre
        (cells, 2) pixel coordinates of the lenslets' centres.
    """
    panel, frame = display.panel, PanelFrame.of(display)
    lattice = Lattice(display.array.grid, display.array.pitch_mm)
    row, column = np.divmod(np.arange(panel.width_px * panel.height_px), panel.width_px)
    x, y = frame.array_from_panel(*frame.panel_from_pixel(column + 0.5, row + 0.5))
    i, j, _, _ = lattice.locate(NumpyBackend(), x, y)
    i, j = i.astype(np.int64), j.astype(np.int64)
    span = int(np.ptp(j)) + 1
    key, cell = np.unique((i - i.min()) * span + (j - j.min()), return_inverse=True)
    i, j = np.divmod(key, span) + np.array([[i.min()], [j.min()]])
    x, y = frame.panel_from_array(*lattice.centre(i.astype(np.float64), j.astype(np.float64)))
    return cell, np.stack(frame.pixel_from_panel(x, y), axis=1)


def rotation_map(display: Display) -> Indices:
    """Return the pixel that each pixel changes places with, (height * width,) pixel numbers row by row."""
    width, height = display.panel.width_px, display.panel.height_px
    cell, centre = cells_of(display)
    pixel = np.arange(width * height)
    row, column = np.divmod(pixel, width)
    asked = 2.0 * centre - 1.0
    nearest = np.rint(asked)
    count = np.full(len(centre), -1)
    miss = np.full(len(centre), np.inf)
    partner = pixel.copy()
    for step in itertools.product((0, -1, 1), repeat=2):
        far = np.abs(nearest + step - asked)
        beside = far.max(axis=1) <= 1.0 + ROUNDING
        # Pixels of the cells for which this pair of whole numbers is beside the one that is asked for.
        some = np.flatnonzero(beside[cell])
        its_cell = cell[some]
        turn = (nearest + step).astype(np.int64)[its_cell]
        to_column, to_row = turn[:, 0] - column[some], turn[:, 1] - row[some]
        lands = (to_column >= 0) & (to_column < width) & (to_row >= 0) & (to_row < height)
        target = np.where(lands, to_row * width + to_column, some)
        own = lands & (cell[target] == its_cell)
        here = np.bincount(its_cell, own, len(centre)).astype(np.int64)
        off = np.hypot(*far.T)
        better = beside & ((here > count) | ((here == count) & (off < miss)))
        count, miss = np.where(better, here, count), np.where(better, off, miss)
        taken = better[its_cell]
        partner[some[taken]] = np.where(own, target, some)[taken]
    return partner


def rotate_elemental_images(picture: npt.NDArray[Any], display: Display) -> npt.NDArray[Any]:
    """Turn the elemental images of a picture (height, width, channels) that fits a display's panel."""
    flat = picture.reshape(-1, picture.shape[-1])
    return flat[rotation_map(display)].reshape(picture.shape)

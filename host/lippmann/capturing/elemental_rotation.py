"""Rotates elemental images by 180 degrees, in whole pixels, to correct a scene's depth.

**The rule.** A cell has the pixels whose centres the lattice assigns to one lenslet.
The rotation moves pixel (column c, row r) to pixel (m - c, n - r), with integers m and
n. For a lenslet centre at (u, v), the ideal m and n are 2u - 1 and 2v - 1. Of the
integers within 1 of these values, the rotation uses the pair that keeps the most pixels
in the cell or, if several pairs do, the nearest pair. Pixels that would leave the cell
stay in place.

The centre of rotation is at most half a pixel from the lenslet's centre in x and y. On
a square lattice along the panel's edges, every pixel of a complete cell is rotated.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.display.description import Display
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import number_lenslets
from lippmann.optics.rays import Bools, Floats, Indices
from lippmann.optics.system import System

#: Maximum rounding error of computed pixel coordinates, px.
ROUNDING = 1e-9


class Cells(NamedTuple):
    """The cells of a panel; each cell has the pixels of one lenslet."""

    #: Cell index of each pixel, counted from 0, (height * width,).
    cell: Indices
    #: Pixel coordinates of the elemental images' centres, (cells, 2).
    centre: Floats
    #: Mask (height * width,) of pixels that a one-pixel step may move out of their cell.
    rim: Bools


def cells_of(display: Display, rows: slice = slice(None), columns: slice = slice(None)) -> Cells:
    """Return the cells of a display, or of some of its rows and columns."""
    panel, system = display.panel, System.of(display)
    frame, lattice, convergence = system.frame, system.lattice, system.convergence
    row = np.arange(panel.height_px)[rows, np.newaxis]
    column = np.arange(panel.width_px)[np.newaxis, columns]
    point = frame.array_from_panel(*frame.panel_from_pixel(column + 0.5, row + 0.5))
    i, j, x, y = np.broadcast_arrays(*lattice.locate(NumpyBackend(), *convergence.towards_eye(*point)))
    lenslets, cell = number_lenslets(np.stack([i.ravel(), j.ravel()], axis=1).astype(np.int64))
    cx, cy = lattice.centre(*lenslets.T.astype(float))
    x0, y0 = convergence.on_panel(0.0, 0.0, cx, cy)
    centre = frame.panel_from_array(cx + x0, cy + y0)
    rim = np.zeros(x.shape, bool)
    for axis, across in zip(lattice.axes, lattice.across(x, y), strict=True):
        step = float(np.abs(frame.turn(*axis)) @ panel.pitches_mm) * (1.0 + ROUNDING)
        rim |= np.abs(across) > lattice.half_mm - step
    return Cells(cell, np.stack(frame.pixel_from_panel(*centre), axis=1), rim.ravel())


def rotation_map(display: Display) -> Indices:
    """Return the index of the pixel that replaces each pixel, (height * width,)."""
    width, height = display.panel.size_px
    system = System.of(display)
    if system.lattice.grid == "square" and not system.lattice.shear and not system.frame.sin:
        across, up = cells_of(display, rows=slice(1)), cells_of(display, columns=slice(1))
        across.centre[:, 1] = up.centre[:, 0] = 0.5  # the centres lie in one row or column
        of_columns, fixed_columns = _pairs(display, across, width, 1)
        of_rows, fixed_rows = _pairs(display, up, 1, height)
        column, row = np.arange(width), np.arange(height)[:, np.newaxis]
        to_column = of_columns[across.cell, 0] - column
        to_row = of_rows[up.cell, 1][:, np.newaxis] - row
        table: Indices = to_row * width + to_column
        table[fixed_rows] = row[fixed_rows] * width + column
        table[:, fixed_columns] = row * width + column[fixed_columns]
        return table.ravel()
    cells = cells_of(display)
    pairs, fixed = _pairs(display, cells, width, height)
    # Pixel (c, r) has index k = r width + c, and moves to index n width + m - k.
    partner: Indices = (pairs[:, 0] + pairs[:, 1] * width)[cells.cell]
    partner -= np.arange(width * height)
    partner[fixed] = fixed
    return partner


def _pairs(display: Display, cells: Cells, width: int, height: int) -> tuple[Indices, Indices]:
    """Return the pair (m, n) of each cell, (cells, 2), and the pixels that stay in place."""
    cell, centre, rim = cells
    size = np.array([width, height])
    exact = 2.0 * centre - 1.0
    nearest = np.rint(exact)
    # Rim pixels, and all pixels of cells at the panel's edge, may leave their cell.
    reach = display.array.half_diagonal_mm * (1.0 + display.convergence) / min(display.panel.pitches_mm) + 2.0
    cut = (np.abs(centre - size / 2.0) - size / 2.0).max(axis=1) > -reach
    pixel = np.flatnonzero(rim | cut[cell])
    row, column = np.divmod(pixel, width)
    of_rim = cell[pixel]
    best = nearest.astype(np.int64)
    count, miss = np.full(len(centre), -1), np.full(len(centre), np.inf)
    cell_size = np.bincount(of_rim, minlength=len(centre))
    stays = np.zeros(len(pixel), bool)
    for step in itertools.product((0, -1, 1), repeat=2):
        far = np.abs(nearest + step - exact)
        # Pairs (m, n) near the ideal are tried first, until a cell keeps all pixels.
        candidates = (far.max(axis=1) <= 1.0 + ROUNDING) & (count < cell_size)
        if not candidates.any():
            continue
        rim_pixels = np.flatnonzero(candidates[of_rim])
        its_cell = of_rim[rim_pixels]
        m, n = (nearest + step).astype(np.int64)[its_cell].T
        to_column, to_row = m - column[rim_pixels], n - row[rim_pixels]
        inside = (to_column >= 0) & (to_column < width) & (to_row >= 0) & (to_row < height)
        own = inside & (cell[np.where(inside, to_row * width + to_column, 0)] == its_cell)
        own_count = np.bincount(its_cell, own, len(centre)).astype(np.int64)
        off = np.hypot(*far.T)
        better = candidates & ((own_count > count) | ((own_count == count) & (off < miss)))
        count, miss = np.where(better, own_count, count), np.where(better, off, miss)
        best[better] = (nearest + step).astype(np.int64)[better]
        improved = better[its_cell]
        stays[rim_pixels[improved]] = ~own[improved]
    return best, pixel[stays]


def rotated(picture: npt.NDArray[Any], partner: Indices) -> npt.NDArray[Any]:
    """Exchange the pixels of a picture (height, width, channels) by a `rotation_map`."""
    return np.take(picture.reshape(-1, picture.shape[-1]), partner, axis=0).reshape(picture.shape)

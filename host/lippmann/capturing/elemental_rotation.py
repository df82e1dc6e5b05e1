"""Rotates elemental images by 180 degrees in whole pixels, so that a captured scene is shown at its right depth.

**The rule.** The pixels of a cell are those whose centres the lattice assigns to one lenslet. A rotation about a point
of the half-pixel lattice takes pixel (c, r) to pixel (m - c, n - r), with integers m and n: nothing is resampled. A
lenslet centred at pixel coordinates (u, v) asks for m = 2u - 1 and n = 2v - 1, which are rarely integers. Of the
integer pairs within 1 of them, each cell takes the pair that brings most of its pixels onto its own pixels; of equally
good pairs, the nearest. Pixels at the rim that would leave the cell stay where they are.

So the map is an involution and a permutation of each cell's pixels, on every lattice, also a rotated or shifted one.
The centre of rotation is at most half a pixel off the lenslet's centre in x and in y. On a square lattice that is not
rotated, every cell inside the image is a rectangle of pixels, and all of it is rotated.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.display.description import Display
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import number_lenslets
from lippmann.optics.rays import Floats, Indices
from lippmann.optics.system import System

#: Rounding of pixel coordinates, pixels.
ROUNDING = 1e-9


def cells_of(display: Display) -> tuple[Indices, Floats]:
    """Return the cell of each pixel, (height * width,), counted from 0, and the cells' centres, (cells, 2) pixels.

    A cell is a lenslet's elemental image. Its centre is the lenslet's, if no eye is near.
    """
    panel, system = display.panel, System.of(display)
    frame, lattice, convergence = system.frame, system.lattice, system.convergence
    row, column = np.arange(panel.height_px)[:, np.newaxis], np.arange(panel.width_px)
    point = frame.array_from_panel(*frame.panel_from_pixel(column + 0.5, row + 0.5))
    i, j, *_ = lattice.locate(NumpyBackend(), *convergence.towards_eye(*point))
    lenslets, cell = number_lenslets(np.stack(np.broadcast_arrays(i, j), axis=-1).reshape(-1, 2).astype(np.int64))
    cx, cy = lattice.centre(*lenslets.T.astype(float))
    x0, y0 = convergence.on_panel(0.0, 0.0, cx, cy)
    centre = frame.panel_from_array(cx + x0, cy + y0)
    return cell, np.stack(frame.pixel_from_panel(*centre), axis=1)


def rotation_map(display: Display) -> Indices:
    """Return the pixel that each pixel changes places with: (height * width,) pixel numbers, row by row."""
    width, height = display.panel.width_px, display.panel.height_px
    cell, centre = cells_of(display)
    exact = 2.0 * centre - 1.0
    nearest = np.rint(exact)
    partner = np.arange(height * width)
    row, column = np.divmod(partner.astype(np.int32), np.int32(width))
    size = np.bincount(cell)
    count, miss = np.full(len(centre), -1), np.full(len(centre), np.inf)
    for step in itertools.product((0, -1, 1), repeat=2):
        far = np.abs(nearest + step - exact)
        # The first pair is the nearest: where it brings all pixels onto the cell's own, no other is better.
        candidates = (far.max(axis=1) <= 1.0 + ROUNDING) & (count < size)
        pixel = np.flatnonzero(candidates[cell])
        its_cell = cell[pixel]
        m, n = (nearest + step).astype(np.int32)[its_cell].T
        to_column, to_row = m - column[pixel], n - row[pixel]
        inside = (to_column >= 0) & (to_column < width) & (to_row >= 0) & (to_row < height)
        target = np.where(inside, to_row * width + to_column, 0)
        own = inside & (cell[target] == its_cell)
        own_count = np.bincount(its_cell, own, len(centre)).astype(np.int64)
        off = np.hypot(*far.T)
        better = candidates & ((own_count > count) | ((own_count == count) & (off < miss)))
        count, miss = np.where(better, own_count, count), np.where(better, off, miss)
        improved = better[its_cell]
        partner[pixel[improved]] = np.where(own, target, pixel)[improved]
    return partner


def rotated(picture: npt.NDArray[Any], partner: Indices) -> npt.NDArray[Any]:
    """Return a picture (height, width, channels) with its pixels exchanged as `rotation_map` says."""
    return np.take(picture.reshape(-1, picture.shape[-1]), partner, axis=0).reshape(picture.shape)

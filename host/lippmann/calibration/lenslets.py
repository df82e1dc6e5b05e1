"""The panel point that a position sees through each lenslet, and where in the photograph the lenslet is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lippmann.calibration.decode import Decoded
from lippmann.calibration.lattice import SeenLattice
from lippmann.calibration.outline import Outline, fit_outline, regular
from lippmann.display import Display
from lippmann.errors import input_error
from lippmann.optics.panel import PanelFrame

#: Part of a cell whose pixels count: beyond, a camera pixel sees through two lenslets.
INNER = 0.7
#: A pixel whose point is this far from its lenslet's, in steps of the lattice, is wrong.
WRONG = 0.4
#: Most standard deviations of a pixel from the others of its lenslet.
SPREAD = 3.5
#: Least share of the usual number of pixels that a lenslet must have.
LEAST_SHARE = 0.35
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Lenslets:
    """Of the lenslets that one position sees: `index` (N, 2) int64, `photo_px` (N, 2) their middles in the photograph,
    `panel_mm` (N, 2) the points of the panel seen through their centres, `pixels` (N,) the number of camera pixels.
    """  # fmt: skip

    name: str
    shape: tuple[int, int]
    index: npt.NDArray[np.int64]
    photo_px: Floats
    panel_mm: Floats
    pixels: npt.NDArray[np.int64]
    #: Movement of the panel point over the lenslet's aperture: (2, 2), mm for each pitch across the cell.
    spread: Floats
    #: Share of the pixels that see the lenslet in front of them.
    agree: float
    modulation: float

    def moved(self, step: npt.NDArray[np.int64]) -> Lenslets:
        """Return the same with another numbering: `step` is added to all indices."""
        return replace(self, index=self.index + step)


def measure_lenslets(decoded: Decoded, seen: SeenLattice, display: Display) -> Lenslets:
    """Average the pixels of each lenslet's inner cell."""
    frame, grid = PanelFrame.of(display), display.array.grid
    points = np.stack(frame.panel_from_pixel(*decoded.panel_px.astype(np.float64).T), axis=1)
    index, near = seen.near(points)
    outline = fit_outline(decoded.name, grid, decoded.photo_px[near], index[near], decoded.shape)
    home, local = outline.located(decoded.photo_px)
    # Pixels that see their own lenslet give its middle in the photograph.
    own = near & (home == index).all(axis=1)
    names, groups = _grouped(home)
    counts = np.bincount(groups[own], minlength=len(names))
    sums = _sums(decoded.photo_px[own].astype(np.float64), groups[own], len(names))
    photo = sums / np.maximum(counts, 1)[:, None]
    axes = np.array(outline.lattice.axes)
    inner = (abs(local @ axes.T) < 0.5 * INNER).all(axis=1)
    good = inner & (abs(seen.steps(points) - home) < WRONG).all(axis=1)
    spread = np.zeros((2, 2))
    for _ in range(2):
        at, middle, spread = _averages(points, local, good, groups, len(names))
        off = points - at[groups] - (local - middle[groups]) @ spread
        far = np.hypot(*off.T)
        good &= far < SPREAD * max(1e-9, 1.4826 * float(np.median(abs(off[good]))) * 1.5)
    at, middle, spread = _averages(points, local, good, groups, len(names))
    number = np.bincount(groups[good], minlength=len(names))
    usual = np.median(number[number > 0]) if (number > 0).any() else 0.0
    whole = np.median(counts[counts > 0]) if (counts > 0).any() else 0.0
    kept = (number >= max(2.0, LEAST_SHARE * usual)) & (counts >= LEAST_SHARE * whole)
    if kept.sum() < 30:
        what = f"only {int(kept.sum())} lenslets are seen"
        raise input_error(decoded.name, what, "come nearer, or use a camera with more pixels: 4 or more across a lenslet")
    panel = at[kept] - middle[kept] @ spread
    return Lenslets(
        decoded.name, decoded.shape, names[kept], photo[kept], panel, number[kept], spread,
        outline.agree, decoded.modulation,
    )  # fmt: skip


def _grouped(index: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the different (i, j) of pixels, (M, 2), and the number of each pixel's one, (N,)."""
    low = index.min(axis=0)
    rows = int(index[:, 1].max() - low[1]) + 1
    flat = (index[:, 0] - low[0]) * rows + (index[:, 1] - low[1])
    names, groups = np.unique(flat, return_inverse=True)
    return np.stack([names // rows, names % rows], axis=1) + low, groups


def _sums(values: Floats, groups: npt.NDArray[np.int64], count: int) -> Floats:
    return np.stack([np.bincount(groups, weights=column, minlength=count) for column in values.T], axis=1)


def _averages(
    points: Floats, local: Floats, good: npt.NDArray[np.bool_], groups: npt.NDArray[np.int64], count: int
) -> tuple[Floats, Floats, Floats]:
    """Return the means of points and of places in the cell, (M, 2) each, and how points move with places, (2, 2)."""
    number = np.maximum(np.bincount(groups[good], minlength=count), 1)[:, None]
    at, middle = (_sums(one[good], groups[good], count) / number for one in (points, local))
    across = local[good] - middle[groups[good]]
    moved = points[good] - at[groups[good]]
    spread = np.linalg.lstsq(across.T @ across, across.T @ moved, rcond=None)[0]
    return at, middle, spread


def regular_places(lenslets: Lenslets, display: Display) -> Floats:
    """Return the lenslets' centres on the lattice of pitch 1, (N, 2)."""
    return regular(display.array.grid, lenslets.index)

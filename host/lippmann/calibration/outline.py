"""Where in a photograph the lenslets are: a smooth map from the photograph to the lattice of pitch 1.

A pixel that sees the panel point of lenslet (i, j) lies in the outline of that lenslet. The map through all these
pixels, a homography after a radial correction, tells for each pixel where in its lenslet's cell it looks, also where
the panel is dark or a point wrong.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from lippmann.errors import input_error
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import HALF_SQRT3, Lattice

Floats = npt.NDArray[np.floating]
#: Pixels that the map is fitted to.
MOST_PIXELS = 40_000
SEED = 1910
#: Least share of pixels that follow the map.
LEAST_AGREEING = 0.5
#: Most distance of a pixel from its lenslet's centre, in pitches: a cell's corner.
CORNER = 0.75


def regular(grid: str, index: npt.NDArray[np.number]) -> npt.NDArray[np.float64]:
    """Return the centres of lenslets (N, 2) of the lattice of pitch 1."""
    i, j = index[:, 0].astype(float), index[:, 1].astype(float)
    return np.stack([i + 0.5 * j, HALF_SQRT3 * j] if grid == "hex" else [i, j], axis=1)


@dataclass(frozen=True)
class Outline:
    """The map of one position: `size_px` is the photograph's longer side, `numbers` homography and radial terms."""

    lattice: Lattice
    middle_px: npt.NDArray[np.float64]
    size_px: float
    numbers: npt.NDArray[np.float64]
    #: Share of pixels whose point belongs to the lenslet in whose outline they lie.
    agree: float = 1.0

    def cells(self, photo_px: Floats) -> npt.NDArray[np.float64]:
        """Return pixels (N, 2) as points of the lattice of pitch 1."""
        return _mapped(self.numbers, (photo_px - self.middle_px) / self.size_px)

    def steps(self, photo_px: Floats) -> npt.NDArray[np.float64]:
        """Return pixels (N, 2) in steps (i, j) of the lattice, not rounded."""
        x, y = self.cells(photo_px).T
        if self.lattice.grid == "hex":
            y = y / HALF_SQRT3
            x = x - 0.5 * y
        return np.stack([x, y], axis=1)

    def located(self, photo_px: Floats) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Return the lenslets (i, j) in whose outlines pixels lie, and the pixels' points from the centres."""
        x, y = self.cells(photo_px).T
        i, j, dx, dy = self.lattice.locate(NumpyBackend(), x, y)
        return np.stack([i, j], axis=1).astype(np.int64), np.stack([dx, dy], axis=1)


def _mapped(numbers: npt.NDArray[np.float64], at: Floats) -> npt.NDArray[np.float64]:
    """Apply a map: (8 of a homography, 2 radial) to points whose longer side is 1."""
    square = (at**2).sum(axis=1)
    scale = 1.0 + square * (numbers[8] + square * numbers[9])
    x, y = at[:, 0] * scale, at[:, 1] * scale
    h = numbers
    depth = h[6] * x + h[7] * y + 1.0
    return np.stack([(h[0] * x + h[1] * y + h[2]) / depth, (h[3] * x + h[4] * y + h[5]) / depth], axis=1)


def fit_outline(
    name: str, grid: str, photo_px: Floats, index: npt.NDArray[np.int64], shape: tuple[int, int]
) -> Outline:
    """Fit the map to pixels (N, 2) that see lenslets (i, j), (N, 2), which are whole in the photograph.

    Raises InputError when the pixels of neighbouring lenslets are not neighbours in the photograph.
    """
    rng = np.random.default_rng(SEED)
    some = rng.choice(len(photo_px), min(MOST_PIXELS, len(photo_px)), replace=False)
    middle, size = np.array(shape[::-1]) / 2.0, float(max(shape))
    at, cells = (photo_px - middle) / size, regular(grid, index)
    origin = np.median(cells[some], axis=0)
    homography, mask = cv2.findHomography(at[some], cells[some] - origin, cv2.RANSAC, 1.5 * CORNER, maxIters=1000)
    share = float(np.mean(mask)) if np.size(homography) == 9 else 0.0
    _check_agreement(name, share)
    numbers = np.concatenate([(homography / homography[2, 2]).ravel()[:8], np.zeros(2)])
    for reach in (1.5 * CORNER, CORNER):
        off = abs(_mapped(numbers, at) + origin - cells).max(axis=1)
        numbers = _fitted(numbers, *_middles(at[off < reach], index[off < reach]), grid, origin)
    # The origin of the cells back: a homography's rows add it times the depth.
    numbers[0:3] += origin[0] * np.array([numbers[6], numbers[7], 1.0])
    numbers[3:6] += origin[1] * np.array([numbers[6], numbers[7], 1.0])
    made = Outline(Lattice("hex" if grid == "hex" else "square", 1.0), middle, size, numbers)
    agree = float((made.located(photo_px[some])[0] == index[some]).all(axis=1).mean())
    _check_agreement(name, agree)
    return replace(made, agree=agree)


def _check_agreement(name: str, share: float) -> None:
    """Refuse a map that few pixels follow."""
    if share < LEAST_AGREEING:
        what = f"only {100.0 * share:.0f} % of the pixels see the lenslet in front of them"
        raise input_error(name, what, "check that all photographs are of one position, and of this display's patterns")


def grouped(index: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the different (i, j) of pixels, (M, 2), and the number of each pixel's one, (N,)."""
    low = index.min(axis=0)
    rows = int(index[:, 1].max() - low[1]) + 1
    flat = (index[:, 0] - low[0]) * rows + (index[:, 1] - low[1])
    there = np.flatnonzero(np.bincount(flat))
    number = np.zeros(there[-1] + 1, np.int64)
    number[there] = np.arange(len(there))
    return np.stack([there // rows, there % rows], axis=1) + low, number[flat]


def _middles(at: Floats, index: npt.NDArray[np.int64]) -> tuple[Floats, npt.NDArray[np.int64]]:
    """Return the middles of the pixels of each lenslet, and its (i, j)."""
    names, groups = grouped(index)
    count = np.bincount(groups)
    middles = np.stack([np.bincount(groups, weights=column) / count for column in at.T], axis=1)
    usual = count >= 0.5 * np.median(count)
    return middles[usual], names[usual]


def _fitted(
    numbers: npt.NDArray[np.float64], middles: Floats, index: npt.NDArray[np.int64], grid: str, origin: Floats
) -> npt.NDArray[np.float64]:
    """Fit a map to the middles of lenslets."""
    wanted = regular(grid, index) - origin
    scale = np.array([10.0, 10.0, 1.0, 10.0, 10.0, 1.0, 0.1, 0.1, 0.1, 0.1])

    def residuals(free: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return (_mapped(free, middles) - wanted).ravel()

    found = least_squares(residuals, numbers, loss="soft_l1", f_scale=0.05, x_scale=scale)
    return np.array(found.x)

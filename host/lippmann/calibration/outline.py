"""Where in a photograph the lenslets are: a smooth map from the photograph to the lattice of pitch 1.

A pixel that sees the panel point of lenslet (i, j) lies in the outline of that lenslet. The map through all these
pixels, a homography after a radial correction, tells for each pixel where in its lenslet's cell it looks, also where
the panel is dark or a point wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

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

    def located(self, photo_px: Floats) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Return the lenslets (i, j) in whose outlines pixels lie, and the pixels' points from the centres."""
        x, y = self.cells(photo_px).T
        i, j, dx, dy = self.lattice.locate(NumpyBackend(), x, y)
        return np.stack([i, j], axis=1).astype(np.int64), np.stack([dx, dy], axis=1)


def _mapped(numbers: npt.NDArray[np.float64], at: Floats) -> npt.NDArray[np.float64]:
    """Apply a map: (8 of a homography, 3 radial) to points whose longer side is 1."""
    square = (at**2).sum(axis=1)
    scale = 1.0 + square * (numbers[8] + square * (numbers[9] + square * numbers[10]))
    x, y = at[:, 0] * scale, at[:, 1] * scale
    h = numbers
    depth = h[6] * x + h[7] * y + 1.0
    return np.stack([(h[0] * x + h[1] * y + h[2]) / depth, (h[3] * x + h[4] * y + h[5]) / depth], axis=1)


def fit_outline(
    name: str, grid: str, photo_px: Floats, index: npt.NDArray[np.int64], shape: tuple[int, int]
) -> Outline:
    """Fit the map to pixels (N, 2) that see lenslets (i, j), (N, 2).

    Raises InputError when the pixels of neighbouring lenslets are not neighbours in the photograph.
    """
    rng = np.random.default_rng(SEED)
    some = rng.choice(len(photo_px), min(MOST_PIXELS, len(photo_px)), replace=False)
    middle, size = np.array(shape[::-1]) / 2.0, float(max(shape))
    at, cells = (photo_px[some] - middle) / size, regular(grid, index[some])
    origin = np.median(cells, axis=0)
    homography, mask = cv2.findHomography(at.astype(np.float64), cells - origin, cv2.RANSAC, CORNER, maxIters=1000)
    share = 0.0 if homography is None else float(mask.mean())
    if share < 0.5:
        what = f"only {100.0 * share:.0f} % of the pixels see the lenslet in front of them"
        raise input_error(name, what, "check that all photographs are of one position, and of this display's patterns")
    start = np.concatenate([(homography / homography[2, 2]).ravel()[:8], np.zeros(3)])
    kept = slice(None)
    for reach in (1.5 * CORNER, CORNER):
        kept = abs(_mapped(start, at) + origin - cells).max(axis=1) < reach
        chosen, wanted = at[kept], (cells - origin)[kept]
        scale = np.array([10.0, 10.0, 1.0, 10.0, 10.0, 1.0, 0.1, 0.1, 0.1, 0.1, 0.1])
        start = least_squares(
            lambda numbers, chosen=chosen, wanted=wanted: (_mapped(numbers, chosen) - wanted).ravel(),
            start, loss="soft_l1", f_scale=0.5, x_scale=scale,
        ).x  # fmt: skip
    # The origin of the cells back: a homography's rows add it times the depth.
    start[0:3] += origin[0] * np.array([start[6], start[7], 1.0])
    start[3:6] += origin[1] * np.array([start[6], start[7], 1.0])
    made = Outline(Lattice("hex" if grid == "hex" else "square", 1.0), middle, size, start)
    agree = float((made.located(photo_px[some])[0] == index[some]).all(axis=1).mean())
    return Outline(made.lattice, middle, size, start, agree)

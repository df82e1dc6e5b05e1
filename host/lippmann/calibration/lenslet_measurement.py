"""Measure the middle of each lenslet in the photographs, and the panel point that it shows.

A camera pixel that sees the panel point of lenslet (i, j) lies in this lenslet's
outline. Pixels of known lenslets give a map from the photograph to a lattice of pitch
1: a radial correction, then a homography. The map gives each pixel's position in a
cell, even where the panel is dark or a decoded point is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from lippmann.calibration.lattice_search import NEAR, SeenLattice, within
from lippmann.calibration.pattern_decoding import Decoded
from lippmann.display.description import Display, Grid
from lippmann.errors import input_error
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import HALF_SQRT3, Lattice, number_lenslets
from lippmann.optics.rays import Bools, Floats, Indices

Values = npt.NDArray[np.floating]
#: Upper bound of the distance from a cell's centre to its corners, pitches.
CORNER = 0.75
#: Typical changes of the map's parameters, for the fit.
SCALES = (10.0, 10.0, 1.0, 10.0, 10.0, 1.0, 0.1, 0.1, 0.1, 0.1)


def regular(grid: Grid, index: npt.NDArray[np.number]) -> Floats:
    """Return the centres (N, 2) of lenslets (i, j) on a regular lattice of pitch 1."""
    return np.stack(Lattice(grid, 1.0).centre(*index.T.astype(float)), axis=1)


@dataclass(frozen=True)
class Outline:
    """Map from a photograph to a lattice; `size_px` is the photograph's longer side."""

    lattice: Lattice
    middle_px: Floats
    size_px: float
    numbers: Floats
    origin: Floats
    #: Fraction of camera pixels that the map assigns to their decoded lenslet.
    agree: float = 1.0

    def cells(self, photo_px: Values) -> Floats:
        """Map pixels (N, 2) to points in units of the pitch."""
        return self.origin + _apply_map(self.numbers, (photo_px - self.middle_px) / self.size_px)

    def steps(self, photo_px: Values) -> Floats:
        """Map pixels (N, 2) to real-valued lattice coordinates (i, j)."""
        x, y = self.cells(photo_px).T
        if self.lattice.grid == "hex":
            y = y / HALF_SQRT3
            x = x - 0.5 * y
        return np.stack([x, y], axis=1)

    def located(self, photo_px: Values) -> tuple[Indices, Floats]:
        """Return each pixel's lenslet (i, j), and offset from this lenslet's centre."""
        x, y = self.cells(photo_px).T
        i, j, dx, dy = self.lattice.locate(NumpyBackend(), x, y)
        return np.stack([i, j], axis=1).astype(np.int64), np.stack([dx, dy], axis=1)


def _apply_map(numbers: Floats, at: Values) -> Floats:
    square = (at**2).sum(axis=1)
    scale = 1.0 + square * (numbers[8] + square * numbers[9])
    homography = np.append(numbers[:8], 1.0).reshape(3, 3)
    return np.asarray(cv2.perspectiveTransform((at * scale[:, None])[None], homography)[0], np.float64)


def fit_outline(name: str, grid: Grid, photo_px: Values, index: Indices, shape: tuple[int, int]) -> Outline:
    """Fit an outline map to pixels (N, 2) that see the complete lenslets `index` (N, 2).

    Raises InputError if less than half of the pixels fit.
    """
    rng = np.random.default_rng(1910)
    some = rng.choice(len(photo_px), min(40_000, len(photo_px)), replace=False)
    middle, size = np.array(shape[::-1]) / 2.0, float(max(shape))
    at, cells = (photo_px - middle) / size, regular(grid, index)
    origin = np.median(cells[some], axis=0)
    homography, mask = cv2.findHomography(at[some], cells[some] - origin, cv2.RANSAC, 1.5 * CORNER, maxIters=1000)
    share = float(np.mean(mask)) if np.size(homography) == 9 else 0.0
    _check_agreement(name, share)
    numbers = np.concatenate([(homography / homography[2, 2]).ravel()[:8], np.zeros(2)])
    for reach in (1.5 * CORNER, CORNER):
        near = abs(_apply_map(numbers, at) + origin - cells).max(axis=1) < reach
        names, groups = number_lenslets(index[near])
        count = np.bincount(groups)
        usual = count >= 0.5 * np.median(count)
        middles = _sums(at[near], groups, len(names)) / count[:, None]
        pairs = middles[usual], regular(grid, names[usual]) - origin

        def off(numbers: Floats, at: Values, targets: Values) -> Floats:
            return np.ravel(_apply_map(numbers, at) - targets)

        numbers = least_squares(off, numbers, loss="soft_l1", f_scale=0.05, x_scale=SCALES, args=pairs).x
    outline = Outline(Lattice(grid, 1.0), middle, size, numbers, origin)
    agree = float((outline.located(photo_px[some])[0] == index[some]).all(axis=1).mean())
    _check_agreement(name, agree)
    return replace(outline, agree=agree)


def _check_agreement(name: str, share: float) -> None:
    if share < 0.5:
        what = f"only {100.0 * share:.0f} % of the camera pixels fit one map to lenslets"
        raise input_error(name, what, "take all photographs from one position, with the patterns of this display")


#: Scale of the inner cell; pixels outside the inner cell may see two lenslets.
INNER = 0.7
#: Scale of the part of a cell in which panel points depend linearly on position.
MIDDLE = 0.7
#: Maximum readings per camera position: 30 for each of 100,000 lenslets.
MAX_READINGS, SEED = 3_000_000, 1914
#: Minimum pixel count of a complete lenslet's neighbours, as a fraction of the largest
#: neighbour's count. The value allows for perspective.
NEIGHBOURS = 0.8


@dataclass(frozen=True)
class Readings:
    """Panel points (M, 2), px, and cell positions (M, 2), pitches, sorted by lenslet number `group` (M,)."""

    panel_px: npt.NDArray[np.float32]
    local: npt.NDArray[np.float32]
    group: Indices


@dataclass(frozen=True)
class Lenslets:
    """Measurements of N lenslets (i, j), `index` (N, 2), from one camera position.

    `photo_px` (N, 2) are the lenslets' middles in the photograph. `panel_mm` (N, 2) are
    the panel points seen through the inner cells, known to +- `half_px` (N, 2) pixels.
    """

    name: str
    shape: tuple[int, int]
    index: Indices
    photo_px: Floats
    panel_mm: Floats
    half_px: Floats
    #: Photograph pixels (N, 2) of the cells' middles, which see the panel points.
    cell_px: Floats
    #: Derivative (2, 2) of the cell position, pitches, by photograph pixel.
    steps: Floats
    #: Derivatives (N, 2, 2) of panel points by cell position, mm per pitch, and their mean.
    moves: Floats
    spread: Floats
    #: Value of `Outline.agree`.
    agree: float
    modulation: float
    readings: Readings | None = None


def _match_pixels(
    decoded: Decoded, lattice: SeenLattice, points_mm: Floats, grid: Grid
) -> tuple[Outline, Indices, Bools]:
    """Return the map, each pixel's lenslet (i, j), and a mask of pixels in that lenslet's outline.

    Through the lenslet at l, a pixel at q sees the panel point l + B (q - l), in
    lattice steps. B is 0 if lenslets focus on the panel. Each iteration improves B.
    """
    panel_steps = lattice.steps(points_mm)
    index, near = lattice.near(points_mm)
    for _ in range(3):
        # Skip lenslets partly dark from dust or an edge, which would get a wrong middle.
        names, groups = number_lenslets(index[near])
        complete = np.flatnonzero(near)[are_complete(names, np.bincount(groups), NEIGHBOURS)[groups]]
        outline = fit_outline(decoded.name, grid, decoded.photo_px[complete], index[complete], decoded.shape)
        at = outline.steps(decoded.photo_px)
        across = at - np.round(at)
        some = within(across, grid, MIDDLE) & (abs(panel_steps - np.round(at)) < 0.7).all(axis=1)
        off = panel_steps[some] - np.round(at[some])
        moves = np.linalg.lstsq(across[some], off - off.mean(axis=0), rcond=None)[0]
        own = _centred((panel_steps - at @ moves) @ np.linalg.inv(np.eye(2) - moves), at, some)
        index = np.round(own).astype(np.int64)
        near = within(own - index, grid, NEAR)
    return outline, index, near & (abs(at - index) < 0.7).all(axis=1)


def measure_lenslets(decoded: Decoded, lattice: SeenLattice, display: Display) -> Lenslets:
    """Measure all lenslets of a camera position; average over the pixels of each inner cell."""
    points = decoded.points_mm(display)
    outline, index, own_pixels = _match_pixels(decoded, lattice, points, display.array.grid)
    home, local = outline.located(decoded.photo_px)
    # A lenslet's middle also uses pixels outside the cell, because seams are curved.
    names, both = number_lenslets(np.concatenate([home, index[own_pixels]]))
    groups, of_own = both[: len(home)], both[len(home) :]
    counts = np.bincount(of_own, minlength=len(names))
    sums = _sums(decoded.photo_px[own_pixels].astype(np.float64), of_own, len(names))
    photo = sums / np.maximum(counts, 1)[:, None]
    inner = (abs(local @ np.array(outline.lattice.axes).T) < 0.5 * INNER).all(axis=1)
    good = inner & own_pixels & (home == index).all(axis=1)
    for _ in range(2):
        at, middle, spread = _averages(points, local, good, groups, len(names))
        off = points - at[groups] - (local - middle[groups]) @ spread
        far = np.hypot(*off.T)
        # Drop pixels with errors above 6 standard deviations.
        good &= far < 6.0 * max(1e-9, 1.4826 * float(np.median(abs(off[good]))) * 1.5)
    at, middle, spread = _averages(points, local, good, groups, len(names))
    number = np.bincount(groups[good], minlength=len(names))
    usual = np.median(number[number > 0]) if (number > 0).any() else 0.0
    # A partly dark neighbour would shift the seam, and thus the lenslet's middle.
    valid = (number >= max(2.0, 0.35 * usual)) & are_complete(names, counts, 0.9)
    _check_steady(decoded.name, names, counts, outline.agree)
    if valid.sum() < 30:
        remedy = "move the camera nearer, or use one with more pixels: 4 or more across a lenslet"
        raise input_error(decoded.name, f"only {int(valid.sum())} lenslets are visible", remedy)
    panel = at[valid] - middle[valid] @ spread
    photo_at, _, grown = _averages(decoded.photo_px.astype(np.float64), local, good, groups, len(names))
    cells = photo_at[valid] - middle[valid] @ grown
    moves = np.broadcast_to(spread, (len(panel), 2, 2))
    read = np.flatnonzero(good & valid[groups])
    if len(read) > MAX_READINGS:
        read = np.sort(np.random.default_rng(SEED).choice(read, MAX_READINGS, replace=False, shuffle=False))
    read = read[np.argsort(groups[read], kind="stable")]
    readings = Readings(decoded.panel_px[read], local[read].astype(np.float32), (np.cumsum(valid) - 1)[groups[read]])
    return Lenslets(
        decoded.name,
        decoded.shape,
        names[valid],
        photo[valid],
        panel,
        np.zeros_like(panel),
        cells,
        np.asarray(np.linalg.inv(grown), np.float64),
        moves,
        spread,
        outline.agree,
        decoded.modulation,
        readings,
    )


def _centred(own: Floats, at: Floats, some: Bools) -> Floats:
    home = np.round(at).astype(np.int64)
    names, groups = number_lenslets(home)
    number = np.bincount(groups[some], minlength=len(names))
    off = _sums((own - home)[some], groups[some], len(names)) / np.maximum(number, 1)[:, None]
    # Ignore the mean of fewer than three pixels.
    return np.asarray(own - np.where(number[:, None] >= 3, off, 0.0)[groups])


def _check_steady(name: str, index: Indices, counts: Indices, agree: float) -> None:
    least = 0.3 * float(np.median(counts[counts > 0])) if (counts > 0).any() else 0.0
    inside = _surrounded(*_table(index, counts), least)
    share = float((are_complete(index, counts, NEIGHBOURS) & inside).sum() / max(1, inside.sum()))
    # In simulations, (share, agree) is (0.79, 0.98) for correct photographs, (0.69, 0.93)
    # with 10 % wrong pixels, (0.39, 0.99) with 3 pixels of blur, (0.25, 0.85) with 3
    # pixels of movement.
    if share < 0.45 and agree < 0.96:
        what = f"only {100.0 * share:.0f} % of the lenslets are at the same position in all photographs"
        raise input_error(name, what, "focus on the array, fix camera and display, and photograph this position again")


def _table(index: Indices, counts: Indices) -> tuple[Floats, Indices]:
    low = index.min(axis=0) - 2
    table = np.zeros(index.max(axis=0) - low + 3)
    places = (index - low).T
    table[tuple(places)] = counts
    return table, places


def _surrounded(table: Floats, places: Indices, least: Floats | float) -> Bools:
    i, j = places
    inside = np.ones(len(i), bool)
    for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        inside &= np.maximum(table[i + di, j + dj], table[i + 2 * di, j + 2 * dj]) > least
    return inside


def are_complete(index: Indices, counts: Indices, neighbours: float) -> Bools:
    """Return a mask (N,) of lenslets with about as many pixels as their largest neighbour.

    On each side, one of the next two lenslets has at least `neighbours` times the largest neighbour's pixels.
    """
    table, places = _table(index, counts)
    i, j = places
    largest = np.max([table[i + di, j + dj] for di in (-1, 0, 1) for dj in (-1, 0, 1) if (di, dj) != (0, 0)], axis=0)
    noise = 0.6 * np.sqrt(largest)
    return np.asarray(_surrounded(table, places, neighbours * largest - noise) & (counts >= 0.95 * largest - noise))


def _sums(values: Floats, groups: Indices, count: int) -> Floats:
    return np.stack([np.bincount(groups, weights=column, minlength=count) for column in values.T], axis=1)


def _averages(points: Floats, local: Floats, good: Bools, groups: Indices, count: int) -> tuple[Floats, Floats, Floats]:
    """Return mean points and cell positions (M, 2), and the points' derivative by position."""
    number = np.maximum(np.bincount(groups[good], minlength=count), 1)[:, None]
    at, middle = (_sums(one[good], groups[good], count) / number for one in (points, local))
    across = local[good] - middle[groups[good]]
    moved = points[good] - at[groups[good]]
    spread = np.linalg.lstsq(across.T @ across, across.T @ moved, rcond=None)[0]
    return at, middle, np.asarray(spread, np.float64)

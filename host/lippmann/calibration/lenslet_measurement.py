"""The panel point that a position sees through each lenslet, and where in the photograph the lenslet is.

The lenslets are located in the photograph by their outlines. A pixel that sees the panel point of lenslet (i, j) lies
in the outline of that lenslet. A smooth map is fitted to all these pixels, from the photograph to the lattice of pitch
1: a homography after a radial correction. The map gives for each pixel its place in its lenslet's cell, also where the
panel is dark or a decoded point is wrong.
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
from lippmann.optics.rays import Floats, Indices

Values = npt.NDArray[np.floating]
#: Pixels that the map is fitted to.
MOST_PIXELS = 40_000
OUTLINE_SEED = 1910
#: Least share of pixels that follow the map.
LEAST_AGREEING = 0.5
#: Most distance of a pixel from its lenslet's centre, in pitches: a cell's corner.
CORNER = 0.75
#: About by how much the numbers of a map change.
SCALES = (10.0, 10.0, 1.0, 10.0, 10.0, 1.0, 0.1, 0.1, 0.1, 0.1)


def regular(grid: Grid, index: npt.NDArray[np.number]) -> Floats:
    """Return the centres of lenslets (N, 2) of the lattice of pitch 1."""
    return np.stack(Lattice(grid, 1.0).centre(*index.T.astype(float)), axis=1)


@dataclass(frozen=True)
class Outline:
    """The map of one position: `size_px` is the photograph's longer side, `numbers` homography and radial terms.

    The map leads to the lattice's points from `origin`.
    """

    lattice: Lattice
    middle_px: Floats
    size_px: float
    numbers: Floats
    origin: Floats
    #: Share of pixels whose point belongs to the lenslet in whose outline they lie.
    agree: float = 1.0

    def cells(self, photo_px: Values) -> Floats:
        """Return pixels (N, 2) as points of the lattice of pitch 1."""
        return self.origin + _mapped(self.numbers, (photo_px - self.middle_px) / self.size_px)

    def steps(self, photo_px: Values) -> Floats:
        """Return pixels (N, 2) in steps (i, j) of the lattice, not rounded."""
        x, y = self.cells(photo_px).T
        if self.lattice.grid == "hex":
            y = y / HALF_SQRT3
            x = x - 0.5 * y
        return np.stack([x, y], axis=1)

    def located(self, photo_px: Values) -> tuple[Indices, Floats]:
        """Return the lenslets (i, j) in whose outlines pixels lie, and the pixels' points from the centres."""
        x, y = self.cells(photo_px).T
        i, j, dx, dy = self.lattice.locate(NumpyBackend(), x, y)
        return np.stack([i, j], axis=1).astype(np.int64), np.stack([dx, dy], axis=1)


def _mapped(numbers: Floats, at: Values) -> Floats:
    """Apply a map: (8 of a homography, 2 radial) to points whose longer side is 1."""
    square = (at**2).sum(axis=1)
    scale = 1.0 + square * (numbers[8] + square * numbers[9])
    homography = np.append(numbers[:8], 1.0).reshape(3, 3)
    return np.asarray(cv2.perspectiveTransform((at * scale[:, None])[None], homography)[0], np.float64)


def fit_outline(name: str, grid: Grid, photo_px: Values, index: Indices, shape: tuple[int, int]) -> Outline:
    """Fit the map to pixels (N, 2) that see lenslets (i, j), (N, 2), which are whole in the photograph.

    Raises InputError when the pixels of neighbouring lenslets are not neighbours in the photograph.
    """
    rng = np.random.default_rng(OUTLINE_SEED)
    some = rng.choice(len(photo_px), min(MOST_PIXELS, len(photo_px)), replace=False)
    middle, size = np.array(shape[::-1]) / 2.0, float(max(shape))
    at, cells = (photo_px - middle) / size, regular(grid, index)
    origin = np.median(cells[some], axis=0)
    homography, mask = cv2.findHomography(at[some], cells[some] - origin, cv2.RANSAC, 1.5 * CORNER, maxIters=1000)
    share = float(np.mean(mask)) if np.size(homography) == 9 else 0.0
    _check_agreement(name, share)
    numbers = np.concatenate([(homography / homography[2, 2]).ravel()[:8], np.zeros(2)])
    for reach in (1.5 * CORNER, CORNER):
        near = abs(_mapped(numbers, at) + origin - cells).max(axis=1) < reach
        names, groups = number_lenslets(index[near])
        count = np.bincount(groups)
        usual = count >= 0.5 * np.median(count)
        middles = _sums(at[near], groups, len(names)) / count[:, None]
        pairs = middles[usual], regular(grid, names[usual]) - origin
        numbers = least_squares(_off, numbers, loss="soft_l1", f_scale=0.05, x_scale=SCALES, args=pairs).x
    outline = Outline(Lattice(grid, 1.0), middle, size, numbers, origin)
    agree = float((outline.located(photo_px[some])[0] == index[some]).all(axis=1).mean())
    _check_agreement(name, agree)
    return replace(outline, agree=agree)


def _off(numbers: Floats, at: Values, wanted: Values) -> Floats:
    """Return how far a map brings points from where they belong, (2 N,)."""
    return np.ravel(_mapped(numbers, at) - wanted)


def _check_agreement(name: str, share: float) -> None:
    """Refuse a map that few pixels follow."""
    if share < LEAST_AGREEING:
        what = f"only {100.0 * share:.0f} % of the pixels see the lenslet in front of them"
        raise input_error(name, what, "check that all photographs are of one position, and of this display's patterns")


#: Part of a cell whose pixels count: beyond, a camera pixel sees through two lenslets.
INNER = 0.7
#: Rounds in which outline and lenslets of the pixels are found.
ROUNDS = 3
#: Distance of a pixel from its lenslet's middle, in steps of the lattice, from which on it is wrong.
FAR = 0.7
#: Part of a cell in which points move evenly.
MIDDLE = 0.7
#: Pixels in the middle of a cell from which on their mean counts.
FEW = 3
#: Most readings that a position keeps: 30 for each of 100,000 lenslets.
MOST_READINGS = 3_000_000
SEED = 1914
#: Most standard deviations of a pixel from the others of its lenslet.
SPREAD = 6.0
#: Least share of a neighbour's pixels of a lenslet that is not partly hidden, but for the pixels' grid.
WHOLE = 0.95
#: The same of the neighbours: of lenslets that are measured, and of those that the map of the photograph is fitted to.
#: Perspective makes the neighbours of few, large lenslets differ by half of the rest.
BESIDE, BESIDE_MAPPED = 0.9, 0.8
#: Photographs are not of one place when both are less: the share of the lenslets inside the panel that are seen whole,
#: and that of the pixels that see the lenslet in front. Clean ones have 0.79 and 0.98, with a tenth wrong 0.69 and
#: 0.93, blurred by 3 pixels 0.39 and 0.99, moved by 3 pixels 0.25 and 0.85.
STEADY, AGREE = 0.45, 0.96
#: Least share of the usual number of pixels that a lenslet must have.
LEAST_SHARE = 0.35


@dataclass(frozen=True)
class Readings:
    """What M camera pixels of the lenslets' inner cells read.

    `panel_px` (M, 2) are the panel points, `local` (M, 2) the places in the cell of pitch 1, `group` (M,) the numbers
    of the lenslets, which ascend.
    """

    panel_px: npt.NDArray[np.float32]
    local: npt.NDArray[np.float32]
    group: Indices


@dataclass(frozen=True)
class Lenslets:
    """Of N lenslets that one position sees: what is seen through each, and where.

    `index` (N, 2) int64 are their (i, j), `photo_px` (N, 2) their middles in the photograph, `panel_mm` (N, 2) the
    points of the panel seen through their inner cells, which are within `half_px` (N, 2) pixels of the panel.
    """

    name: str
    shape: tuple[int, int]
    index: Indices
    photo_px: Floats
    panel_mm: Floats
    half_px: Floats
    #: Where the photograph shows the cells' middles that the panel points are for, (N, 2); steps of the photograph's
    #: pixels in the cell of pitch 1, (2, 2); and how the panel points move over it, (N, 2, 2), mm for each pitch.
    cell_px: Floats
    steps: Floats
    moves: Floats
    #: Movement of the panel point over the lenslet's aperture: (2, 2), mm for each pitch across the cell.
    spread: Floats
    #: Share of the pixels that see the lenslet in front of them.
    agree: float
    modulation: float
    readings: Readings | None = None


def _match_pixels(
    decoded: Decoded, seen: SeenLattice, points_mm: Floats, grid: Grid
) -> tuple[Outline, Indices, npt.NDArray[np.bool_]]:
    """Return the outlines in the photograph, the lenslets (i, j) of the pixels, and which pixels belong to theirs.

    In focus, all of a lenslet shows one point. Else points move over it, and with the outline, better known after each
    round, a point tells its lenslet: it is l + B (q - l) in steps of the lattice, seen at q in the photograph.
    """
    panel_steps = seen.steps(points_mm)
    index, near = seen.near(points_mm)
    for _ in range(ROUNDS):
        # At the edges of the panel and beside dust a part of a lenslet is dark: its middle is not that of its pixels.
        names, groups = number_lenslets(index[near])
        complete = np.flatnonzero(near)[whole(names, np.bincount(groups))[groups]]
        outline = fit_outline(decoded.name, grid, decoded.photo_px[complete], index[complete], decoded.shape)
        at = outline.steps(decoded.photo_px)
        across = at - np.round(at)
        some = within(across, grid, MIDDLE) & (abs(panel_steps - np.round(at)) < 0.7).all(axis=1)
        off = panel_steps[some] - np.round(at[some])
        moves = np.linalg.lstsq(across[some], off - off.mean(axis=0), rcond=None)[0]
        own = _centred((panel_steps - at @ moves) @ np.linalg.inv(np.eye(2) - moves), at, some)
        index = np.round(own).astype(np.int64)
        near = within(own - index, grid, NEAR)
    # Pixels far aside are wrong.
    return outline, index, near & (abs(at - index) < FAR).all(axis=1)


def measure_lenslets(decoded: Decoded, seen: SeenLattice, display: Display) -> Lenslets:
    """Average the pixels of each lenslet's inner cell."""
    points = decoded.points_mm(display)
    outline, index, own_pixels = _match_pixels(decoded, seen, points, display.array.grid)
    home, local = outline.located(decoded.photo_px)
    # A lenslet's pixels give its middle in the photograph, also those that lie beyond its cell: seams are bent.
    names, both = number_lenslets(np.concatenate([home, index[own_pixels]]))
    groups, of_own = both[: len(home)], both[len(home) :]
    counts = np.bincount(of_own, minlength=len(names))
    sums = _sums(decoded.photo_px[own_pixels].astype(np.float64), of_own, len(names))
    photo = sums / np.maximum(counts, 1)[:, None]
    axes = np.array(outline.lattice.axes)
    inner = (abs(local @ axes.T) < 0.5 * INNER).all(axis=1)
    good = inner & own_pixels & (home == index).all(axis=1)
    for _ in range(2):
        at, middle, spread = _averages(points, local, good, groups, len(names))
        off = points - at[groups] - (local - middle[groups]) @ spread
        far = np.hypot(*off.T)
        good &= far < SPREAD * max(1e-9, 1.4826 * float(np.median(abs(off[good]))) * 1.5)
    at, middle, spread = _averages(points, local, good, groups, len(names))
    number = np.bincount(groups[good], minlength=len(names))
    usual = np.median(number[number > 0]) if (number > 0).any() else 0.0
    # A neighbour whose side is dark would leave the light of the seam to the lenslet, and move its middle.
    kept = (number >= max(2.0, LEAST_SHARE * usual)) & whole(names, counts, BESIDE)
    _check_steady(decoded.name, names, counts, outline.agree)
    if kept.sum() < 30:
        what = f"only {int(kept.sum())} lenslets are seen"
        raise input_error(
            decoded.name, what, "come nearer, or use a camera with more pixels: 4 or more across a lenslet"
        )
    panel = at[kept] - middle[kept] @ spread
    shown, _, grown = _averages(decoded.photo_px.astype(np.float64), local, good, groups, len(names))
    cells = shown[kept] - middle[kept] @ grown
    moves = np.broadcast_to(spread, (len(panel), 2, 2))
    read = np.flatnonzero(good & kept[groups])
    if len(read) > MOST_READINGS:
        read = np.sort(np.random.default_rng(SEED).choice(read, MOST_READINGS, replace=False, shuffle=False))
    read = read[np.argsort(groups[read], kind="stable")]
    readings = Readings(decoded.panel_px[read], local[read].astype(np.float32), (np.cumsum(kept) - 1)[groups[read]])
    return Lenslets(
        decoded.name,
        decoded.shape,
        names[kept],
        photo[kept],
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


def _centred(own: Floats, at: Floats, some: npt.NDArray[np.bool_]) -> Floats:
    """Return the pixels' lattice points less what those in the middle of each cell are off on average.

    Points seen aside are off by aberrations that a whole view's lattice does not have.
    """
    home = np.round(at).astype(np.int64)
    names, groups = number_lenslets(home)
    number = np.bincount(groups[some], minlength=len(names))
    off = _sums((own - home)[some], groups[some], len(names)) / np.maximum(number, 1)[:, None]
    return np.asarray(own - np.where(number[:, None] >= FEW, off, 0.0)[groups])


def _check_steady(name: str, index: Indices, counts: Indices, agree: float) -> None:
    """Refuse photographs between which the camera, or the display, moved, though it may have come back.

    Then pixels near the lenslets' edges see now one lenslet, now its neighbour: their points are those of neither.
    """
    few = 0.3 * float(np.median(counts[counts > 0])) if (counts > 0).any() else 0.0
    inside = _surrounded(*_table(index, counts), few)
    share = float((whole(index, counts) & inside).sum() / max(1, inside.sum()))
    if share < STEADY and agree < AGREE:
        what = f"the photographs do not fit together: only {100.0 * share:.0f} % of the lenslets are the same in all"
        raise input_error(name, what, "focus on the array, fix camera and display, and take the position again")


def _table(index: Indices, counts: Indices) -> tuple[Floats, Indices]:
    """Return the counts by (i, j), with two empty rows around, and the places of the lenslets there, (2, N)."""
    low = index.min(axis=0) - 2
    table = np.zeros(index.max(axis=0) - low + 3)
    places = (index - low).T
    table[tuple(places)] = counts
    return table, places


def _surrounded(table: Floats, places: Indices, least: Floats | float) -> npt.NDArray[np.bool_]:
    """Tell which lenslets have more pixels than `least` on all four sides; one neighbour may be hidden by dust."""
    i, j = places
    inside = np.ones(len(i), bool)
    for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        inside &= np.maximum(table[i + di, j + dj], table[i + 2 * di, j + 2 * dj]) > least
    return inside


def whole(index: Indices, counts: Indices, beside: float = BESIDE_MAPPED) -> npt.NDArray[np.bool_]:
    """Tell which lenslets (N, 2) are seen whole: not the outermost, and with about as many pixels as their neighbours.

    At the panel's edges a part of the outermost lenslets sees beyond the panel, which a count does not always tell.
    `beside` is the share of their pixels that the neighbours have.
    """
    table, places = _table(index, counts)
    i, j = places
    most = np.max([table[i + di, j + dj] for di in (-1, 0, 1) for dj in (-1, 0, 1) if (di, dj) != (0, 0)], axis=0)
    few = 0.6 * np.sqrt(most)
    return np.asarray(_surrounded(table, places, beside * most - few) & (counts >= WHOLE * most - few))


def _sums(values: Floats, groups: Indices, count: int) -> Floats:
    return np.stack([np.bincount(groups, weights=column, minlength=count) for column in values.T], axis=1)


def _averages(
    points: Floats, local: Floats, good: npt.NDArray[np.bool_], groups: Indices, count: int
) -> tuple[Floats, Floats, Floats]:
    """Return the means of points and of places in the cell, (M, 2) each, and how points move with places, (2, 2)."""
    number = np.maximum(np.bincount(groups[good], minlength=count), 1)[:, None]
    at, middle = (_sums(one[good], groups[good], count) / number for one in (points, local))
    across = local[good] - middle[groups[good]]
    moved = points[good] - at[groups[good]]
    spread = np.linalg.lstsq(across.T @ across, across.T @ moved, rcond=None)[0]
    return at, middle, np.asarray(spread, np.float64)

"""The lattice of the points that a camera sees on the panel: the lenslets' centres, as seen from one position.

The paraxial point seen through the lenslet at L from C is P = L (1 + D/Cz) - C D/Cz: all of one position lie on an
affine image of the array's lattice. It is found from the nominal lattice by the sum of exp(2 pi i k . P) over the
points near the panel's middle, first by trying rotations and scales, and then followed outwards by least squares.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lippmann.display.description import Display, Grid
from lippmann.errors import InputError, input_error
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Floats
from lippmann.optics.system import PanelFrame

#: How far the nominal file may be off: rotation, degrees, and pitch, a share.
MOST_ROTATION_DEG = 8.0
MOST_STRETCH = 0.05
#: Radius of the first region, in pitches, and the factor to the next.
FIRST_RADIUS, GROWTH = 4.0, 1.5
#: A point outside the cell that is smaller by this factor, around a lattice point, belongs to none.
NEAR = 0.6
#: Least share of points that are near lattice points; of random points about a third are.
LEAST_NEAR = 0.55
#: Share at which no other start is tried.
SURELY_NEAR = 0.8
#: Nearest camera, in widths of the panel: it sees the lattice enlarged by D over its distance.
NEAREST_WIDTHS = 1.5
MOST_POINTS = 80_000
#: Fewest points of the first region: some for each of its lenslets.
FEWEST = 200
SEED = 1909


@dataclass(frozen=True)
class SeenLattice:
    """Points origin + basis @ (i, j), mm in the panel's frame; the basis has the steps in i and j as columns."""

    origin: Floats
    basis: Floats
    grid: Grid

    def steps(self, points_mm: Floats) -> Floats:
        """Return points (N, 2) in steps (i, j) of the lattice, not rounded."""
        return np.asarray((points_mm - self.origin) @ np.linalg.inv(self.basis).T)

    def points(self, steps: npt.NDArray[np.number]) -> Floats:
        """Return the points of steps (N, 2), mm."""
        return np.asarray(self.origin + steps @ self.basis.T)

    def near(self, points_mm: Floats) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        """Return the nearest lattice points (i, j) of points, (N, 2), and which points are near theirs, (N,)."""
        steps = self.steps(points_mm)
        index = np.round(steps)
        return index.astype(np.int64), within(steps - index, self.grid, NEAR)


def within(steps: Floats, grid: Grid, share: float) -> npt.NDArray[np.bool_]:
    """Tell which points (..., 2), in steps of the lattice from a lattice point, are in its cell made smaller."""
    i, j = steps[..., 0], steps[..., 1]
    if grid == "square":
        return np.asarray(np.maximum(abs(i), abs(j)) < 0.5 * share)
    # Along the lines to the six neighbours, as a cell's sides are.
    return np.asarray(np.maximum(np.maximum(abs(i + 0.5 * j), abs(0.5 * i + j)), 0.5 * abs(i - j)) < 0.5 * share)


def steps_of(display: Display) -> Floats:
    """Return the steps in i and j of a display's lattice as columns, mm, panel's frame."""
    lattice, frame = Lattice.of(display.array), PanelFrame.of(display)
    columns = [frame.turn(*lattice.centre(i, j)) for i, j in ((1.0, 0.0), (0.0, 1.0))]
    return np.array(columns, float).T


def find_lattice(name: str, points_mm: Floats, display: Display) -> SeenLattice:
    """Find the lattice of the points (N, 2) that a position sees, mm, near the nominal display's.

    Raises InputError, with the position's name, when no lattice is found, or when it differs from the nominal one by
    more than the search allows.
    """
    nominal = steps_of(display)
    growth = min(0.5, display.aperture_distance_mm / (NEAREST_WIDTHS * display.panel.width_mm))
    pitch = display.array.coarsest_mm
    best: tuple[float, SeenLattice] | None = None
    # Of the middles of first regions some may be hidden.
    low, high = np.percentile(points_mm, (5.0, 95.0), axis=0)
    for shares in [*itertools.product((0.5, 0.35, 0.65), repeat=2)][:5]:
        middle = low + (high - low) * shares
        found = _followed(points_mm, middle, nominal, display.array.grid, pitch, growth)
        if found is not None and (best is None or found[0] > best[0]):
            best = found
        if best is not None and best[0] > SURELY_NEAR:
            break
    if best is None or best[0] < LEAST_NEAR:
        share = 0.0 if best is None else best[0]
        what = (
            f"the points seen on the panel form no lattice like that of '{display.name}' "
            f"({100.0 * share:.0f} % of them near lattice points)"
        )
        raise input_error(name, what, reach_text())
    # A lattice at the edge of the search may be beaten by another one beyond it.
    change = best[1].basis @ np.linalg.inv(nominal)
    turn = math.degrees(math.atan2(change[1, 0] - change[0, 1], change[0, 0] + change[1, 1]))
    stretch = math.sqrt(abs(float(np.linalg.det(change)))) - 1.0
    beyond = not -MOST_STRETCH < stretch < (1.0 + MOST_STRETCH) * (1.0 + growth) - 1.0
    if abs(turn) > MOST_ROTATION_DEG or beyond:
        raise InputError(
            f"{name}: the points seen on the panel are turned by {turn:.2f} degrees, and their distances "
            f"(pitch times magnification) differ by {100.0 * stretch:.2f} %, against the display file; {reach_text()}"
        )
    return best[1]


def reach_text() -> str:
    """Return the remedy for a nominal file that is too far off: how far it may be."""
    return (
        "check the panel's width_px and dpi, and grid, pitch_mm and gap_mm in the display file; rotation may be "
        "off by 5 degrees, pitch by 1 % and gap by 20 %"
    )


def _followed(
    points_mm: Floats, middle: Floats, nominal: Floats, grid: Grid, pitch: float, growth: float
) -> tuple[float, SeenLattice] | None:
    """Find the lattice around a middle and follow it outwards; return the share of points near it, and the lattice."""
    distance = np.hypot(*(points_mm - middle).T)
    first = points_mm[distance < FIRST_RADIUS * pitch]
    if len(first) < FEWEST:
        return None
    basis, origin = _searched(_some(first)[:10_000], middle, nominal, growth)
    found, radius, farthest = SeenLattice(origin, basis, grid), FIRST_RADIUS, distance.max() / pitch
    while True:
        region = _some(points_mm[distance < radius * pitch])
        for _ in range(3):
            again = _fitted(region, found)
            if again is None:
                return None
            found = again
        if radius > farthest:
            break
        radius *= GROWTH
    return float(found.near(_some(points_mm))[1].mean()), found


def _some(points_mm: Floats) -> Floats:
    """Return at most `MOST_POINTS` of points, chosen at random."""
    if len(points_mm) <= MOST_POINTS:
        return points_mm
    return points_mm[np.random.default_rng(SEED).integers(0, len(points_mm), MOST_POINTS)]


def _searched(points_mm: Floats, middle: Floats, nominal: Floats, growth: float) -> tuple[Floats, Floats]:
    """Return the turned and stretched nominal steps, and the origin, on which the points are most coherent."""
    step = 0.12 / FIRST_RADIUS
    turns = np.arange(-math.radians(MOST_ROTATION_DEG) * 1.2, math.radians(MOST_ROTATION_DEG) * 1.2, step)
    scales = np.arange(1.0 - 1.3 * MOST_STRETCH, (1.0 + 1.3 * MOST_STRETCH) * (1.0 + growth), step)
    local, best = points_mm - middle, (-1.0, nominal, middle)
    for turn, scale in itertools.product(turns, scales):
        c, s = math.cos(turn), math.sin(turn)
        basis = scale * np.array([[c, -s], [s, c]]) @ nominal
        waves = np.exp(2j * np.pi * (local @ np.linalg.inv(basis).T)).mean(axis=0)
        coherence = float(abs(waves).min())
        if coherence > best[0]:
            best = coherence, basis, middle + basis @ (np.angle(waves) / (2.0 * np.pi))
    return best[1], best[2]


def _fitted(points_mm: Floats, found: SeenLattice) -> SeenLattice | None:
    """Return the lattice that fits the points near the one found; None when too few are near it."""
    index, near = found.near(points_mm)
    if near.sum() < 100 or np.ptp(index[near], axis=0).min() < 2:
        return None
    middle = index[near].mean(axis=0)
    design = np.column_stack([np.ones(int(near.sum())), index[near] - middle])
    solved = np.linalg.lstsq(design, points_mm[near], rcond=None)[0]
    basis = solved[1:].T
    return SeenLattice(solved[0] - basis @ middle, basis, found.grid)

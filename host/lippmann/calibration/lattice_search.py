"""Find the lattice of the panel points that one camera position sees.

A camera at C sees through the lenslet at L the paraxial panel point P = L (1 + D/Cz) -
C D/Cz. D is the aperture distance. Points P are an affine image of the array's lattice.
The search rotates and scales the nominal lattice (reciprocal vectors k) to maximise
|sum of exp(2 pi i k^T P)| near the panel's middle. Least squares extend the lattice.
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
from lippmann.optics.rays import Bools, Floats, Indices
from lippmann.optics.system import PanelFrame

#: Maximum errors of the display file: rotation in degrees, and relative pitch error.
MAX_ROTATION_DEG, MAX_STRETCH = 8.0, 0.05
#: Radius of the initial search region, in pitches.
FIRST_RADIUS = 4.0
#: Panel points are near a lattice point if they lie in its cell, scaled by this factor.
NEAR = 0.6
MAX_POINTS, SEED = 80_000, 1909
REMEDY = (
    "correct the panel's width_px and dpi, or grid, pitch_mm and gap_mm in the display file; errors of 5 degrees, "
    "1 % of the pitch and 20 % of the gap are allowed"
)


@dataclass(frozen=True)
class SeenLattice:
    """Lattice of the points `origin + basis @ (i, j)`, mm in the panel's frame."""

    origin: Floats
    basis: Floats
    grid: Grid

    def steps(self, points_mm: Floats) -> Floats:
        """Return the real-valued lattice coordinates (i, j) of points (N, 2), mm."""
        return np.asarray((points_mm - self.origin) @ np.linalg.inv(self.basis).T)

    def points(self, steps: npt.NDArray[np.number]) -> Floats:
        """Return the points, mm, at lattice coordinates (N, 2)."""
        return np.asarray(self.origin + steps @ self.basis.T)

    def near(self, points_mm: Floats) -> tuple[Indices, Bools]:
        """Return the nearest lattice points (i, j) (N, 2), and a mask (N,) of points near them (see `NEAR`)."""
        steps = self.steps(points_mm)
        index = np.round(steps)
        return index.astype(np.int64), within(steps - index, self.grid, NEAR)


def within(steps: Floats, grid: Grid, share: float) -> Bools:
    """Return which lattice coordinates (..., 2) lie in the cell at 0, scaled by `share`."""
    i, j = steps[..., 0], steps[..., 1]
    if grid == "square":
        return np.asarray(np.maximum(abs(i), abs(j)) < 0.5 * share)
    # The sides of a hexagonal cell are perpendicular to the lines to the neighbours.
    return np.asarray(np.maximum(np.maximum(abs(i + 0.5 * j), abs(0.5 * i + j)), 0.5 * abs(i - j)) < 0.5 * share)


def steps_of(display: Display) -> Floats:
    """Return the basis of a display's lattice, mm; the columns are the steps in i and j."""
    lattice, frame = Lattice.of(display.array), PanelFrame.of(display)
    columns = [frame.turn(*lattice.centre(i, j)) for i, j in ((1.0, 0.0), (0.0, 1.0))]
    return np.array(columns, float).T


def find_lattice(name: str, points_mm: Floats, display: Display) -> SeenLattice:
    """Find the lattice of points (N, 2), mm; raise InputError if it is not near the nominal one."""
    nominal = steps_of(display)
    # The lattice is magnified by 1 + D / distance; cameras are over 1.5 panel widths away.
    growth = min(0.5, display.aperture_distance_mm / (1.5 * display.panel.width_mm))
    pitch = display.array.coarsest_mm
    best: tuple[float, SeenLattice] | None = None
    # Try several middles of the initial region: a part of the panel may be hidden.
    low, high = np.percentile(points_mm, (5.0, 95.0), axis=0)
    for shares in [*itertools.product((0.5, 0.35, 0.65), repeat=2)][:5]:
        middle = low + (high - low) * shares
        match = _extend_lattice(points_mm, middle, nominal, display.array.grid, pitch, growth)
        if match is not None and (best is None or match[0] > best[0]):
            best = match
        if best is not None and best[0] > 0.8:  # enough points are near the lattice
            break
    if best is None or best[0] < 0.55:  # of random points, a fraction of 0.33 is near
        what = f"the points seen on the panel form no lattice like that of '{display.name}'"
        percent = 0.0 if best is None else 100.0 * best[0]
        raise input_error(name, f"{what} ({percent:.0f} % of the points are near it)", REMEDY)
    # The search also tries lattices beyond the limits; refuse these.
    change = best[1].basis @ np.linalg.inv(nominal)
    turn = math.degrees(math.atan2(change[1, 0] - change[0, 1], change[0, 0] + change[1, 1]))
    stretch = math.sqrt(abs(float(np.linalg.det(change)))) - 1.0
    beyond = not -MAX_STRETCH < stretch < (1.0 + MAX_STRETCH) * (1.0 + growth) - 1.0
    if abs(turn) > MAX_ROTATION_DEG or beyond:
        raise InputError(
            f"{name}: compared with the display file, the lattice seen on the panel is rotated by {turn:.2f} degrees, "
            f"and its pitch times magnification differs by {100.0 * stretch:+.2f} %; {REMEDY}"
        )
    return best[1]


def _extend_lattice(
    points_mm: Floats, middle: Floats, nominal: Floats, grid: Grid, pitch: float, growth: float
) -> tuple[float, SeenLattice] | None:
    """Find a lattice around `middle`, extend it, and return it with the fraction of points near it."""
    distance = np.hypot(*(points_mm - middle).T)
    first = points_mm[distance < FIRST_RADIUS * pitch]
    if len(first) < 200:  # too few points per lenslet
        return None
    basis, origin = _search_lattice(_some(first)[:10_000], middle, nominal, growth)
    lattice, radius, farthest = SeenLattice(origin, basis, grid), FIRST_RADIUS, distance.max() / pitch
    while True:
        region = _some(points_mm[distance < radius * pitch])
        for _ in range(3):
            again = _fit_lattice(region, lattice)
            if again is None:
                return None
            lattice = again
        if radius > farthest:
            break
        radius *= 1.5
    return float(lattice.near(_some(points_mm))[1].mean()), lattice


def _some(points_mm: Floats) -> Floats:
    if len(points_mm) <= MAX_POINTS:
        return points_mm
    return points_mm[np.random.default_rng(SEED).integers(0, len(points_mm), MAX_POINTS)]


def _search_lattice(points_mm: Floats, middle: Floats, nominal: Floats, growth: float) -> tuple[Floats, Floats]:
    step = 0.12 / FIRST_RADIUS
    turns = np.arange(-math.radians(MAX_ROTATION_DEG) * 1.2, math.radians(MAX_ROTATION_DEG) * 1.2, step)
    scales = np.arange(1.0 - 1.3 * MAX_STRETCH, (1.0 + 1.3 * MAX_STRETCH) * (1.0 + growth), step)
    local, best = points_mm - middle, (-1.0, nominal, middle)
    for turn, scale in itertools.product(turns, scales):
        c, s = math.cos(turn), math.sin(turn)
        basis = scale * np.array([[c, -s], [s, c]]) @ nominal
        waves = np.exp(2j * np.pi * (local @ np.linalg.inv(basis).T)).mean(axis=0)
        coherence = float(abs(waves).min())
        if coherence > best[0]:
            best = coherence, basis, middle + basis @ (np.angle(waves) / (2.0 * np.pi))
    return best[1], best[2]


def _fit_lattice(points_mm: Floats, lattice: SeenLattice) -> SeenLattice | None:
    index, near = lattice.near(points_mm)
    if near.sum() < 100 or np.ptp(index[near], axis=0).min() < 2:
        return None
    middle = index[near].mean(axis=0)
    design = np.column_stack([np.ones(int(near.sum())), index[near] - middle])
    solved = np.linalg.lstsq(design, points_mm[near], rcond=None)[0]
    basis = solved[1:].T
    return SeenLattice(solved[0] - basis @ middle, basis, lattice.grid)

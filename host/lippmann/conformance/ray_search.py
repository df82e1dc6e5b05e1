"""Random rays, and rays at the onset of a property, found by bisection between rays without and with it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from lippmann.display.description import Display
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.model_choice import corners_mm, panel_size, pixels_from_cells
from lippmann.optics.system import System

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

#: Bisections that bring any two floats next to each other.
HALVINGS = 64


def random_pixels(display: Display, random: np.random.Generator, count: int) -> Floats:
    """Return points anywhere on the panel, (count, 2)."""
    return np.asarray(random.uniform(0.0, panel_size(display), (count, 2)))


def random_aims(display: Display, random: np.random.Generator, count: int, reach: float = 1.0) -> Floats:
    """Return points anywhere in a lenslet's cell, (count, 2), mm, times `reach`."""
    array = display.array
    lattice = Lattice.of(array)
    points = random.uniform(-0.6, 0.6, (4 * count + 64, 2)) * array.pitches_mm
    points = np.stack(lattice.sheared(*points.T), axis=1)
    points = points[lattice.holds(points[:, 0], points[:, 1])]
    return np.asarray(points[:count] * reach, np.float64)


def random_directions(random: np.random.Generator, count: int) -> Floats:
    """Return unit vectors (count, 2), by a root alone: the last bit of a sine depends on the machine."""
    x, y = random.uniform(-1.0, 1.0, (2, count))
    return np.asarray(np.stack([x, y], axis=1) / np.sqrt(x * x + y * y)[:, None])


def random_sizes(random: np.random.Generator, low: float, high: float, count: int) -> Floats:
    """Return numbers of every magnitude from `low` to `high`, (count, 1), by their binary exponents.

    Without a power, whose last bit depends on the machine.
    """
    (_, first), (_, last) = math.frexp(low), math.frexp(high)
    sizes = np.ldexp(random.uniform(0.5, 1.0, (count, 1)), random.integers(first, last + 1, (count, 1)))
    return np.asarray(np.clip(sizes, low, high))


def edge_points(display: Display, random: np.random.Generator, count: int, vertices: float = 0.0) -> Floats:
    """Return points on the edges of a cell, (count, 2), mm from its centre; a share `vertices` on the vertices."""
    corners = corners_mm(display.array)
    side, along = random.integers(0, len(corners), count), random.random((count, 1))
    along = np.maximum(along - vertices, 0.0) / (1.0 - vertices)
    return np.asarray(corners[side] * (1.0 - along) + corners[(side + 1) % len(corners)] * along)


def pixels_at(display: Display, local_mm: Floats, lenslet: tuple[int, int] = (0, 0)) -> tuple[Floats, Floats]:
    """Return the pixel coordinates (N, 2) of points measured from a lenslet's centre along the array's axes.

    The second array (N, 2) is the centre of each point's own cell, from that lenslet's centre, mm: the origin of the
    aims of these pixels.
    """
    lattice = System.of(display).lattice
    i, j, _, _ = lattice.locate(NumpyBackend(), local_mm[:, 0], local_mm[:, 1])
    return pixels_from_cells(display, lenslet, local_mm), np.stack(lattice.centre(i, j), axis=1)


def cell_steps(display: Display, between: Floats) -> Floats:
    """Return how many steps from a cell to a neighbour lead from one lenslet to another, (N,).

    `between` (N, 2) is the difference of their indices. On a square grid a step may be diagonal. Rows of hexagons lean:
    (1, 1) is two steps, (1, -1) one.
    """
    i, j = np.abs(between).T
    steps = np.maximum(i, j)
    return np.asarray(np.maximum(steps, np.abs(between.sum(axis=1))) if display.array.grid == "hex" else steps)


def onset(inner: Floats, outer: Floats, has: Callable[[Floats], Bools]) -> Floats:
    """Return the last aims (N, 2), to a rounding, without a property, on the way from aims `inner` to `outer`, (N, 2).

    `has` tells which of N aims have the property: none of `inner`, all of `outer`.
    """
    low, high = np.zeros(len(inner)), np.ones(len(inner))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        found = has(inner + middle[:, None] * (outer - inner))
        low, high = np.where(found, low, middle), np.where(found, middle, high)
    return np.asarray(inner + low[:, None] * (outer - inner))

"""Sets of rays, those from the panel and those from the world, and what draws them at random.

Rays at the onset of a property are found by bisection between rays without and with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lippmann.display.description import Display
from lippmann.engines import trace
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.model_choice import corners_mm, located, panel_size, pixels_from_cells
from lippmann.optics.rays import Engine, Floats, Model, Rays
from lippmann.optics.system import PanelFrame, System

Bools = npt.NDArray[np.bool_]
#: Which of N rays: their indices, a mask (N,), or a slice.
Selection = npt.NDArray[np.intp] | Bools | slice

#: Bisections that bring any two floats next to each other.
BISECTIONS = 64


@dataclass(frozen=True)
class PanelRays:
    """Rays from the panel: `pixels` (N, 2), and `aperture` points (N, 2), mm, None for chief rays."""

    name: str
    display: Display
    pixels: Floats
    aperture: Floats | None
    model: Model = "exact"

    @property
    def aims(self) -> Floats:
        """Aperture points (N, 2), mm; 0 for chief rays."""
        return np.zeros_like(self.pixels) if self.aperture is None else self.aperture

    def trace(self, engine: Engine = "golden", device: str = "llvm") -> Rays:
        """Trace the rays with an engine."""
        return trace(self.display, self.pixels, self.aperture, self.model, engine, device)

    def select(self, rays: Selection) -> PanelRays:
        """Return the rays of these indices, or of this mask."""
        aperture = None if self.aperture is None else self.aperture[rays]
        return replace(self, pixels=self.pixels[rays], aperture=aperture)

    def steps(self) -> dict[str, Floats]:
        """Return golden's intermediate values, by which a design is compared step by step.

        `panel_mm` (N, 2) is the pixel's point, panel frame; `home` (N, 2) the lenslet that owns it,
        whole numbers; `start_mm` (N, 2) the same point from that lenslet's centre, array's axes; `near_mm` (N, 2) the
        point where the ray in air crosses the array's near plane (flat face or domes' vertices), from the same centre.
        """
        panel = np.stack(PanelFrame.of(self.display).panel_from_pixel(*self.pixels.T), axis=1)
        home, start = located(self.display, self.pixels)
        near = start + self.display.gap_mm / self.display.aperture_distance_mm * (self.aims - start)
        return {"panel_mm": panel, "home": home, "start_mm": start, "near_mm": near}


@dataclass(frozen=True)
class WorldRays:
    """Rays from the world: `origin_mm` (N, 3) and unit `direction` (N, 3)."""

    name: str
    display: Display
    origin_mm: Floats
    direction: Floats

    def select(self, rays: Selection) -> WorldRays:
        """Return the rays of these indices, or of this mask."""
        return replace(self, origin_mm=self.origin_mm[rays], direction=self.direction[rays])


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
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        has_it = has(inner + middle[:, None] * (outer - inner))
        low, high = np.where(has_it, low, middle), np.where(has_it, middle, high)
    return np.asarray(inner + low[:, None] * (outer - inner))

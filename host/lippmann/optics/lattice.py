"""Finds the lenslet of a point, and the point's position in the lenslet (step 2 of a ray).

On the regular lattice of pitch 1, the centre of lenslet (i, j) is at (X, Y) = (i, j),
or at (i + j/2, j sqrt(3)/2) if hexagonal. A cell is half-open, -1/2 <= q < 1/2 along
each of its axes, so that each point belongs to exactly one lenslet. The array's centres
and cells are affine images of the regular ones, with the pitches px and py:

    y = py Y,   x = px X + shear y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lippmann.display.description import Array, Grid, Pair, Pitch, both_pitches
from lippmann.optics.backend import Arr, Backend, Point, State
from lippmann.optics.rays import Indices

HALF_SQRT3 = 0.5 * math.sqrt(3.0)

#: Step in (i, j) to the neighbour along each of `Lattice.axes`.
STEPS: dict[Grid, tuple[tuple[int, int], ...]] = {
    "square": ((1, 0), (0, 1)),
    "hex": ((1, 0), (0, 1), (-1, 1)),
}


@dataclass(frozen=True)
class Lattice:
    """A lattice in mm (`half_steps`: see `Array`). `half_sqrt3` has the coordinates' number format."""

    grid: Grid
    pitch_mm: Pitch
    half_sqrt3: float = HALF_SQRT3
    shear: float = 0.0
    half_steps: tuple[int, int] | None = None

    @classmethod
    def of(cls, array: Array) -> Lattice:
        """Return the lattice of an array."""
        return cls(array.grid, array.pitch_mm, shear=array.shear, half_steps=array.half_steps)

    @property
    def pitches_mm(self) -> Pair:
        """The lattice's pitches px and py, mm."""
        return both_pitches(self.pitch_mm)

    @property
    def half_mm(self) -> float:
        """Half the width of a cell along each of `axes`, mm."""
        return 0.5 * self.pitches_mm[0]

    @property
    def stepped(self) -> bool:
        """Whether walls separate domes, because cells' sides are not midway between centres."""
        px, py = self.pitches_mm
        return bool(self.shear != 0.0 or (self.grid == "hex" and px != py))

    @property
    def axes(self) -> tuple[Pair, ...]:
        """The normals a of a cell's sides; their length is 1 in a regular lattice.

        A point q from the cell's centre is inside if each a . q is in [-px/2, px/2).
        """
        regular: tuple[Pair, ...] = (1.0, 0.0), (0.0, 1.0)
        if self.grid == "hex":
            regular = (1.0, 0.0), (0.5, self.half_sqrt3), (-0.5, self.half_sqrt3)
        px, py = self.pitches_mm
        return tuple((ax, ay * (px / py) - ax * self.shear) for ax, ay in regular)

    @property
    def corners(self) -> tuple[Pair, ...]:
        """The corners of a cell, counter-clockwise, in mm from the cell's centre."""
        px, py = self.pitches_mm
        sides = len(self.axes)
        radius, first = 0.5 * px / math.cos(0.5 * math.pi / sides), 0.5 * math.pi / sides
        angles = (first + math.pi * k / sides for k in range(2 * sides))
        regular = ((radius * math.cos(angle), radius * math.sin(angle)) for angle in angles)
        return tuple(self.sheared(x, y * (py / px)) for x, y in regular)

    def sheared(self, x: Arr, y: Arr) -> Point:
        """Apply the lattice's shear to a point, mm."""
        return (x + self.shear * y, y) if self.shear else (x, y)

    def centre(self, i: Arr, j: Arr) -> Point:
        """Return the centre of lenslet (i, j), mm, in the number format of `i` and `j`."""
        px, py = self.pitches_mm
        if self.grid == "square":
            return self.sheared(i * px, j * py)
        return self.sheared((i + 0.5 * j) * px, j * (self.half_sqrt3 * py))

    def present(self, b: Backend, i: Arr, j: Arr) -> Arr:
        """Return whether lenslet (i, j) is within the array's extent (see `Array.half_steps`)."""
        if self.half_steps is None:
            return i < math.inf
        along = 2.0 * i + j if self.grid == "hex" else 2.0 * i
        return (b.absolute(along) <= self.half_steps[0]) & (b.absolute(2.0 * j) <= self.half_steps[1])

    def nearest_within(self, x: Arr, y: Arr) -> Point:
        """Return points (mm), clipped to the region between the array's outermost lenslet centres."""
        if self.half_steps is None:
            return x, y
        px, py = self.pitches_mm
        row = self.half_sqrt3 * py if self.grid == "hex" else py
        along, across = 0.5 * (self.half_steps[0] - 1) * px, (self.half_steps[1] // 2) * row
        y = np.clip(y, -across, across)
        return self.sheared(np.clip(x - self.shear * y, -along, along), y)

    def locate(self, b: Backend, x: Arr, y: Arr) -> tuple[Arr, Arr, Arr, Arr]:
        """Return a point's lenslet (i, j) in x's number format, and the point relative to the lenslet's centre, mm."""
        px, py = self.pitches_mm
        along = x - self.shear * y if self.shear else x
        if self.grid == "square":
            i = b.floor(along * (1.0 / px) + 0.5)
            j = b.floor(y * (1.0 / py) + 0.5)
        else:
            # Find the lattice parallelogram around the point, then the nearest of its
            # four corners; the bisectors are q = 1/2 and q = 1 along the cell's axes.
            t = y * (1.0 / (self.half_sqrt3 * py))
            u = along * (1.0 / px)
            s = u - 0.5 * t
            i, j = b.floor(s), b.floor(t)
            s, t = s - i, t - j
            # q0 uses u, not s + t/2: pixels on a vertical edge must get the same lenslet.
            q0, q1 = u - (i + 0.5 * j), 0.5 * s + t
            near = (q0 < 0.5) & (q1 < 0.5)
            far = (q0 >= 1.0) & (q1 >= 1.0)
            right = t < s
            i = i + b.where(near, 0.0, b.where(far | right, 1.0, 0.0))
            j = j + b.where(near, 0.0, b.where(~far & right, 0.0, 1.0))
        cx, cy = self.centre(i, j)
        return i, j, x - cx, y - cy

    def across(self, x: Arr, y: Arr) -> list[Arr]:
        """Return the coordinates of a point or vector along the lattice's `axes`."""
        return [ax * x + ay * y for ax, ay in self.axes]

    def holds(self, x: Arr, y: Arr) -> Arr:
        """Return whether a point, measured from a lenslet's centre, is in the lenslet's cell."""
        inside: Arr = True
        for q in self.across(x, y):
            inside = inside & (q >= -self.half_mm) & (q < self.half_mm)
        return inside

    def leave(self, b: Backend, x: Arr, y: Arr, dx: Arr, dy: Arr) -> tuple[Arr, Point, Point]:
        """Find where the line (x, y) + t (dx, dy) leaves the cell around the origin.

        Return t at the cell's side (infinite if dx = dy = 0), the step (di, dj) to the
        neighbour across that side, and the vector to the neighbour's centre, mm.
        """
        nearest: State = ()
        for q, v, (si, sj) in zip(self.across(x, y), self.across(dx, dy), STEPS[self.grid], strict=True):
            sign = b.where(v < 0.0, -1.0, 1.0)
            parallel = b.absolute(v) < 1e-30
            t = b.where(parallel, math.inf, (sign * self.half_mm - q) / b.where(parallel, 1.0, v))
            side = (t, *(sign * step for step in (si, sj, *self.centre(si, sj))))
            if nearest:
                first = t < nearest[0]
                side = tuple(b.where(first, new, old) for new, old in zip(side, nearest, strict=True))
            nearest = side
        t, di, dj, cx, cy = nearest
        return t, (di, dj), (cx, cy)


def number_lenslets(index: Indices) -> tuple[Indices, Indices]:
    """Return the distinct lenslets (M, 2), ascending, and each given lenslet's index in them (N,)."""
    low = index.min(axis=0)
    span = int(np.ptp(index[:, 1])) + 1
    flat = (index[:, 0] - low[0]) * span + (index[:, 1] - low[1])
    occurs = np.bincount(flat) > 0
    return np.stack(np.divmod(np.flatnonzero(occurs), span), axis=1) + low, (np.cumsum(occurs) - 1)[flat]

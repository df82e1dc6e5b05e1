"""Step 2 of a ray: the lenslet that a point belongs to, and the point's position inside that lenslet.

The centre of lenslet (i, j) is at p (i, j) on the square grid, at p (i + j/2, j sqrt(3)/2) on the hexagonal one. A cell
is half-open, -p/2 <= q < p/2 along each of its axes, so that every point of the plane has exactly one owner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from lippmann.display import Grid
from lippmann.optics.backend import Arr, Backend

HALF_SQRT3 = 0.5 * math.sqrt(3.0)

#: Step in (i, j) to the neighbour across the side of a cell that each of `Lattice.axes` crosses.
STEPS: dict[Grid, tuple[tuple[int, int], ...]] = {
    "square": ((1, 0), (0, 1)),
    "hex": ((1, 0), (0, 1), (-1, 1)),
}


@dataclass(frozen=True)
class Lattice:
    """Square or hexagonal lattice with pitch p (mm), in the array's frame.

    `half_sqrt3` is sqrt(3)/2 in the precision of the coordinates.
    """

    grid: Grid
    pitch_mm: float
    half_sqrt3: float = HALF_SQRT3

    @property
    def axes(self) -> tuple[tuple[float, float], ...]:
        """Unit vectors perpendicular to the sides of a cell, one for each pair of opposite sides."""
        if self.grid == "square":
            return (1.0, 0.0), (0.0, 1.0)
        return (1.0, 0.0), (0.5, self.half_sqrt3), (-0.5, self.half_sqrt3)

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Corners of a cell, counter-clockwise, from its centre, mm."""
        sides = len(self.axes)
        radius, first = 0.5 * self.pitch_mm / math.cos(0.5 * math.pi / sides), 0.5 * math.pi / sides
        angles = (first + math.pi * k / sides for k in range(2 * sides))
        return tuple((radius * math.cos(angle), radius * math.sin(angle)) for angle in angles)

    def centre(self, i: Arr, j: Arr) -> tuple[Arr, Arr]:
        """Return the centre of lenslet (i, j), mm, in the floating-point format of `i` and `j`."""
        if self.grid == "square":
            return i * self.pitch_mm, j * self.pitch_mm
        return (i + 0.5 * j) * self.pitch_mm, j * (self.half_sqrt3 * self.pitch_mm)

    def locate(self, b: Backend, x: Arr, y: Arr) -> tuple[Arr, Arr, Arr, Arr]:
        """Return the owner (i, j), whole numbers in x's format, and the point from its centre (mm)."""
        p = self.pitch_mm
        if self.grid == "square":
            i = b.floor(x * (1.0 / p) + 0.5)
            j = b.floor(y * (1.0 / p) + 0.5)
        else:
            # First the corner (i, j) of the lattice parallelogram that holds the point, then the nearest of its four
            # corners: the bisectors between them are q = 1/2 and q = 1 along the cell's axes.
            t = y * (1.0 / (self.half_sqrt3 * p))
            u = x * (1.0 / p)
            s = u - 0.5 * t
            i, j = b.floor(s), b.floor(t)
            s, t = s - i, t - j
            # q0 from u, not s + t/2: a column of pixels on an upright edge keeps one owner.
            q0, q1 = u - (i + 0.5 * j), 0.5 * s + t
            near = (q0 < 0.5) & (q1 < 0.5)
            far = (q0 >= 1.0) & (q1 >= 1.0)
            right = t < s
            i = i + b.where(near, 0.0, b.where(far | right, 1.0, 0.0))
            j = j + b.where(near, 0.0, b.where(~far & right, 0.0, 1.0))
        cx, cy = self.centre(i, j)
        return i, j, x - cx, y - cy

    def holds(self, x: Arr, y: Arr) -> Arr:
        """Tell whether a point, measured from a lenslet's centre, lies in its cell."""
        half = 0.5 * self.pitch_mm
        inside = (x >= -half) & (x < half)
        for ax, ay in self.axes[1:]:
            q = y if ax == 0.0 else ax * x + ay * y
            inside = inside & (q >= -half) & (q < half)
        return inside

    def leave(self, b: Backend, x: Arr, y: Arr, dx: Arr, dy: Arr) -> tuple[Arr, tuple[Arr, Arr], tuple[Arr, Arr]]:
        """Follow the line (x, y) + t (dx, dy) out of the cell around the origin.

        Return t where it crosses the cell's side (infinite when dx = dy = 0), the step (di, dj) to the neighbour across
        that side, whole numbers in x's format, and that neighbour's centre from this one's, mm.
        """
        half = 0.5 * self.pitch_mm
        t = di = dj = cx = cy = None
        for (ax, ay), (si, sj) in zip(self.axes, STEPS[self.grid], strict=True):
            q, v = ax * x + ay * y, ax * dx + ay * dy
            sign = b.where(v < 0.0, -1.0, 1.0)
            parallel = b.absolute(v) < 1e-30
            t_k = b.where(parallel, math.inf, (sign * half - q) / b.where(parallel, 1.0, v))
            nx, ny = sign * (ax * self.pitch_mm), sign * (ay * self.pitch_mm)
            if t is None:
                t, di, dj, cx, cy = t_k, sign * si, sign * sj, nx, ny
                continue
            first = t_k < t
            t = b.where(first, t_k, t)
            di, dj = b.where(first, sign * si, di), b.where(first, sign * sj, dj)
            cx, cy = b.where(first, nx, cx), b.where(first, ny, cy)
        return t, (di, dj), (cx, cy)

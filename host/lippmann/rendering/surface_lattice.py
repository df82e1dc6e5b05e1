"""Lays lattices of points on a scene's surfaces, where the irradiance cache stores light.

On a triangle, rows of points are parallel to a side, and shorter towards the opposite
corner. On a slender triangle, all rows have equally many points, from the shortest side
to the apex. On a sphere, the rows are those of an octahedral map.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from lippmann.base.variant import Jit, dr, mi
from lippmann.optics.backend import Point

#: Patterns of the text of a Mitsuba BSDF: diffuse on one side, or on both sides.
ONE_SIDED = re.compile(r"SmoothDiffuse\[")
TWO_SIDED = re.compile(r"TwoSided\[\s*brdf\[0\] = SmoothDiffuse\[.*?brdf\[1\] = SmoothDiffuse\[", re.DOTALL)
#: Lattice index that marks a shape without a lattice.
NONE = 0xFFFFFFFF
#: Minimum lattice steps along a triangle's side.
MIN_STEPS = 1
#: Minimum lattice steps on a sphere, for interpolated light accurate to 0.1 %.
MIN_SPHERE_STEPS = 32
#: Maximum lattice steps on a shape, for float32 positions accurate to 0.001 steps.
MAX_STEPS = 1 << 14
#: Maximum lattice points, each for both sides of its surface.
MAX_POINTS = 1 << 22


@dataclass
class Lattices:
    """The lattices of all triangles and spheres, as Dr.Jit arrays indexed by lattice."""

    #: Each shape's first lattice, or NONE, indexed by the shape's number in Dr.Jit.
    of_shape: Jit
    #: Index of each lattice's first point.
    first: Jit
    #: Steps along the longest row of each lattice.
    steps: Jit
    #: Steps from each lattice's first row to its last.
    row_steps: Jit
    shape: Jit
    triangle: Jit
    kind: Jit
    centre: Jit
    radius: Jit


#: Bit in `Lattices.kind` for a sphere.
SPHERE = 1
#: Bit in `Lattices.kind` for a two-sided surface.
TWO = 2
#: Bit in `Lattices.kind` for a slender triangle.
FAN = 4
#: Bits in `Lattices.kind` for a slender triangle's apex: at corner 1, at corner 2.
APEX_1, APEX_2 = 8, 16
#: Kind bits of lattices whose rows have equally many points.
EVEN = SPHERE | FAN


@dataclass
class Place:
    """Positions on surfaces: lattice index, coordinates 0 to 1, and mask of back sides."""

    lattice: Jit
    u: Jit
    v: Jit
    back: Jit


def corners(lattices: Lattices, place: Place) -> tuple[list[Jit], list[Jit]]:
    """Return the three lattice points around each position, and their interpolation weights."""
    lattice, back = place.lattice, place.back
    steps, row_steps = (dr.gather(mi.UInt32, numbers, lattice) for numbers in (lattices.steps, lattices.row_steps))
    kind = dr.gather(mi.UInt32, lattices.kind, lattice)
    even = (kind & EVEN) != 0
    u, v = _on_fan(kind, place.u, place.v)
    along, up = u * mi.Float(steps), v * mi.Float(row_steps)
    j = dr.clip(mi.Int32(dr.floor(up)), 0, mi.Int32(row_steps) - 1)
    last = dr.select(even, mi.Int32(steps) - 1, mi.Int32(steps) - 1 - j)
    i = dr.clip(mi.Int32(dr.floor(along)), 0, last)
    a, b = along - mi.Float(i), up - mi.Float(j)
    # Each row of a triangle's lattice ends with half a cell.
    upper = (a + b > 1.0) & (even | (i < last))
    one = dr.select(upper, 1, 0)
    corner = mi.UInt32(i + one), mi.UInt32(j + one)
    right = mi.UInt32(i + 1), mi.UInt32(j)
    above = mi.UInt32(i), mi.UInt32(j + 1)
    first = dr.gather(mi.UInt32, lattices.first, lattice)
    side = dr.select(back, mi.UInt32(1), mi.UInt32(0))

    def number(x: Jit, y: Jit) -> Jit:
        row = dr.select(even, y * (steps + 1), _points_before(y, steps))
        return 2 * (first + row + x) + side

    # In the upper half of a cell, coordinates are measured from the opposite corner.
    weights = [dr.select(upper, a + b - 1.0, 1.0 - a - b), dr.select(upper, 1.0 - b, a), dr.select(upper, 1.0 - a, b)]
    return [number(*corner), number(*right), number(*above)], weights


def _on_fan(kind: Jit, u: Jit, v: Jit) -> Point:
    """Convert u, v to coordinates on a slender triangle: s along a row, t towards the apex."""
    # On a triangle, u and v are the barycentric weights of corners 1 and 2.
    apex_1, apex_2 = (kind & APEX_1) != 0, (kind & APEX_2) != 0
    w = 1.0 - u - v
    to_apex, one, other = (
        dr.select(apex_1, a, dr.select(apex_2, b, c)) for a, b, c in ((u, v, w), (v, w, u), (w, u, v))
    )
    s = dr.clip(one / dr.maximum(one + other, 1e-30), 0.0, 1.0)
    fan = (kind & FAN) != 0
    return dr.select(fan, s, u), dr.select(fan, to_apex, v)


def _from_fan(kind: Jit, s: Jit, t: Jit) -> Point:
    apex_1, apex_2 = (kind & APEX_1) != 0, (kind & APEX_2) != 0
    one, other = s * (1.0 - t), (1.0 - s) * (1.0 - t)
    u = dr.select(apex_1, t, dr.select(apex_2, other, one))
    v = dr.select(apex_1, one, dr.select(apex_2, t, other))
    fan = (kind & FAN) != 0
    return dr.select(fan, u, s), dr.select(fan, v, t)


def _points_before(row: Jit, steps: Jit) -> Jit:
    return row * (steps + 1) - (row * (row - 1)) // 2


def on_octahedron(direction: Jit) -> Point:
    """Map a direction to a point of the unit square (octahedral map)."""
    x, y, z = direction.x, direction.y, direction.z
    size = dr.abs(x) + dr.abs(y) + dr.abs(z)
    x, y = x / size, y / size
    x, y = _folded(x, y, z < 0.0)
    return 0.5 * x + 0.5, 0.5 * y + 0.5


def from_octahedron(u: Jit, v: Jit) -> Jit:
    """Map a point of the unit square to a direction: the inverse of `on_octahedron`."""
    x, y = 2.0 * u - 1.0, 2.0 * v - 1.0
    z = 1.0 - dr.abs(x) - dr.abs(y)
    return dr.normalize(mi.Vector3f(*_folded(x, y, z < 0.0), z))


def _folded(x: Jit, y: Jit, low: Jit) -> Point:
    # The octahedral map puts the lower half of the sphere into the square's corners.
    right, up = (dr.select(side < 0.0, -1.0, 1.0) for side in (x, y))
    return dr.select(low, (1.0 - dr.abs(y)) * right, x), dr.select(low, (1.0 - dr.abs(x)) * up, y)


def place_of(lattices: Lattices, point: Jit) -> Place:
    """Return the surface positions of the lattice points with indices `point`."""
    back = (point & 1) != 0
    place = point >> 1
    lattice = dr.binary_search(
        0, dr.width(lattices.first) - 1, lambda k: dr.gather(mi.UInt32, lattices.first, k + 1) <= place
    )
    steps, row_steps, kind = (
        dr.gather(mi.UInt32, numbers, lattice) for numbers in (lattices.steps, lattices.row_steps, lattices.kind)
    )
    even = (kind & EVEN) != 0
    place -= dr.gather(mi.UInt32, lattices.first, lattice)
    # A triangle's row is the largest j with j (steps + 1) - j (j - 1) / 2 <= place.
    half = mi.Float64(steps) + 1.5
    row = mi.UInt32(dr.floor(half - dr.sqrt(dr.maximum(half * half - 2.0 * mi.Float64(place), 0.0))))
    row = dr.select(_points_before(row, steps) > place, row - 1, row)
    row = dr.select(_points_before(row + 1, steps) <= place, row + 1, row)
    row = dr.select(even, place // (steps + 1), row)
    column = place - dr.select(even, row * (steps + 1), _points_before(row, steps))
    u, v = _from_fan(kind, mi.Float(column) / mi.Float(steps), mi.Float(row) / mi.Float(row_steps))
    return Place(mi.UInt32(lattice), u, v, back)


def lay_lattices(scene: Jit, spacing: float, max_points: int) -> tuple[Lattices, int]:
    """Return the smallest shapes' lattices, up to `max_points` points, and the number of points."""
    parts: list[dict[str, Jit]] = []
    for shape in scene.shapes():
        text = str(shape.bsdf())
        two = bool(TWO_SIDED.match(text))
        part = _lay_shape(shape, spacing) if two or ONE_SIDED.match(text) else None
        if part is not None:
            number = int(np.asarray(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])
            part["kind"] |= TWO if two else 0
            part["shape"] = np.full(len(part["steps"]), number)
            part["points"] = _points(part["steps"], part["row_steps"], part["kind"])
            parts.append(part)
    parts.sort(key=lambda part: part["points"].sum())
    count = np.searchsorted(np.cumsum([part["points"].sum() for part in parts]), max_points, side="right")
    parts = parts[:count]
    if not parts:
        return Lattices(*([None] * 9)), 0
    numbers = [int(part["shape"][0]) for part in parts]
    begins = np.concatenate([[0], np.cumsum([len(part["steps"]) for part in parts])])
    joined = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    first = np.concatenate([[0], np.cumsum(joined["points"])])
    of_shape = np.full(max(numbers) + 1, NONE, np.uint32)
    of_shape[numbers] = begins[:-1]
    counts = {
        key: mi.UInt32(joined[key].astype(np.uint32)) for key in ("steps", "row_steps", "shape", "triangle", "kind")
    }
    lattices = Lattices(
        of_shape=mi.UInt32(of_shape),
        first=mi.UInt32(first[:-1].astype(np.uint32)),
        centre=mi.Float(joined["centre"].astype(np.float32).ravel()),
        radius=mi.Float(joined["radius"].astype(np.float32)),
        **counts,
    )
    return lattices, int(first[-1])


def _points(steps: Jit, row_steps: Jit, kind: Jit) -> Jit:
    return np.where(kind & EVEN, (steps + 1) * (row_steps + 1), (steps + 1) * (steps + 2) // 2)


def _lay_shape(shape: Jit, spacing: float) -> dict[str, Jit] | None:
    """Return a shape's lattices, keyed as in `Lattices`; None if unsuitable or too large."""
    if shape.is_mesh():
        points = np.array(shape.vertex_positions_buffer(), np.float64).reshape(-1, 3)
        faces = np.array(shape.faces_buffer()).reshape(-1, 3)
        if not len(faces) or not np.isfinite(points).all():
            return None
        # Column k of `sides` has the lengths of the sides opposite corner k.
        sides = np.linalg.norm(points[np.roll(faces, 1, axis=1)] - points[np.roll(faces, 2, axis=1)], axis=2)
        if sides.max() > MAX_STEPS * spacing:
            return None
        long, short = (
            np.maximum(np.ceil(length / spacing), MIN_STEPS).astype(np.int64)
            for length in (sides.max(axis=1), sides.min(axis=1))
        )
        # Treat a triangle as slender only if this at least halves its points: cells may be oblique.
        fan = 2 * _points(short, long, FAN) <= _points(long, long, 0)
        apex = np.array([0, APEX_1, APEX_2])[sides.argmin(axis=1)]
        count = len(faces)
        numbers = {"steps": np.where(fan, short, long), "row_steps": long, "kind": np.where(fan, FAN | apex, 0)}
        return {**numbers, "triangle": np.arange(count), "centre": np.zeros((count, 3)), "radius": np.zeros(count)}
    if shape.class_name() == "Sphere":
        box = shape.bbox()
        low = np.array(box.min, np.float64).ravel()
        high = np.array(box.max, np.float64).ravel()
        radius = 0.5 * (high - low)[0]
        if not math.pi * radius <= MAX_STEPS * spacing:
            return None
        steps = max(math.ceil(math.pi * radius / spacing), MIN_SPHERE_STEPS)
        numbers = {"steps": np.array([steps]), "row_steps": np.array([steps]), "kind": np.array([SPHERE])}
        return {**numbers, "triangle": np.zeros(1), "centre": 0.5 * (low + high)[None], "radius": np.array([radius])}
    return None

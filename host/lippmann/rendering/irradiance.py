"""An irradiance cache: what lamps send to diffuse surfaces, found once for each point of a lattice over a surface.

The lattices of this module lie on the scene's surfaces; the lenslets' is `lippmann.optics.lattice`. Thousands of
lenslets look at the same square millimetre of a scene. A triangle has a lattice of points along its sides, a sphere one
of the octahedron that is folded about it. Between three points the light is interpolated linearly. Where a lamp lights
some of the three but not all, a shadow's edge may lie between them, and a ray to the lamp decides. So the light is
wrong only in shadows, and in lit gaps, that are narrower than the points are apart.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from lippmann.rendering.recorded import Recorded
from lippmann.rendering.scene import Scene
from lippmann.variant import drjit, mitsuba

#: Diffuse surfaces, as Mitsuba writes their BSDFs: of one side, or of two alike in kind.
ONE_SIDED = re.compile(r"SmoothDiffuse\[")
TWO_SIDED = re.compile(r"TwoSided\[\s*brdf\[0\] = SmoothDiffuse\[.*?brdf\[1\] = SmoothDiffuse\[", re.DOTALL)
#: The number of a shape without a lattice.
NONE = 0xFFFFFFFF
#: Steps of a lattice, at least and at most; those of a sphere keep the light's bend between points below 1 in 1,000.
LEAST_STEPS, LEAST_SPHERE_STEPS, MOST_STEPS = 1, 32, 2048
#: Points of all lattices at most; each side of a surface has its own light.
MOST_POINTS = 1 << 22
#: Bit of the lamps' word of a point whose light is known; the others tell which lamps it sees.
KNOWN = 1 << 31
MOST_LAMPS = 31
#: A spot's picture, as Mitsuba writes it; a spot without one has a uniform spectrum there.
PICTURE = re.compile(r"texture = (?!UniformSpectrum)")
#: Lamps, by Mitsuba's names, whose light bends little between points.
LAMPS = ("PointLight", "SpotLight", "DirectionalEmitter")


@dataclass
class Lattices:
    """The lattices of all triangles and spheres, numbered one after the other: Dr.Jit arrays."""

    #: The first lattice of a shape, by the number of its pointer; NONE without.
    of_shape: Any
    #: Of each lattice: its first point, steps along a side, shape, triangle, and the kinds (bits: sphere, two-sided).
    first: Any
    steps: Any
    shape: Any
    triangle: Any
    kind: Any
    #: Centre and radius of a sphere.
    centre: Any
    radius: Any


SPHERE, TWO = 1, 2


@dataclass
class Place:
    """Places on lattices: their numbers, the place on each, from 0 to 1, and whether on the surface's other side."""

    lattice: Any
    u: Any
    v: Any
    back: Any


class Irradiance:
    """The light on a scene's lattices, found when it is first asked for."""

    def __init__(self, scene: Scene, spacing: float, most: int = MOST_POINTS) -> None:
        """Lay the lattices, with points at most `spacing` apart, in units of the scene.

        Of `most` points; the shapes that need most of them are left without.
        """
        dr, mi = drjit(), mitsuba()
        self.lattices, self.points = _laid(scene.mitsuba, spacing, most)
        # Light and askers are written before they are read. In the lamps' words 0 means that the light is not known.
        self._light = [dr.empty(mi.Float, 2 * self.points) for _ in range(3)]
        self._lamps, self._asker = dr.zeros(mi.UInt32, 2 * self.points), dr.empty(mi.UInt32, 2 * self.points)
        emitters = list(scene.mitsuba.emitters())

        def lit(place: Place, known: Any, seen: Any, lattices: Lattices) -> tuple[Any, Any]:
            return _lit(scene.mitsuba, emitters, place, known, seen, lattices)

        def at_points(point: Any, lattices: Lattices) -> tuple[Any, Any]:
            place, nothing = place_of(lattices, point), point & 0
            return lit(place, nothing, nothing, lattices)

        self._at_points, self._lit = Recorded(at_points, scene), Recorded(lit, scene)

    def at(self, place: Place) -> Any:
        """Return the light at places themselves, divided by pi."""
        dr, mi = drjit(), mitsuba()
        # Two, as in `between`: one for both would be another recording.
        known, seen = (dr.opaque(mi.UInt32, 0, dr.width(place.lattice)) for _ in range(2))
        light, _ = self._lit(place, known, seen, self.lattices)
        return light

    def find(self, points: list[Any], wanted: Any) -> None:
        """Find the light at points (each an array of numbers), where it is not known yet."""
        dr = drjit()
        new = self._unknown(points, wanted)
        if not dr.width(new):
            return
        light, lamps = self._at_points(new, self.lattices)
        for plane, values in zip(self._light, (light.x, light.y, light.z), strict=True):
            dr.scatter(plane, values, new)
        dr.scatter(self._lamps, lamps, new)
        dr.eval(self._light, self._lamps)

    def _unknown(self, points: list[Any], wanted: Any) -> Any:
        """Return those of the points whose light is not known, each once.

        A function of its own, whose variables end with it: `dr.scatter` copies an array that another refers to.
        """
        dr, mi = drjit(), mitsuba()
        a, b, c = (dr.gather(mi.UInt32, self._lamps, point, wanted) for point in points)
        asking = dr.compress(wanted & ((a == 0) | (b == 0) | (c == 0)))
        if not dr.width(asking):
            return asking
        asked = dr.concat([dr.gather(mi.UInt32, point, asking) for point in points])
        # Of several that ask for a point one wins; which one does not matter.
        lane = dr.arange(mi.UInt32, dr.width(asked))
        dr.scatter(self._asker, lane, asked)
        won = dr.gather(mi.UInt32, self._asker, asked) == lane
        unknown = dr.gather(mi.UInt32, self._lamps, asked) == 0
        return dr.gather(mi.UInt32, asked, dr.compress(won & unknown))

    def between(self, place: Place, wanted: Any) -> Any:
        """Return the light at places, divided by pi: between three points, or found there where a shadow's edge is."""
        dr, mi = drjit(), mitsuba()
        points, weights = corners(self.lattices, place)
        self.find(points, wanted)
        total = [mi.Float(0.0)] * 3
        for point, weight in zip(points, weights, strict=True):
            total = [sum_ + weight * dr.gather(mi.Float, plane, point, wanted)
                     for sum_, plane in zip(total, self._light, strict=True)]  # fmt: skip
        a, b, c = (dr.gather(mi.UInt32, self._lamps, point, wanted) for point in points)
        light, differ = mi.Color3f(*total), (a ^ b) | (b ^ c)
        dr.eval(light, differ, a)
        del total  # it refers to the light, which `dr.scatter` would copy
        edge = dr.compress(wanted & (differ != 0))
        if dr.width(edge):
            there = Place(*(dr.gather(type(one), one, edge) for one in (place.lattice, place.u, place.v, place.back)))
            differ, seen = dr.gather(mi.UInt32, differ, edge), dr.gather(mi.UInt32, a, edge)
            own, _ = self._lit(there, ~differ, seen, self.lattices)
            dr.scatter(light, own, edge)
        return light


def has_point_lamps(scene: Any) -> bool:
    """Tell whether the lamps of a `mitsuba.Scene` are points, spots and directions without pictures, and few."""
    lamps = scene.emitters()
    return 0 < len(lamps) <= MOST_LAMPS and all(
        lamp.class_name() in LAMPS and not PICTURE.search(str(lamp)) for lamp in lamps
    )


def corners(lattices: Lattices, place: Place) -> tuple[list[Any], list[Any]]:
    """Return the three points round places on lattices, and their weights."""
    dr, mi = drjit(), mitsuba()
    lattice, u, v, back = place.lattice, place.u, place.v, place.back
    steps = dr.gather(mi.UInt32, lattices.steps, lattice)
    sphere = (dr.gather(mi.UInt32, lattices.kind, lattice) & SPHERE) != 0
    along, up = u * mi.Float(steps), v * mi.Float(steps)
    last = mi.Int32(steps) - 1
    i = dr.clip(mi.Int32(dr.floor(along)), 0, last)
    j = dr.clip(mi.Int32(dr.floor(up)), 0, dr.select(sphere, last, last - i))
    a, b = along - mi.Float(i), up - mi.Float(j)
    # A triangle's last cell of a row is a half.
    upper = (a + b > 1.0) & (sphere | (i + j < last))
    one = dr.select(upper, 1, 0)
    whole = mi.UInt32(i + one), mi.UInt32(j + one)
    right = mi.UInt32(i + 1), mi.UInt32(j)
    above = mi.UInt32(i), mi.UInt32(j + 1)
    first, side = dr.gather(mi.UInt32, lattices.first, lattice), dr.select(back, mi.UInt32(1), mi.UInt32(0))

    def number(x: Any, y: Any) -> Any:
        row = dr.select(sphere, y * (steps + 1), _before(y, steps))
        return 2 * (first + row + x) + side

    # The upper half's: opposite sides change places.
    weights = [dr.select(upper, a + b - 1.0, 1.0 - a - b), dr.select(upper, 1.0 - b, a), dr.select(upper, 1.0 - a, b)]
    return [number(*whole), number(*right), number(*above)], weights


def _before(row: Any, steps: Any) -> Any:
    """Return the number of a triangle's points before a row."""
    return row * (steps + 1) - (row * (row - 1)) // 2


def on_octahedron(direction: Any) -> tuple[Any, Any]:
    """Return the place in the unit square of a direction (octahedral mapping)."""
    dr = drjit()

    x, y, z = direction.x, direction.y, direction.z
    size = dr.abs(x) + dr.abs(y) + dr.abs(z)
    x, y = x / size, y / size
    low = z < 0.0
    x, y = (
        dr.select(low, (1.0 - dr.abs(y)) * dr.select(x < 0.0, -1.0, 1.0), x),
        dr.select(low, (1.0 - dr.abs(x)) * dr.select(y < 0.0, -1.0, 1.0), y),
    )
    return 0.5 * x + 0.5, 0.5 * y + 0.5


def from_octahedron(u: Any, v: Any) -> Any:
    """Return the direction of a place in the unit square."""
    dr, mi = drjit(), mitsuba()
    x, y = 2.0 * u - 1.0, 2.0 * v - 1.0
    z = 1.0 - dr.abs(x) - dr.abs(y)
    x, y = (
        dr.select(z < 0.0, (1.0 - dr.abs(y)) * dr.select(x < 0.0, -1.0, 1.0), x),
        dr.select(z < 0.0, (1.0 - dr.abs(x)) * dr.select(y < 0.0, -1.0, 1.0), y),
    )
    return dr.normalize(mi.Vector3f(x, y, z))


def place_of(lattices: Lattices, point: Any) -> Place:
    """Return the places of numbered points."""
    dr, mi = drjit(), mitsuba()
    back = (point & 1) != 0
    place = point >> 1
    lattice = dr.binary_search(0, dr.width(lattices.first) - 1,
                               lambda k: dr.gather(mi.UInt32, lattices.first, k + 1) <= place)  # fmt: skip
    steps, kind = dr.gather(mi.UInt32, lattices.steps, lattice), dr.gather(mi.UInt32, lattices.kind, lattice)
    sphere = (kind & SPHERE) != 0
    place -= dr.gather(mi.UInt32, lattices.first, lattice)
    # The row: of a triangle the largest j with j (n + 1) - j (j - 1) / 2 <= place.
    half = mi.Float64(steps) + 1.5
    row = mi.UInt32(dr.floor(half - dr.sqrt(dr.maximum(half * half - 2.0 * mi.Float64(place), 0.0))))
    row = dr.select(_before(row, steps) > place, row - 1, row)
    row = dr.select(_before(row + 1, steps) <= place, row + 1, row)
    row = dr.select(sphere, place // (steps + 1), row)
    column = place - dr.select(sphere, row * (steps + 1), _before(row, steps))
    return Place(mi.UInt32(lattice), mi.Float(column) / mi.Float(steps), mi.Float(row) / mi.Float(steps), back)


def _lit(scene: Any, emitters: list[Any], place: Place, known: Any, seen: Any, lattices: Lattices) -> tuple[Any, Any]:
    """Return the light at places, divided by pi, and their lamps' words.

    Of the lamps in `known` (bits) `seen` tells which are seen; to the others goes a shadow ray each.
    """
    dr, mi = drjit(), mitsuba()
    lattice, u, v = place.lattice, place.u, place.v
    outward = from_octahedron(u, v)
    centre, radius = dr.gather(mi.Point3f, lattices.centre, lattice), dr.gather(mi.Float, lattices.radius, lattice)
    hit = dr.zeros(mi.PreliminaryIntersection3f, dr.width(u))
    hit.valid, hit.t = dr.full(mi.Bool, True, dr.width(u)), radius
    hit.prim_uv = mi.Point2f(u, v)
    hit.prim_index = dr.gather(mi.UInt32, lattices.triangle, lattice)
    hit.shape = dr.reinterpret_array(mi.ShapePtr, dr.gather(mi.UInt32, lattices.shape, lattice))
    ray = mi.Ray3f(centre + 2.0 * radius * outward, -outward)
    si = hit.compute_surface_interaction(ray, mi.RayFlags.All, mi.Bool(True))
    side = dr.select(place.back, -1.0, 1.0)
    light, lamps = mi.Color3f(0.0), mi.UInt32(KNOWN)
    for bit, emitter in enumerate(emitters):
        ds, weight = emitter.sample_direction(si, mi.Point2f(0.5), mi.Bool(True))
        cosine = side * dr.dot(si.sh_frame.n, ds.d)
        value = dr.select((ds.pdf != 0.0) & (cosine > 0.0), mi.Color3f(weight) * cosine, 0.0)
        faces, told = dr.any(value != 0.0), (known & (1 << bit)) != 0
        hidden = scene.ray_test(si.spawn_ray_to(ds.p), faces & ~told)
        reached = faces & dr.select(told, (seen & (1 << bit)) != 0, ~hidden)
        light += dr.select(reached, value, 0.0)
        lamps |= dr.select(reached, mi.UInt32(1 << bit), mi.UInt32(0))
    return light * (1.0 / math.pi), lamps


def _laid(scene: Any, spacing: float, most: int) -> tuple[Lattices, int]:
    """Return the lattices of a scene's shapes, and the number of their points."""
    dr, mi = drjit(), mitsuba()
    parts: list[dict[str, Any]] = []
    for shape in scene.shapes():
        text = str(shape.bsdf())
        two = bool(TWO_SIDED.match(text))
        part = _of_shape(shape, spacing) if two or ONE_SIDED.match(text) else None
        if part is not None and part["steps"].max(initial=0) <= MOST_STEPS:
            number = int(np.asarray(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])
            part["kind"] |= TWO if two else 0
            part["shape"] = np.full(len(part["steps"]), number)
            part["points"] = _points(part["steps"], part["kind"])
            parts.append(part)
    parts.sort(key=lambda part: part["points"].sum())
    kept = np.searchsorted(np.cumsum([part["points"].sum() for part in parts]), most, side="right")
    parts = parts[:kept]
    if not parts:
        return Lattices(*([None] * 8)), 0
    numbers = [int(part["shape"][0]) for part in parts]
    begins = np.concatenate([[0], np.cumsum([len(part["steps"]) for part in parts])])
    joined = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    first = np.concatenate([[0], np.cumsum(joined["points"])])
    of_shape = np.full(max(numbers) + 1, NONE, np.uint32)
    of_shape[numbers] = begins[:-1]
    made = Lattices(
        mi.UInt32(of_shape), mi.UInt32(first[:-1].astype(np.uint32)), mi.UInt32(joined["steps"].astype(np.uint32)),
        mi.UInt32(joined["shape"].astype(np.uint32)), mi.UInt32(joined["triangle"].astype(np.uint32)),
        mi.UInt32(joined["kind"].astype(np.uint32)),
        mi.Float(joined["centre"].astype(np.float32).ravel()), mi.Float(joined["radius"].astype(np.float32)),
    )  # fmt: skip
    return made, int(first[-1])


def _points(steps: Any, kind: Any) -> Any:
    """Return the numbers of points of lattices."""
    return np.where(kind & SPHERE, (steps + 1) ** 2, (steps + 1) * (steps + 2) // 2)


def _of_shape(shape: Any, spacing: float) -> dict[str, Any] | None:
    """Return the lattices of a triangle mesh or a sphere, by the names of `Lattices`; None for other shapes."""
    if shape.is_mesh():
        points = np.array(shape.vertex_positions_buffer(), np.float64).reshape(-1, 3)
        faces = np.array(shape.faces_buffer()).reshape(-1, 3)
        sides = points[faces] - points[np.roll(faces, 1, axis=1)]
        longest = np.sqrt((sides**2).sum(axis=2).max(axis=1, initial=0.0))
        steps = np.maximum(np.ceil(longest / spacing), LEAST_STEPS).astype(np.int64)
        count = len(faces)
        return {"steps": steps, "triangle": np.arange(count), "kind": np.zeros(count, np.int64),
                "centre": np.zeros((count, 3)), "radius": np.zeros(count)}  # fmt: skip
    if shape.class_name() == "Sphere":
        box = shape.bbox()
        low, high = np.array(box.min, np.float64).ravel(), np.array(box.max, np.float64).ravel()
        radius = 0.5 * (high - low)[0]
        steps = max(math.ceil(math.pi * radius / spacing), LEAST_SPHERE_STEPS)
        return {"steps": np.array([steps]), "triangle": np.zeros(1), "kind": np.array([SPHERE]),
                "centre": 0.5 * (low + high)[None], "radius": np.array([radius])}  # fmt: skip
    return None

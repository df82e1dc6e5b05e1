"""An irradiance cache: what lamps send to diffuse surfaces, found once for each point of a lattice over a surface.

Thousands of lenslets look at the same square millimetre of a scene. Between three points of a lattice the light is
interpolated linearly. Where a lamp lights some of the three but not all, a shadow's edge may lie between them, and a
ray to the lamp decides. So the light is wrong only in shadows, and in lit gaps, that are narrower than the points are
apart.
"""

from __future__ import annotations

import math
import re
from typing import Any

from lippmann.base.variant import drjit, mitsuba
from lippmann.rendering.recorded import Recorded
from lippmann.rendering.surface_lattice import MOST_POINTS, Lattices, Place, corners, from_octahedron, laid, place_of
from lippmann.scenes.scene import Scene

#: Bit of the lamps' word of a point whose light is known; the others tell which lamps it sees.
KNOWN = 1 << 31
MOST_LAMPS = 31
#: A spot's picture, as Mitsuba writes it; a spot without one has a uniform spectrum there.
PICTURE = re.compile(r"texture = (?!UniformSpectrum)")
#: Lamps, by Mitsuba's names, whose light bends little between points.
LAMPS = ("PointLight", "SpotLight", "DirectionalEmitter")


class Irradiance:
    """The light on a scene's lattices, found when it is first asked for."""

    def __init__(self, scene: Scene, spacing: float, most: int = MOST_POINTS) -> None:
        """Lay the lattices, with points at most `spacing` apart along rows and from row to row, in units of the scene.

        Of `most` points; the shapes that need most of them are left without.
        """
        dr, mi = drjit(), mitsuba()
        self.lattices, self.points = laid(scene.mitsuba, spacing, most)
        # Of each point: red, green, blue, and the lamps' word; written before it is read.
        self._light = dr.empty(mi.Float, 4 * 2 * self.points)
        # The lamps' words once more, where 0 means that the light is not known; and marks of points that are asked for.
        self._lamps, self._asked = dr.zeros(mi.UInt32, 2 * self.points), dr.zeros(mi.UInt8, 2 * self.points)
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
        dr, mi = drjit(), mitsuba()

        # A loop within one program: three scatters in turn would be three programs.
        def ask(corner: Any) -> tuple[Any]:
            point = dr.select(corner == 0, points[0], dr.select(corner == 1, points[1], points[2]))
            unknown = wanted & (dr.gather(mi.UInt32, self._lamps, point, wanted) == 0)
            dr.scatter(self._asked, mi.UInt8(1), point, unknown)
            return (corner + 1,)

        dr.while_loop((mi.UInt32(0),), lambda corner: corner < 3, ask, mode="symbolic")
        # Each once and in order: shadow rays of neighbours are traced side by side.
        new = dr.compress(self._asked != 0)
        if not dr.width(new):
            return
        dr.scatter(self._asked, mi.UInt8(0), new)
        light, lamps = self._at_points(new, self.lattices)
        dr.scatter(self._light, mi.Vector4f(*light, dr.reinterpret_array(mi.Float, lamps)), new)
        dr.scatter(self._lamps, lamps, new)
        dr.eval(self._light, self._lamps, self._asked)

    def between(self, place: Place, wanted: Any) -> Any:
        """Return the light at places, divided by pi: between three points, or found there where a shadow's edge is."""
        dr, mi = drjit(), mitsuba()
        points, weights = corners(self.lattices, place)
        self.find(points, wanted)
        known = [dr.gather(mi.Vector4f, self._light, point, wanted) for point in points]
        light = mi.Color3f(0.0)
        for weight, one in zip(weights, known, strict=True):
            light += weight * mi.Color3f(one.x, one.y, one.z)
        a, b, c = (dr.reinterpret_array(mi.UInt32, one.w) for one in known)
        differ = (a ^ b) | (b ^ c)
        dr.eval(light, differ, a)
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

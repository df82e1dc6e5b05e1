"""Computes the colours of samples, from their own rays or from an irradiance cache."""

from __future__ import annotations

import contextlib
import gc
import math
import re
import weakref
from collections.abc import Callable, Iterator

import numpy as np

from lippmann.base.images import Radiance
from lippmann.base.variant import Jit, current_device, dr, mi
from lippmann.rendering.lights import coherence_hint
from lippmann.rendering.sampling import Parts, Pose, RaySource, Seeds, lines_of, pixel_of, sampler_of
from lippmann.rendering.surface_lattice import (
    MAX_POINTS,
    NONE,
    SPHERE,
    TWO,
    Lattices,
    Place,
    corners,
    from_octahedron,
    lay_lattices,
    on_octahedron,
    place_of,
)
from lippmann.scenes.scene import Scene

#: Pattern of Dr.Jit's errors if it cannot record or replay a function.
NOT_RECORDED = re.compile(r"record|frozen|freez|replay")
#: Pattern of lamps with an image, for which a replay on a GPU crashes in Dr.Jit 1.5.
PICTURE_LAMP = re.compile(r"BitmapTexture|EnvironmentMap")


class Recorded:
    """A function of Dr.Jit values and a scene, recorded at its first call (`drjit.freeze`).

    Values that change between calls must be arguments; other values become a part of
    the recording. A function that Dr.Jit cannot record is traced at every call.
    """

    def __init__(self, function: Callable[..., Jit], scene: Scene) -> None:
        references = _References(function, scene)

        def call(*args: Jit) -> Jit:
            return references.function(*args)

        frozen: Jit = dr.freeze(call, state_fn=lambda *_: references.scene.mitsuba)
        self._function, self._frozen = function, frozen
        # Create the arrays of lamps and shapes now, so that the second call is a replay.
        self._parts = lamps, _ = scene.mitsuba.emitters(), scene.mitsuba.shapes()
        self._recordable = current_device() != "cuda" or not any(PICTURE_LAMP.search(str(lamp)) for lamp in lamps)
        weakref.finalize(self, references.release, frozen)

    def __call__(self, *args: Jit) -> Jit:
        """Run the function, and return its result."""
        if self._recordable:
            try:
                with keep_garbage():
                    return self._frozen(*args)
            except RuntimeError as error:
                # Dr.Jit also wraps errors that the function itself raises.
                cause = error if error.__cause__ is None else error.__cause__
                if not NOT_RECORDED.search(str(cause)):
                    raise cause from None
            self._recordable = False
        return self._function(*args)


class _References:
    """Holds the references of a frozen function, to free them without garbage collection."""

    def __init__(self, function: Callable[..., Jit], scene: Scene) -> None:
        self.function, self.scene = function, scene

    def release(self, frozen: Jit) -> None:
        del self.function, self.scene
        frozen.clear()


@contextlib.contextmanager
def keep_garbage() -> Iterator[None]:
    """Suspend garbage collection, because Dr.Jit crashes if a scene is freed during a recording."""
    # Dr.Jit also deadlocks if a thread frees values while another thread runs Dr.Jit.
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


#: Bit of a point's lamp mask: irradiance is computed. Other bits mark visible lamps.
COMPUTED = 1 << 31


class IrradianceCache:
    """The irradiance at a scene's lattice points, computed at first use."""

    def __init__(self, scene: Scene, spacing: float, max_points: int = MAX_POINTS) -> None:
        """Lay lattices, with points at most `spacing` scene units apart (`lay_lattices`)."""
        self.lattices, self.points = lay_lattices(scene.mitsuba, spacing, max_points)
        # Irradiance (red, green, blue) and lamp mask of each point, once computed.
        self._light = dr.empty(mi.Float, 4 * 2 * self.points)
        # Lamp masks, 0 until computed, and marks of points to compute.
        self._lamps = dr.zeros(mi.UInt32, 2 * self.points)
        self._marks = dr.zeros(mi.UInt8, 2 * self.points)
        emitters = list(scene.mitsuba.emitters())

        def light_at(place: Place, tested: Jit, visible: Jit, lattices: Lattices) -> tuple[Jit, Jit]:
            return _light_at(scene.mitsuba, emitters, place, tested, visible, lattices)

        def light_at_points(point: Jit, lattices: Lattices) -> tuple[Jit, Jit]:
            place, nothing = place_of(lattices, point), point & 0
            return light_at(place, nothing, nothing, lattices)

        self._light_at_points = Recorded(light_at_points, scene)
        self._light_at = Recorded(light_at, scene)

    def at(self, place: Place) -> Jit:
        """Compute the irradiance / pi at positions, without the cache."""
        # Use two variables, as in `between`: one for both would cause another recording.
        tested, visible = (dr.opaque(mi.UInt32, 0, dr.width(place.lattice)) for _ in range(2))
        light, _ = self._light_at(place, tested, visible, self.lattices)
        return light

    def compute(self, points: list[Jit], active: Jit) -> None:
        """Compute missing irradiance at the points of three index arrays."""

        # A loop is one program; three scatters would be three programs.
        def mark(corner: Jit) -> tuple[Jit]:
            point = dr.select(corner == 0, points[0], dr.select(corner == 1, points[1], points[2]))
            missing = active & (dr.gather(mi.UInt32, self._lamps, point, active) == 0)
            dr.scatter(self._marks, mi.UInt8(1), point, missing)
            return (corner + 1,)

        dr.while_loop((mi.UInt32(0),), lambda corner: corner < 3, mark, mode="symbolic")
        # `compress` sorts points: shadow rays of neighbouring points run side by side.
        new = dr.compress(self._marks != 0)
        if not dr.width(new):
            return
        dr.scatter(self._marks, mi.UInt8(0), new)
        light, lamps = self._light_at_points(new, self.lattices)
        dr.scatter(self._light, mi.Vector4f(*light, dr.reinterpret_array(mi.Float, lamps)), new)
        dr.scatter(self._lamps, lamps, new)
        dr.eval(self._light, self._lamps, self._marks)

    def between(self, place: Place, active: Jit) -> Jit:
        """Return the irradiance / pi at positions: interpolated, but computed at shadow edges."""
        points, weights = corners(self.lattices, place)
        self.compute(points, active)
        cached = [dr.gather(mi.Vector4f, self._light, point, active) for point in points]
        light = mi.Color3f(0.0)
        for weight, one in zip(weights, cached, strict=True):
            light += weight * mi.Color3f(one.x, one.y, one.z)
        a, b, c = (dr.reinterpret_array(mi.UInt32, one.w) for one in cached)
        differ = (a ^ b) | (b ^ c)
        dr.eval(light, differ, a)
        edge = dr.compress(active & (differ != 0))
        if dr.width(edge):
            there = Place(*(dr.gather(type(one), one, edge) for one in (place.lattice, place.u, place.v, place.back)))
            differ = dr.gather(mi.UInt32, differ, edge)
            visible = dr.gather(mi.UInt32, a, edge)
            own, _ = self._light_at(there, ~differ, visible, self.lattices)
            dr.scatter(light, own, edge)
        return light


def _light_at(
    scene: Jit, emitters: list[Jit], place: Place, tested: Jit, visible: Jit, lattices: Lattices
) -> tuple[Jit, Jit]:
    """Return the irradiance / pi and the lamp masks at positions."""
    # Bits in `tested` mark lamps that need no shadow ray, because `visible` is known.
    lattice, u, v = place.lattice, place.u, place.v
    outward = from_octahedron(u, v)
    centre = dr.gather(mi.Point3f, lattices.centre, lattice)
    radius = dr.gather(mi.Float, lattices.radius, lattice)
    hit = dr.zeros(mi.PreliminaryIntersection3f, dr.width(u))
    hit.valid, hit.t = dr.full(mi.Bool, True, dr.width(u)), radius
    hit.prim_uv = mi.Point2f(u, v)
    hit.prim_index = dr.gather(mi.UInt32, lattices.triangle, lattice)
    hit.shape = dr.reinterpret_array(mi.ShapePtr, dr.gather(mi.UInt32, lattices.shape, lattice))
    ray = mi.Ray3f(centre + 2.0 * radius * outward, -outward)
    si = hit.compute_surface_interaction(ray, mi.RayFlags.All, mi.Bool(True))
    side = dr.select(place.back, -1.0, 1.0)
    light, lamps = mi.Color3f(0.0), mi.UInt32(COMPUTED)
    for bit, emitter in enumerate(emitters):
        ds, weight = emitter.sample_direction(si, mi.Point2f(0.5), mi.Bool(True))
        cosine = side * dr.dot(si.sh_frame.n, ds.d)
        value = dr.select((ds.pdf != 0.0) & (cosine > 0.0), mi.Color3f(weight) * cosine, 0.0)
        faces, is_tested = dr.any(value != 0.0), (tested & (1 << bit)) != 0
        hidden = scene.ray_test(si.spawn_ray_to(ds.p), faces & ~is_tested)
        reached = faces & dr.select(is_tested, (visible & (1 << bit)) != 0, ~hidden)
        light += dr.select(reached, value, 0.0)
        lamps |= dr.select(reached, mi.UInt32(1 << bit), mi.UInt32(0))
    return light * (1.0 / math.pi), lamps


#: Function that follows rays; it gets sample indices, a sampler, rays, a mask, ...
Follow = Callable[..., tuple[Jit, ...]]
#: `fate` of a black sample.
BLACK = 0
#: `fate` of a sample whose light is in the cache.
CACHED = 1
#: `fate` of a sample that the integrator computes.
UNCACHED = 2


class Program:
    """The program that renders a chunk; the integrator computes each sample."""

    def __init__(self, scene: Scene, source: RaySource, samples: int, integrator: Jit) -> None:
        self._parts = Parts.of(source.layout)
        self._traced = _colour_of_each(scene, source, samples, integrator)

    def __call__(self, index: Jit, first: Jit, seeds: Seeds, pose: Pose) -> tuple[Jit, list[Jit]]:
        """Return colours of samples (`index` counts from the tile `first`) and numbers of lost samples."""
        colour, *lost = self._traced(index, first, seeds, pose, self._parts)
        return colour, lost


class CachedProgram(Program):
    """The program that reads diffuse light from the cache; the integrator computes other light."""

    def __init__(
        self, scene: Scene, source: RaySource, samples: int, integrator: Jit, max_depth: int, cache: IrradianceCache
    ) -> None:
        super().__init__(scene, source, samples, integrator)
        self.cache, self.samples, self._colours = cache, samples, source.colours
        self._met = _make_sample_program(scene, source, samples, _first_diffuse(scene, max_depth))

    def __call__(self, index: Jit, first: Jit, seeds: Seeds, pose: Pose) -> tuple[Jit, list[Jit]]:
        """See `Program`."""
        weight, place, fate, *lost = self._met(index, first, seeds, pose, self._parts, self.cache.lattices)
        cached = fate == CACHED
        colour = dr.select(cached, weight * self.light_of(place, cached), 0.0)
        uncached = dr.compress(fate == UNCACHED)
        if dr.width(uncached):
            own, _ = super().__call__(dr.gather(mi.UInt32, index, uncached), first, seeds, pose)
            dr.scatter(colour, own, uncached)
        return colour, lost

    def light_of(self, place: Place, cached: Jit) -> Jit:
        """Return the irradiance / pi at each sample that is `cached`."""
        return self.cache.between(place, cached)

    def trial(self, index: Jit, first: Jit, seeds: Seeds, pose: Pose, samples: int) -> tuple[Radiance, Radiance, float]:
        """Return radiance (pixels, 3) with and without the cache, and the fraction of uncached samples."""
        # Samples whose light is not cached are black in both arrays.
        weight, place, fate, *_ = self._met(index, first, seeds, pose, self._parts, self.cache.lattices)
        cached = fate == CACHED
        radiances = []
        for light in (self.cache.between(place, cached), self.cache.at(place)):
            means = means_of(dr.select(cached, weight * light, 0.0), self._colours, samples)
            radiances.append(np.array(dr.ravel(mi.Color3f(means))).reshape(-1, 3))
        return radiances[0], radiances[1], float(np.mean(np.array(fate) == UNCACHED))


def _make_sample_program(scene: Scene, source: RaySource, samples: int, follow: Follow) -> Callable[..., Jit]:
    rays = samples * source.colours

    def trace(index: Jit, first: Jit, seeds: Seeds, pose: Pose, parts: Parts, *others: Jit) -> tuple[Jit, ...]:
        place = index // rays
        own = index - place * rays
        colour = own // samples
        sample = own - colour * samples
        pixel, inside = pixel_of(first, place, source.width_px, source.height_px)
        lines = lines_of(source, samples, seeds, pixel, sample, parts, colour)
        lost = [mask & inside for mask in lines.lost]
        sampler = sampler_of(seeds, pixel, sample)
        results = follow(index, sampler, pose.ray(lines), lines.active & inside, *others)
        # Evaluate the results first; otherwise the counts would trace the rays again.
        dr.eval(results, lost)
        return *results, *(dr.count(mask) for mask in lost)

    return Recorded(trace, scene) if source.recordable else trace


def _colour_of_each(scene: Scene, source: RaySource, samples: int, integrator: Jit) -> Callable[..., Jit]:
    def follow(index: Jit, sampler: Jit, ray: Jit, active: Jit) -> tuple[Jit, ...]:
        radiance, _, _ = integrator.sample(scene.mitsuba, sampler, ray, None, active)
        # The 0 is opaque: 0.0 would fix the recording to the size of a black tile.
        return (dr.select(active, mi.Color3f(radiance), mi.Float(index >> 31)),)

    return _make_sample_program(scene, source, samples, follow)


def _first_diffuse(scene: Scene, max_depth: int) -> Follow:
    """Return a `Follow` to a diffuse surface; it returns a factor for irradiance / pi, a position, `fate`."""
    mirror_only = mi.BSDFContext()
    mirror_only.type_mask = mi.BSDFFlags.Delta

    def follow(index: Jit, sampler: Jit, ray: Jit, active: Jit, lattices: Lattices) -> tuple[Jit, ...]:
        shapes = dr.width(lattices.of_shape)

        def bounce(
            sampler: Jit, ray: Jit, factor: Jit, depth: Jit, fate: Jit, lattice: Jit, u: Jit, v: Jit, back: Jit,
            active: Jit,
        ) -> tuple[Jit, ...]:  # fmt: skip
            hit = scene.mitsuba.ray_intersect_preliminary(ray, coherent=coherence_hint(depth), active=active)
            active &= hit.is_valid()
            si = hit.compute_surface_interaction(ray, mi.RayFlags.All, active)
            bsdf = si.bsdf(ray)
            flags = bsdf.flags()
            smooth = active & mi.has_flag(flags, mi.BSDFFlags.Smooth)
            number = dr.reinterpret_array(mi.UInt32, hit.shape)
            listed = active & (number < shapes)
            own = dr.select(listed, dr.gather(mi.UInt32, lattices.of_shape, number, listed), NONE)
            on = smooth & (own != NONE)
            kind = dr.gather(mi.UInt32, lattices.kind, own, on)
            sphere = (kind & SPHERE) != 0
            own += dr.select(sphere, 0, hit.prim_index)
            centre = dr.gather(mi.Point3f, lattices.centre, own, on & sphere)
            round_u, round_v = on_octahedron(si.p - centre)
            lattice = dr.select(on, own, lattice)
            u = dr.select(on, dr.select(sphere, round_u, hit.prim_uv.x), u)
            v = dr.select(on, dr.select(sphere, round_v, hit.prim_uv.y), v)
            behind = si.wi.z <= 0.0
            back |= on & behind
            # The back of a one-sided surface is black.
            is_cached = on & (~behind | ((kind & TWO) != 0))
            fate = dr.select(is_cached, CACHED, dr.select(smooth & ~on, UNCACHED, fate))
            factor = dr.select(on, factor * bsdf.eval_diffuse_reflectance(si, on), factor)
            depth += 1
            active &= ~smooth & mi.has_flag(flags, mi.BSDFFlags.Delta) & (depth < max_depth)
            bounced, weight = bsdf.sample(mirror_only, si, sampler.next_1d(active), sampler.next_2d(active), active)
            ray = si.spawn_ray(si.to_world(bounced.wo))
            factor = dr.select(active, factor * weight, factor)
            active &= dr.any(factor != 0.0)
            return sampler, ray, factor, depth, fate, lattice, u, v, back, active

        nothing = index >> 31  # an opaque 0, as in `_colour_of_each`
        state = (
            sampler, mi.Ray3f(ray), mi.Spectrum(1.0), mi.UInt32(0), mi.UInt32(nothing), mi.UInt32(nothing),
            mi.Float(nothing), mi.Float(nothing), mi.Bool(False), mi.Bool(active),
        )  # fmt: skip
        _, _, factor, _, fate, lattice, u, v, back, _ = dr.while_loop(state, lambda *s: s[-1], bounce, mode="symbolic")
        return mi.Color3f(factor), Place(lattice, u, v, back), fate

    return follow


def means_of(colour: Jit, colours: int, samples: int) -> list[Jit]:
    """Return each pixel's mean colours, as planes; if `colours` is 3, each has its own samples."""

    def mean(values: Jit) -> Jit:
        return values if samples == 1 else dr.block_reduce(dr.ReduceOp.Add, values, samples) * (1.0 / samples)

    if colours == 1:
        return [mean(channel) for channel in colour]
    number = dr.arange(mi.UInt32, dr.width(colour)) // samples % colours
    means = mean(dr.select(number == 0, colour.x, dr.select(number == 1, colour.y, colour.z)))
    pixel = dr.arange(mi.UInt32, dr.width(means) // colours)
    return [dr.gather(mi.Float, means, pixel * colours + k) for k in range(colours)]

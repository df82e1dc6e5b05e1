"""How samples get their colours: each by its own rays, or by light that they share (`Irradiance`)."""

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
from lippmann.rendering.lights import coherence_hint, has_splats
from lippmann.rendering.sampling import Parts, Pose, RaySource, Seeds, lines_of, pixel_of, sampler_of
from lippmann.rendering.surface_lattice import (
    MOST_POINTS,
    NONE,
    SPHERE,
    TWO,
    Lattices,
    Place,
    corners,
    from_octahedron,
    laid,
    on_octahedron,
    place_of,
)
from lippmann.scenes.scene import Scene

#: What Dr.Jit says of a function that it cannot record or replay.
NOT_RECORDED = re.compile(r"record|frozen|freez|replay")
#: A lamp that shows a picture, as Mitsuba writes it: Dr.Jit 1.5 ends the process that replays one on a GPU.
PICTURE_LAMP = re.compile(r"BitmapTexture|EnvironmentMap")


class Recorded:
    """A function of Dr.Jit values and a scene, recorded at its first call (`drjit.freeze`).

    What changes from call to call must be among its arguments: numbers that it reads elsewhere become part of the
    recording. A function that Dr.Jit cannot record, because of the scene's plugins, is traced at every call.
    """

    def __init__(self, function: Callable[..., Jit], scene: Scene) -> None:
        held = _Held(function, scene)

        def call(*arguments: Jit) -> Jit:
            return held.function(*arguments)

        frozen: Jit = dr.freeze(call, state_fn=lambda *_: held.scene.mitsuba)
        self._function, self._frozen = function, frozen
        # Their Python objects belong to what tells one recording from another: made now, not in the first recording.
        self._parts = lamps, _ = scene.mitsuba.emitters(), scene.mitsuba.shapes()
        self._recordable = current_device() != "cuda" or not any(PICTURE_LAMP.search(str(lamp)) for lamp in lamps)
        weakref.finalize(self, held.release, frozen)

    def __call__(self, *arguments: Jit) -> Jit:
        """Return what the function returns."""
        if self._recordable:
            try:
                with garbage_kept():
                    return self._frozen(*arguments)
            except RuntimeError as error:
                # Dr.Jit wraps all that happens in the function; what it cannot record, it says so.
                cause = error if error.__cause__ is None else error.__cause__
                if not NOT_RECORDED.search(str(cause)):
                    raise cause from None
            self._recordable = False
        return self._function(*arguments)


class _Held:
    """What a frozen function needs, one step away from it.

    What it refers to itself is compared at each call, and waits for the garbage collector, since Dr.Jit's object is
    part of a cycle. But a scene must go in time: all programs contain the code of every shape and light that is alive.
    """

    def __init__(self, function: Callable[..., Jit], scene: Scene) -> None:
        self.function, self.scene = function, scene

    def release(self, frozen: Jit) -> None:
        """Let go of all, and of the recordings."""
        del self.function, self.scene
        frozen.clear()


@contextlib.contextmanager
def garbage_kept() -> Iterator[None]:
    """Keep Python from collecting garbage: Dr.Jit ends the process when a scene is freed while it records.

    In a process of several threads it stops for ever when one frees a value of Dr.Jit's while another is in Dr.Jit.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


#: Bit of the lamps' word of a point whose light is known; the others tell which lamps it sees.
KNOWN = 1 << 31
MOST_LAMPS = 31
#: A spot's picture, as Mitsuba writes it; a spot without one has a uniform spectrum there.
SPOT_PICTURE = re.compile(r"texture = (?!UniformSpectrum)")
#: Lamps, by Mitsuba's names, whose light bends little between points.
LAMPS = ("PointLight", "SpotLight", "DirectionalEmitter")


class Irradiance:
    """The light on a scene's lattices, found when it is first asked for."""

    def __init__(self, scene: Scene, spacing: float, most: int = MOST_POINTS) -> None:
        """Lay the lattices, with points at most `spacing` apart along rows and from row to row, in units of the scene.

        Of `most` points; the shapes that need most of them are left without.
        """
        self.lattices, self.points = laid(scene.mitsuba, spacing, most)
        # Of each point: red, green, blue, and the lamps' word; written before it is read.
        self._light = dr.empty(mi.Float, 4 * 2 * self.points)
        # The lamps' words once more, where 0 means that the light is not known; and marks of points that are asked for.
        self._lamps, self._asked = dr.zeros(mi.UInt32, 2 * self.points), dr.zeros(mi.UInt8, 2 * self.points)
        emitters = list(scene.mitsuba.emitters())

        def lit(place: Place, known: Jit, seen: Jit, lattices: Lattices) -> tuple[Jit, Jit]:
            return _lit(scene.mitsuba, emitters, place, known, seen, lattices)

        def at_points(point: Jit, lattices: Lattices) -> tuple[Jit, Jit]:
            place, nothing = place_of(lattices, point), point & 0
            return lit(place, nothing, nothing, lattices)

        self._at_points, self._lit = Recorded(at_points, scene), Recorded(lit, scene)

    def at(self, place: Place) -> Jit:
        """Return the light at places themselves, divided by pi."""
        # Two, as in `between`: one for both would be another recording.
        known, seen = (dr.opaque(mi.UInt32, 0, dr.width(place.lattice)) for _ in range(2))
        light, _ = self._lit(place, known, seen, self.lattices)
        return light

    def find(self, points: list[Jit], wanted: Jit) -> None:
        """Find the light at points (each an array of numbers), where it is not known yet."""

        # A loop within one program: three scatters in turn would be three programs.
        def ask(corner: Jit) -> tuple[Jit]:
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

    def between(self, place: Place, wanted: Jit) -> Jit:
        """Return the light at places, divided by pi: between three points, or found there where a shadow's edge is."""
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


def has_point_lamps(scene: Jit) -> bool:
    """Tell whether the lamps of a `mitsuba.Scene` are points, spots and directions without pictures, and few."""
    lamps = scene.emitters()
    return 0 < len(lamps) <= MOST_LAMPS and all(
        lamp.class_name() in LAMPS and not SPOT_PICTURE.search(str(lamp)) for lamp in lamps
    )


def _lit(scene: Jit, emitters: list[Jit], place: Place, known: Jit, seen: Jit, lattices: Lattices) -> tuple[Jit, Jit]:
    """Return the light at places, divided by pi, and their lamps' words.

    Of the lamps in `known` (bits) `seen` tells which are seen; to the others goes a shadow ray each.
    """
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


#: What happens to a ray; its arguments are a sampler, rays, which of them exist, and what else the program is given.
Follow = Callable[..., tuple[Jit, ...]]
#: What becomes of a sample by shared light: nothing to see, on a lattice, or to be traced by itself.
BLACK, SHARED, ALONE = 0, 1, 2


class Program:
    """The program of a chunk that asks an integrator for each sample."""

    def __init__(self, scene: Scene, source: RaySource, samples: int, integrator: Jit) -> None:
        self._parts, self._traced = Parts.of(source.layout), _colour_of_each(scene, source, samples, integrator)

    def __call__(self, index: Jit, first: Jit, seeds: Seeds, pose: Pose) -> tuple[Jit, list[Jit]]:
        """Return the colours of a chunk's samples, by their numbers (UInt32), and the numbers of lost ones.

        `first` is the chunk's first tile.
        """
        colour, *lost = self._traced(index, first, seeds, pose, self._parts)
        return colour, lost


class SharedProgram(Program):
    """The program that takes diffuse light from lattices, and asks an integrator where they tell nothing."""

    def __init__(
        self, scene: Scene, source: RaySource, samples: int, integrator: Jit, max_depth: int, light: Irradiance
    ) -> None:
        super().__init__(scene, source, samples, integrator)
        self.light, self.samples, self._colours = light, samples, source.colours
        self._met = _of_samples(scene, source, samples, _first_diffuse(scene, max_depth))

    def __call__(self, index: Jit, first: Jit, seeds: Seeds, pose: Pose) -> tuple[Jit, list[Jit]]:
        """Return what a `Program` does."""
        weight, place, fate, *lost = self._met(index, first, seeds, pose, self._parts, self.light.lattices)
        shared = fate == SHARED
        colour = dr.select(shared, weight * self.light_of(place, shared), 0.0)
        alone = dr.compress(fate == ALONE)
        if dr.width(alone):
            own, _ = super().__call__(dr.gather(mi.UInt32, index, alone), first, seeds, pose)
            dr.scatter(colour, own, alone)
        return colour, lost

    def light_of(self, place: Place, shared: Jit) -> Jit:
        """Return the light, divided by pi, that falls on the samples that are `shared`; one for each of a chunk."""
        return self.light.between(place, shared)

    def trial(self, index: Jit, first: Jit, seeds: Seeds, pose: Pose, samples: int) -> tuple[Radiance, Radiance, float]:
        """Return the radiance (pixels, 3) of a chunk by shared light, and by each sample's own light.

        Samples without a lattice are black in both; the third value is their share. Each pixel, or each of its
        colours, has so many `samples`.
        """
        weight, place, fate, *_ = self._met(index, first, seeds, pose, self._parts, self.light.lattices)
        on = fate == SHARED
        found = []
        for light in (self.light.between(place, on), self.light.at(place)):
            means = means_of(dr.select(on, weight * light, 0.0), self._colours, samples)
            found.append(np.array(dr.ravel(mi.Color3f(means))).reshape(-1, 3))
        return found[0], found[1], float(np.mean(np.array(fate) == ALONE))


def _of_samples(scene: Scene, source: RaySource, samples: int, follow: Follow) -> Callable[..., Jit]:
    """Return a program of samples: what `follow` returns for their rays, and how many were lost."""
    rays = samples * source.colours

    def trace(index: Jit, first: Jit, seeds: Seeds, pose: Pose, parts: Parts, *given: Jit) -> tuple[Jit, ...]:
        place = index // rays
        own = index - place * rays
        colour = own // samples
        sample = own - colour * samples
        pixel, inside = pixel_of(first, place, source.width_px, source.height_px)
        lines = lines_of(source, samples, seeds, pixel, sample, parts, colour)
        lost = [mask & inside for mask in lines.lost]
        sampler = sampler_of(seeds, pixel, sample)
        found = follow(index, sampler, pose.ray(lines), lines.active & inside, *given)
        # Evaluated before the sums, because each sum would trace the rays again.
        dr.eval(found, lost)
        return *found, *(dr.count(mask) for mask in lost)

    return Recorded(trace, scene) if source.recordable else trace


def _colour_of_each(scene: Scene, source: RaySource, samples: int, integrator: Jit) -> Callable[..., Jit]:
    def follow(index: Jit, sampler: Jit, ray: Jit, active: Jit) -> tuple[Jit, ...]:
        radiance, _, _ = integrator.sample(scene.mitsuba, sampler, ray, None, active)
        # Not 0.0: where all is black, the recording would keep one tile's black for a picture of any size.
        return (dr.select(active, mi.Color3f(radiance), mi.Float(index >> 31)),)

    return _of_samples(scene, source, samples, follow)


def _first_diffuse(scene: Scene, max_depth: int) -> Follow:
    """Follow rays by mirrors and glass to a surface with a lattice, as the integrator `lights` does.

    The function returns the share of the surface's light that is seen, the place, and what becomes of the sample.
    """
    mirror_only = mi.BSDFContext()
    mirror_only.type_mask = mi.BSDFFlags.Delta

    def follow(index: Jit, sampler: Jit, ray: Jit, active: Jit, lattices: Lattices) -> tuple[Jit, ...]:
        shapes = dr.width(lattices.of_shape)

        def bounce(
            sampler: Jit, ray: Jit, throughput: Jit, depth: Jit, fate: Jit, lattice: Jit, u: Jit, v: Jit, back: Jit,
            active: Jit,
        ) -> tuple[Jit, ...]:  # fmt: skip
            hit = scene.mitsuba.ray_intersect_preliminary(ray, coherent=coherence_hint(depth), active=active)
            active &= hit.is_valid()
            si = hit.compute_surface_interaction(ray, mi.RayFlags.All, active)
            bsdf = si.bsdf(ray)
            flags = bsdf.flags()
            smooth = active & mi.has_flag(flags, mi.BSDFFlags.Smooth)
            number = dr.reinterpret_array(mi.UInt32, hit.shape)
            known = active & (number < shapes)
            own = dr.select(known, dr.gather(mi.UInt32, lattices.of_shape, number, known), NONE)
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
            # The back of a surface of one side is black.
            seen = on & (~behind | ((kind & TWO) != 0))
            fate = dr.select(seen, SHARED, dr.select(smooth & ~on, ALONE, fate))
            throughput = dr.select(on, throughput * bsdf.eval_diffuse_reflectance(si, on), throughput)
            depth += 1
            active &= ~smooth & mi.has_flag(flags, mi.BSDFFlags.Delta) & (depth < max_depth)
            bounced, weight = bsdf.sample(mirror_only, si, sampler.next_1d(active), sampler.next_2d(active), active)
            ray = si.spawn_ray(si.to_world(bounced.wo))
            throughput = dr.select(active, throughput * weight, throughput)
            active &= dr.any(throughput != 0.0)
            return sampler, ray, throughput, depth, fate, lattice, u, v, back, active

        nothing = index >> 31  # opaque, as in a colour
        state = (
            sampler, mi.Ray3f(ray), mi.Spectrum(1.0), mi.UInt32(0), mi.UInt32(nothing), mi.UInt32(nothing),
            mi.Float(nothing), mi.Float(nothing), mi.Bool(False), mi.Bool(active),
        )  # fmt: skip
        _, _, throughput, _, fate, lattice, u, v, back, _ = dr.while_loop(
            state, lambda *s: s[-1], bounce, mode="symbolic"
        )
        return mi.Color3f(throughput), Place(lattice, u, v, back), fate

    return follow


def means_of(colour: Jit, colours: int, samples: int) -> list[Jit]:
    """Return the pixels' means of red, green and blue; of several colours each has the samples of its own."""

    def mean(values: Jit) -> Jit:
        return values if samples == 1 else dr.block_reduce(dr.ReduceOp.Add, values, samples) * (1.0 / samples)

    if colours == 1:
        return [mean(channel) for channel in colour]
    number = dr.arange(mi.UInt32, dr.width(colour)) // samples % colours
    means = mean(dr.select(number == 0, colour.x, dr.select(number == 1, colour.y, colour.z)))
    pixel = dr.arange(mi.UInt32, dr.width(means) // colours)
    return [dr.gather(mi.Float, means, pixel * colours + k) for k in range(colours)]


def why_not_shared(scene: Scene, source: RaySource, integrator: str) -> str | None:
    """Return why a scene's light cannot be shared, in words; None when it can."""
    if integrator != "lights":
        return f"the integrator {integrator} draws lots"
    if has_splats(scene.mitsuba):
        return "splats are lit by themselves"
    if not has_point_lamps(scene.mitsuba):
        return f"the scene has other lamps than 1 to {MOST_LAMPS} points, spots and directions without pictures"
    return "there are no lenslets" if source.detail_mm is None else None

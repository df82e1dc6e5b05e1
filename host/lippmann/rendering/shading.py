"""How samples get their colours: each by its own rays, or by light that they share (`Irradiance`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from lippmann.base.images import Radiance
from lippmann.base.variant import drjit, mitsuba
from lippmann.rendering.coherence import coherence_hint
from lippmann.rendering.irradiance import MOST_LAMPS, Irradiance, has_point_lamps
from lippmann.rendering.lights import has_splats
from lippmann.rendering.recorded import Recorded
from lippmann.rendering.sampler import sampler_of
from lippmann.rendering.samples import Parts, Pose, Seeds, colour_count, lines_of, pixel_of
from lippmann.rendering.sources import RaySource
from lippmann.rendering.surface_lattice import NONE, SPHERE, TWO, Lattices, Place, on_octahedron
from lippmann.scenes.scene import Scene

#: Renders a chunk: its samples' colours, and the numbers of lost ones. Its arguments are the numbers of the chunk's
#: samples (UInt32), its first tile, its `Seeds`, and the scene's `Pose`.
Program = Callable[[Any, Any, Seeds, Pose], tuple[Any, list[Any]]]
#: What happens to a ray; its arguments are a sampler, rays, which of them exist, and what else the program is given.
Follow = Callable[..., tuple[Any, ...]]
#: What becomes of a sample by shared light: nothing to see, on a lattice, or to be traced by itself.
BLACK, SHARED, ALONE = 0, 1, 2


def each_program(scene: Scene, source: RaySource, samples: int, integrator: Any) -> Program:
    """Return the program that asks an integrator for each sample."""
    parts = Parts.of(source.layout)
    traced = _colour_of_each(scene, source, samples, integrator)

    def program(index: Any, first: Any, seeds: Seeds, pose: Pose) -> tuple[Any, list[Any]]:
        colour, *lost = traced(index, first, seeds, pose, parts)
        return colour, lost

    return program


class SharedProgram:
    """The program that takes diffuse light from lattices, and asks an integrator where they tell nothing."""

    def __init__(
        self, scene: Scene, source: RaySource, samples: int, integrator: Any, max_depth: int, light: Irradiance
    ) -> None:
        self.light, self.samples = light, samples
        self._colours, self._parts = colour_count(source.layout), Parts.of(source.layout)
        self._traced = _colour_of_each(scene, source, samples, integrator)
        self._met = _of_samples(scene, source, samples, _first_diffuse(scene, max_depth))

    def __call__(self, index: Any, first: Any, seeds: Seeds, pose: Pose) -> tuple[Any, list[Any]]:
        """Return what a `Program` does."""
        dr, mi = drjit(), mitsuba()

        weight, place, fate, *lost = self._met(index, first, seeds, pose, self._parts, self.light.lattices)
        shared = fate == SHARED
        colour = dr.select(shared, weight * self.light_of(place, shared), 0.0)
        alone = dr.compress(fate == ALONE)
        if dr.width(alone):
            own, *_ = self._traced(dr.gather(mi.UInt32, index, alone), first, seeds, pose, self._parts)
            dr.scatter(colour, own, alone)
        return colour, lost

    def light_of(self, place: Place, shared: Any) -> Any:
        """Return the light, divided by pi, that falls on the samples that are `shared`; one for each of a chunk."""
        return self.light.between(place, shared)

    def trial(self, index: Any, first: Any, seeds: Seeds, pose: Pose, samples: int) -> tuple[Radiance, Radiance, float]:
        """Return the radiance (pixels, 3) of a chunk by shared light, and by each sample's own light.

        Samples without a lattice are black in both; the third value is their share. Each pixel, or each of its
        colours, has so many `samples`.
        """
        dr, mi = drjit(), mitsuba()

        weight, place, fate, *_ = self._met(index, first, seeds, pose, self._parts, self.light.lattices)
        on = fate == SHARED
        found = []
        for light in (self.light.between(place, on), self.light.at(place)):
            means = means_of(dr.select(on, weight * light, 0.0), self._colours, samples)
            found.append(np.array(dr.ravel(mi.Color3f(means))).reshape(-1, 3))
        return found[0], found[1], float(np.mean(np.array(fate) == ALONE))


def _of_samples(scene: Scene, source: RaySource, samples: int, follow: Follow) -> Callable[..., Any]:
    """Return a program of samples: what `follow` returns for their rays, and how many were lost."""
    dr = drjit()
    rays = samples * colour_count(source.layout)

    def trace(index: Any, first: Any, seeds: Seeds, pose: Pose, parts: Parts, *given: Any) -> tuple[Any, ...]:
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


def _colour_of_each(scene: Scene, source: RaySource, samples: int, integrator: Any) -> Callable[..., Any]:
    dr, mi = drjit(), mitsuba()

    def follow(index: Any, sampler: Any, ray: Any, active: Any) -> tuple[Any, ...]:
        radiance, _, _ = integrator.sample(scene.mitsuba, sampler, ray, None, active)
        # Not 0.0: where all is black, the recording would keep one tile's black for a picture of any size.
        return (dr.select(active, mi.Color3f(radiance), mi.Float(index >> 31)),)

    return _of_samples(scene, source, samples, follow)


def _first_diffuse(scene: Scene, max_depth: int) -> Follow:
    """Follow rays by mirrors and glass to a surface with a lattice, as the integrator `lights` does.

    The function returns the share of the surface's light that is seen, the place, and what becomes of the sample.
    """
    dr, mi = drjit(), mitsuba()

    mirror_only = mi.BSDFContext()
    mirror_only.type_mask = mi.BSDFFlags.Delta

    def follow(index: Any, sampler: Any, ray: Any, active: Any, lattices: Lattices) -> tuple[Any, ...]:
        shapes = dr.width(lattices.of_shape)

        def bounce(
            sampler: Any, ray: Any, throughput: Any, depth: Any, fate: Any, lattice: Any, u: Any, v: Any, back: Any,
            active: Any,
        ) -> tuple[Any, ...]:  # fmt: skip
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


def means_of(colour: Any, colours: int, samples: int) -> list[Any]:
    """Return the pixels' means of red, green and blue; of several colours each has the samples of its own."""
    dr, mi = drjit(), mitsuba()

    def mean(values: Any) -> Any:
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

"""Defines the integrator `lights`: all lights at each hit, point lights without noise.

*Every* emitter gets a shadow ray, and the smooth part of the BSDF reflects its light.
Rays continue by mirror reflection and refraction, up to `max_depth`. Area lights and
environments get one random sample each. Light between diffuse surfaces is ignored,
unlike in Mitsuba's `path`.
"""

from __future__ import annotations

from lippmann.base.machine import has_avx512
from lippmann.base.variant import Jit, dr, mi


def coherence_hint(depth: Jit) -> Jit:
    """Return Embree's coherence hint for rays that have met `depth` (UInt32) surfaces."""
    return depth == 0 if has_avx512() else False


#: Maximum splats that a ray passes.
MAX_SPLATS = 256


def has_splats(scene: Jit) -> bool:
    """Tell whether a `mitsuba.Scene` has splats."""
    return any(shape.is_ellipsoids() for shape in scene.shapes())


def needs_chance(scene: Jit) -> bool:
    """Tell whether `lights` may use random numbers for a scene, which cause noise."""
    # Delta lights cause no noise, unless a surface transmits, or both scatters and mirrors.
    if not all(map(_is_delta, scene.emitters())):
        return True
    for surface in scene.shapes():
        bsdf = surface.bsdf()
        if bsdf is None:
            return True
        flags, kinds = bsdf.flags(), mi.BSDFFlags
        passes = mi.has_flag(flags, kinds.DeltaTransmission) or mi.has_flag(flags, kinds.Null)
        mirrors = mi.has_flag(flags, kinds.DeltaReflection)
        scatters = mi.has_flag(flags, kinds.Smooth)
        if passes or (mirrors and scatters):
            return True
    return False


def register_lights() -> None:
    """Register the integrator plugin `lights` for Mitsuba's current variant.

    The plugin's parameters are `max_depth` (integer, maximum surfaces per ray, default
    4) and `shadows` (boolean, default true; false is for measurements).
    """
    base: Jit = mi.SamplingIntegrator

    class Lights(base):  # type: ignore[misc]
        def __init__(self, props: Jit) -> None:
            super().__init__(props)
            self.max_depth = props.get("max_depth", 4)
            self.shadows = props.get("shadows", True)

        def sample(
            self, scene: Jit, sampler: Jit, ray: Jit, medium: Jit = None, active: Jit = True
        ) -> tuple[Jit, Jit, list[Jit]]:
            if has_splats(scene):
                field = mi.load_dict({"type": "volprim_rf_basic", "max_depth": MAX_SPLATS})
                radiance, _, _, _ = field.sample(dr.ADMode.Primal, scene, sampler, ray, None, None, active)
                return radiance, mi.Bool(active), []
            return _sample_lights(scene, sampler, ray, active, self.max_depth, self.shadows)

        def aov_names(self) -> list[str]:
            return []

    mi.register_integrator("lights", Lights)


def _sample_lights(
    scene: Jit, sampler: Jit, ray: Jit, active: Jit, max_depth: int, shadows: bool
) -> tuple[Jit, Jit, list[Jit]]:
    emitters = list(scene.emitters())
    # Point, spot and directional lights are invisible, because rays never meet them.
    visible_emitters = not all(_is_delta(emitter) for emitter in emitters)
    mirror_only = mi.BSDFContext()
    mirror_only.type_mask = mi.BSDFFlags.Delta

    def bounce(
        sampler: Jit, ray: Jit, throughput: Jit, radiance: Jit, depth: Jit, met: Jit, active: Jit
    ) -> tuple[Jit, ...]:
        si = scene.ray_intersect(ray, mi.RayFlags.All, coherent=coherence_hint(depth), active=active)
        if visible_emitters:
            radiance += dr.select(active, throughput * si.emitter(scene, active).eval(si, active), 0.0)
        active &= si.is_valid()
        met |= active
        bsdf = si.bsdf(ray)
        flags = bsdf.flags()
        smooth = active & mi.has_flag(flags, mi.BSDFFlags.Smooth)
        lit = _sum_lights(scene, emitters, sampler, si, bsdf, smooth, shadows)
        radiance += dr.select(smooth, throughput * lit, 0.0)
        depth += 1
        active &= mi.has_flag(flags, mi.BSDFFlags.Delta) & (depth < max_depth)
        bounced, weight = bsdf.sample(mirror_only, si, sampler.next_1d(active), sampler.next_2d(active), active)
        ray = si.spawn_ray(si.to_world(bounced.wo))
        throughput = dr.select(active, throughput * weight, throughput)
        active &= dr.any(throughput != 0.0)
        return sampler, ray, throughput, radiance, depth, met, active

    black = mi.Spectrum(0.0)
    state = (sampler, mi.Ray3f(ray), mi.Spectrum(1.0), black, mi.UInt32(0), mi.Bool(False), mi.Bool(active))
    _, _, _, radiance, _, met, _ = dr.while_loop(state, lambda *s: s[-1], bounce, mode="symbolic")
    return radiance, met, []


def _sum_lights(scene: Jit, emitters: list[Jit], sampler: Jit, si: Jit, bsdf: Jit, active: Jit, shadows: bool) -> Jit:
    arrivals = [
        emitter.sample_direction(si, mi.Point2f(0.5) if _is_delta(emitter) else sampler.next_2d(active), active)
        for emitter in emitters
    ]
    directions = [si.to_local(ds.d) for ds, _ in arrivals]
    # One call for all lights evaluates a BSDF's texture only once.
    reflectances = dr.dispatch(bsdf, _reflectance_of_all, si, directions, active)
    total = mi.Spectrum(0.0)
    for (ds, weight), reflectance in zip(arrivals, reflectances, strict=True):
        value = dr.select(ds.pdf != 0.0, weight * reflectance, 0.0)
        lit = active & dr.any(value != 0.0)
        if shadows:
            lit &= ~scene.ray_test(si.spawn_ray_to(ds.p), lit)
        total += dr.select(lit, value, 0.0)
    return total


def _reflectance_of_all(bsdf: Jit, si: Jit, directions: list[Jit], active: Jit) -> list[Jit]:
    if bsdf is None:  # the scene has no surface, only a sky
        return [mi.Spectrum(0.0) for _ in directions]
    return [bsdf.eval(mi.BSDFContext(), si, wo, active) for wo in directions]


def _is_delta(emitter: Jit) -> bool:
    return bool(mi.has_flag(emitter.flags(), mi.EmitterFlags.Delta))

"""Where the time of a render goes: optics, camera rays, shading and shadow rays, and the process around them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.base.machine import gpu_name
from lippmann.base.variant import current_device, mitsuba
from lippmann.conformance.engine_speeds import in_turn
from lippmann.display.description import Display, load_display
from lippmann.rendering.coherence import coherence_hint
from lippmann.rendering.renderer import Settings
from lippmann.scenes.scene import Scene, load_scene

from tools.renderer_speed import ROUNDS, separately, timed

#: Displays and samples a pixel; the larger ones for a GPU, which a small picture leaves idle.
CPU_RENDERS = (("paper-square", 4), ("uhd-4k", 1))
GPU_RENDERS = (("paper-square", 4), ("uhd-4k", 1), ("uhd-4k", 16))
#: The integrators that do one stage more each, by the stage's name.
STAGES = {"optics": "nothing", "camera": "first_hit", "shading": "unshadowed", "shadows": "lights"}
#: Times of a whole process, in their order.
PROCESS = ("start_seconds", "load_seconds", "prepare_seconds", "seconds", "write_seconds")


def register_stages() -> None:
    """Register integrators that end early: `nothing` after the optics, `first_hit` after the camera rays' hits."""
    mi = mitsuba()
    import drjit as dr

    base: Any = mi.SamplingIntegrator

    class Nothing(base):  # type: ignore[misc]
        def sample(
            self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True
        ) -> tuple[Any, Any, list[Any]]:
            # Uses all of the ray, so that the compiler leaves none of the optics out.
            return mi.Spectrum(ray.d.x + ray.d.y + ray.d.z + ray.o.x + ray.o.y), active, []

    class FirstHit(base):  # type: ignore[misc]
        def sample(
            self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True
        ) -> tuple[Any, Any, list[Any]]:
            hit = scene.ray_intersect_preliminary(ray, coherent=coherence_hint(mi.UInt32(0)), active=active)
            return mi.Spectrum(dr.select(hit.is_valid(), hit.t + hit.prim_uv.x, 0.0)), active, []

    class Unshadowed(base):  # type: ignore[misc]
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            depth = props.get("max_depth", 4)
            self.lights = mi.load_dict({"type": "lights", "max_depth": depth, "shadows": False})

        def sample(
            self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True
        ) -> tuple[Any, Any, list[Any]]:
            found: tuple[Any, Any, list[Any]] = self.lights.sample(scene, sampler, ray, medium, active)
            return found

    for name, one in (("nothing", Nothing), ("first_hit", FirstHit), ("unshadowed", Unshadowed)):
        mi.register_integrator(name, one)


def stages(scene: Scene, display: Display, settings: Settings) -> dict[str, float]:
    """Time renders that do one stage more each, in turn; return each one's seconds, and pixels a second to the hits.

    `shared_seconds` are those of all stages, with shared light.

    Compilation is left out, and so is what a stage adds to the next by making rays wait for each other.
    """
    register_stages()
    each = replace(settings, shading="each")
    works = {stage: timed(scene, display, replace(each, integrator=integrator)) for stage, integrator in STAGES.items()}
    works["shared"] = timed(scene, display, replace(settings, shading="shared"))
    seconds = {stage: float(np.median(times)) for stage, times in in_turn(works, ROUNDS).items()}
    pixels = display.panel.width_px * display.panel.height_px * settings.samples
    return {
        **{f"{stage}_seconds": value for stage, value in seconds.items()},
        "pixels_per_second": pixels / seconds["camera"],
    }


def measure(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of `tools.bench stages`: `what`, and its figures."""
    device, fish = current_device(), scenes / "fish/fish.xml"
    scene = load_scene(fish)
    for name, samples in GPU_RENDERS if device == "cuda" else CPU_RENDERS:
        what = f"fish, {name}, exact, {samples} sample{'s' if samples > 1 else ''}"
        path = scenes / f"displays/{name}.toml"
        within = stages(scene, load_display(path), Settings(samples=samples, seed=seed))
        whole = separately(device, fish, path, samples, PROCESS)
        yield {"what": what, "gpu": gpu_name() if device == "cuda" else "", **within, **whole}

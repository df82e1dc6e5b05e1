"""Remarks on a scene for a display, with numbers: what is not rendered, not sharp, not seen, or noisy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lippmann.display.description import Display
from lippmann.optics.display_properties import display_properties
from lippmann.optics.rays import Engine
from lippmann.optics.zones import viewing_distance
from lippmann.rendering.lights import has_splats, needs_chance
from lippmann.rendering.pixel_filter import share_of_noise
from lippmann.rendering.renderer import Settings, make_integrator, render_view
from lippmann.rendering.samples import colours_of
from lippmann.rendering.sources import Window
from lippmann.scenes.scene import Scene

#: Range of a scene's width, in widths of the panel, that gives no remark.
SIZE_SHARE = (0.02, 1000.0)
#: Width of the trial view, pixels; one ray each.
TRIAL_PX = 96
#: Least share of the view within the depth range, and largest noise over the mean light, that give no remark.
SHARP_SHARE, NOISE = 0.1, 0.1


def overridden(scene: Scene, settings: Settings) -> Iterator[str]:
    """Yield a line about parts of the scene's file that the integrator does not use, and one if there is no light.

    Raises InputError when there is no such integrator: before the first remark.
    """
    make_integrator(scene, settings)
    if settings.integrator != "scene":
        unused = []
        if scene.integrator not in (None, settings.integrator):
            unused.append(f"the file's integrator {scene.integrator} (--integrator scene uses it)")
        media = sum(bool(shape.is_medium_transition()) for shape in scene.mitsuba.shapes())
        if media and not settings.integrator.startswith("volpath"):
            unused.append(f"the media of {media} shapes (--integrator volpath renders them)")
        if unused:
            yield f"note: {settings.integrator} ignores {' and '.join(unused)}"
    yield from scene.notes
    if not scene.mitsuba.emitters() and not has_splats(scene.mitsuba):
        yield "note: the scene has no light, so the picture is black; add an <emitter> to the file"


def remarks(scene: Scene, display: Display, settings: Settings, engine: Engine = "fast") -> Iterator[str]:
    """Yield the remarks on a render of a scene for a display, with the rays of an engine: one line each."""
    yield from overridden(scene, settings)
    panel, width = display.panel, scene.width_mm
    if width > 0.0 and not SIZE_SHARE[0] <= width / panel.width_mm <= SIZE_SHARE[1]:
        yield (
            f"note: the scene is {width:.3g} mm wide before a panel of {panel.width_mm:.4g} mm; "
            "if its units are not millimetres give --scale, such as 1000 for metres"
        )
    height_px = max(1, min(TRIAL_PX, round(TRIAL_PX * panel.height_mm / panel.width_mm)))
    window = Window(panel.width_mm, panel.height_mm, TRIAL_PX, height_px)
    eye = 0.0, 0.0, viewing_distance(display)
    trial = replace(settings, samples=1, shading="each", memory_mb=None)

    # Distances along the rays, from the plane near_mm to the first surface, scene units; 0 where a ray meets nothing.
    length = render_view(scene, eye, window, replace(trial, integrator="depth")).radiance[:, :, 0].astype(np.float64)
    y, x = np.mgrid[:height_px, :TRIAL_PX] + 0.5
    steep = eye[2] / np.sqrt(eye[2] ** 2 + sum(c**2 for c in window.point(x, y)))
    front = min(scene.depth_range_mm[1], eye[2])
    seen = (front - scene.placement.scale * length * steep)[length > 0.0]
    far, near = display_properties(display).depth_range_mm
    where = f"an eye at {eye[2]:g} mm"
    if not seen.size and width > 0.0:
        low, high = scene.depth_range_mm
        yield f"note: {where} sees none of the scene's surfaces, z = {low:.4g} to {high:.4g} mm; place it with --fit"
    sharp = ((seen >= far) & (seen <= near)).mean() if seen.size else 1.0
    if sharp < SHARP_SHARE:
        low, high = (round(float(z), 3) for z in (seen.min(), seen.max()))
        yield (
            f"note: {100.0 * (1.0 - sharp):.0f} % of what {where} sees, z = {low:.4g} to {high:.4g} mm, is outside the "
            f"display's depth range, z = {far:.4g} to {near:.4g} mm: fine detail there turns into noise; place "
            "the scene with --fit, --scale or --depth"
        )
    if settings.integrator == "lights" and not needs_chance(scene.mitsuba):
        return
    first, second = (
        np.minimum(render_view(scene, eye, window, replace(trial, seed=seed)).radiance, 1.0)
        for seed in (settings.seed, settings.seed ^ 1)
    )
    mean = 0.5 * float((first + second).mean())
    if mean > 0.0:
        noise = float(np.sqrt(0.5 * ((first - second) ** 2).mean())) / mean
        enough = math.ceil((noise / NOISE) ** 2)
        noise *= math.sqrt(1.0 / settings.samples)
        if engine == "fast":
            noise *= share_of_noise(settings.samples, colours_of(panel))
        if noise > NOISE:
            yield (
                f"note: with {settings.samples} sample{'s' if settings.samples > 1 else ''} the noise is "
                f"{100.0 * noise:.0f} % of the mean light; "
                f"--samples {enough} gives {100.0 * NOISE:.0f} %"
            )

"""Warns if parts of a scene are ignored, invisible or not sharp, or if a render is noisy."""

from __future__ import annotations

import logging
import math
from dataclasses import replace

import numpy as np

from lippmann.display.description import Display, Point3
from lippmann.errors import warn_user
from lippmann.optics.crosstalk_and_viewing_zone import viewing_distance
from lippmann.optics.display_properties import display_properties
from lippmann.optics.rays import Engine
from lippmann.rendering.lights import has_splats, needs_chance
from lippmann.rendering.options import Settings
from lippmann.rendering.pixel_filter import noise_fraction
from lippmann.rendering.renderer import make_integrator, render_view
from lippmann.rendering.sampling import Window, colours_of, first_depths
from lippmann.scenes.scene import Scene

logger = logging.getLogger("lippmann")
#: Warn of a scene's width outside this range, in panel widths.
SIZE_RANGE = (0.02, 1000.0)
#: Width of the trial view in pixels, each with one ray.
TRIAL_PX = 96
#: Warn if a smaller fraction of visible points is in the depth range.
MIN_SHARP = 0.1
#: Warn of more noise than this fraction of the mean light.
MAX_NOISE = 0.1


def warn_of_unused_parts(scene: Scene, settings: Settings) -> None:
    """Warn if parts of the scene are ignored, or if it has no light. Raises errors of `make_integrator`."""
    make_integrator(scene, settings)
    if settings.integrator != "scene":
        unused = []
        if scene.integrator not in (None, settings.integrator):
            unused.append(f"the file's integrator {scene.integrator} (integrator scene uses it)")
        media = sum(bool(shape.is_medium_transition()) for shape in scene.mitsuba.shapes())
        ignores_media = media > 0 and not settings.integrator.startswith("volpath")
        if ignores_media:
            unused.append(f"the media of {media} shapes (integrator volpath renders them)")
        # Many files name another integrator: that alone is reported only at level INFO.
        if ignores_media or (unused and logger.isEnabledFor(logging.INFO)):
            warn_user(f"{settings.integrator} ignores {' and '.join(unused)}")
    for line in scene.notes:
        logger.info("%s", line)
    if not scene.mitsuba.emitters() and not has_splats(scene.mitsuba):
        warn_user("the scene has no light, so the picture is black; add an <emitter> to the file")


def warn_of_view(scene: Scene, display: Display, settings: Settings, engine: Engine = "fast") -> None:
    """Render a trial view; warn of a scene of wrong size, position or depth, and of noise."""
    panel, width = display.panel, scene.width_mm
    if width > 0.0 and not SIZE_RANGE[0] <= width / panel.width_mm <= SIZE_RANGE[1]:
        warn_user(
            f"the scene is {width:.3g} mm wide, the panel {panel.width_mm:.4g} mm; "
            "if the scene's unit is not mm, give a scale, such as 1000 for metres"
        )
    height_px = max(1, min(TRIAL_PX, round(TRIAL_PX * panel.height_mm / panel.width_mm)))
    window = Window(panel.width_mm, panel.height_mm, TRIAL_PX, height_px)
    eye = 0.0, 0.0, viewing_distance(display)
    _warn_of_depths(scene, display, eye, window)
    if settings.integrator == "lights" and not needs_chance(scene.mitsuba):
        return
    trial = replace(settings, samples=1, shading="each", memory_mb=None)
    first, second = (
        np.minimum(render_view(scene, eye, window, replace(trial, seed=seed)).radiance, 1.0)
        for seed in (settings.seed, settings.seed ^ 1)
    )
    mean = 0.5 * float((first + second).mean())
    if mean > 0.0:
        noise = float(np.sqrt(0.5 * ((first - second) ** 2).mean())) / mean
        enough = math.ceil((noise / MAX_NOISE) ** 2)
        noise *= math.sqrt(1.0 / settings.samples)
        if engine == "fast":
            noise *= noise_fraction(settings.samples, colours_of(panel))
        if noise > MAX_NOISE:
            warn_user(
                f"with samples = {settings.samples} the noise is {100.0 * noise:.0f} % of the mean light; "
                f"{enough} samples give {100.0 * MAX_NOISE:.0f} %"
            )


def _warn_of_depths(scene: Scene, display: Display, eye: Point3, window: Window) -> None:
    depths = first_depths(scene, eye, window)
    depths = depths[np.isfinite(depths)]  # a ray that meets no surface has the depth -infinity
    far, near = display_properties(display).depth_range_mm
    where = f"an eye at {eye[2]:g} mm"
    if not depths.size and scene.width_mm > 0.0:
        low, high = scene.depth_range_mm
        warn_user(f"{where} sees none of the scene's surfaces, z = {low:.4g} to {high:.4g} mm; fit the scene")
    sharp = ((depths >= far) & (depths <= near)).mean() if depths.size else 1.0
    if sharp < MIN_SHARP:
        low, high = (round(float(z), 3) for z in (depths.min(), depths.max()))
        warn_user(
            f"{100.0 * (1.0 - sharp):.0f} % of what {where} sees, z = {low:.4g} to {high:.4g} mm, is outside the "
            f"display's depth range, z = {far:.4g} to {near:.4g} mm: fine detail there becomes noise; fit, scale or "
            "move the scene"
        )

"""Renders a scene, or a display with an image, as many eyes see it through one window."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from lippmann.base.images import Radiance
from lippmann.base.progress_protocol import Progress, report_each
from lippmann.display.description import Display, Point3
from lippmann.errors import InputError
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.eye.viewer_page import Direct
from lippmann.optics.crosstalk_and_viewing_zone import middle_eye, viewing_distance, zones
from lippmann.optics.display_properties import display_properties
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_view
from lippmann.rendering.sampling import Window
from lippmann.scenes.scene import Scene

#: Fraction of the viewing zone over which eyes spread; crosstalk begins at the zone's ends.
ZONE_SHARE = 0.95
#: Full angle of the eyes' cone for a display without a viewing zone, degrees.
CONE_DEG = 20.0
MAX_CONE_DEG = 120.0
#: Eyes across and down in the grid of direct renders.
GRID = (7, 3)
#: Width of a direct render, pixels.
WIDTH_PX = 400
#: Samples per pixel of a direct render.
SAMPLES = 16
#: Minimum half width of the grid of eyes, as a fraction of the viewing distance.
LEAST_REACH = 0.05
#: Function that returns the radiance that an eye sees.
Viewer = Callable[[Eye], Radiance]


def scene_viewer(scene: Scene, window: Window, settings: Settings) -> Viewer:
    """Return the `Viewer` of a scene without a display; a pupil blurs depths out of focus."""

    def view(eye: Eye) -> Radiance:
        return render_view(scene, eye.position_mm, window, settings, eye.pupil_mm, eye.focus_z_mm).radiance

    return view


def image_viewer(image: IntegralImage, window: Window, samples: int, seed: int = 0) -> Viewer:
    """Return the `Viewer` of the display that shows an image."""
    return lambda eye: observe(image.radiance, image.display, eye, window, samples, seed=seed).radiance


def eyes_of(
    display: Display, across: int, down: int = 1, cone_deg: float | None = None, distance_mm: float | None = None
) -> list[Point3]:
    """Return eye positions (mm) in equal steps at one distance, row by row from the bottom left.

    Rows and columns span a cone from the display's middle; the default is the viewing
    zone without crosstalk. The default distance is the viewing distance. Raises
    InputError for a cone or distance out of range.
    """
    distance = viewing_distance(display) if distance_mm is None else distance_mm
    if not 0.0 < distance < math.inf:
        raise InputError(f"the eyes' distance {distance:g} mm is not in front of the display; give a distance above 0")
    x, y, z = middle_eye(display, distance)
    if cone_deg is None:
        (zone,) = zones(display, [distance])
        narrow = math.tan(math.radians(0.5 * CONE_DEG)) * distance
        west, east, low, high = (-narrow, narrow, -narrow, narrow) if zone is None else zone
        reach_x = 0.5 * ZONE_SHARE * (east - west)
        reach_y = 0.5 * ZONE_SHARE * (high - low)
        x, y = (x, y) if zone is None else (0.5 * (west + east), 0.5 * (low + high))
    else:
        if not 0.0 <= cone_deg <= MAX_CONE_DEG:
            raise InputError(f"the cone of {cone_deg:g} degrees is out of range; give 0 to {MAX_CONE_DEG:g}")
        reach_x = reach_y = math.tan(math.radians(0.5 * cone_deg)) * distance
    rights = _space_evenly(-reach_x, reach_x, across)
    ups = _space_evenly(-reach_y, reach_y, down)
    return [(x + right, y + up, z) for up in ups for right in rights]


def focus_depths(scene_range_mm: Sequence[float], count: int) -> list[float]:
    """Return depths in equal steps from the scene's farthest to nearest depth."""
    far, near = scene_range_mm
    if not (math.isfinite(far) and math.isfinite(near)):
        raise InputError("the scene's depth range is infinite; give --depths")
    return _space_evenly(far, near, count)


def _space_evenly(first: float, last: float, count: int) -> list[float]:
    return [0.5 * (first + last)] if count == 1 else np.linspace(first, last, count).tolist()


def grid_of_eyes(display: Display) -> list[Point3]:
    """Return eye positions (mm) across the viewing zone, at the viewing distance."""
    share = max(display_properties(display).viewing_zone_mm / viewing_distance(display), LEAST_REACH)
    return eyes_of(display, *GRID, cone_deg=2.0 * math.degrees(math.atan(share)))


def render_directs(scene: Scene, display: Display, seed: int = 0, progress: Progress | None = None) -> list[Direct]:
    """Return direct renders of a scene from all eyes of `grid_of_eyes`."""
    view = scene_viewer(scene, whole_window(display, WIDTH_PX), Settings(samples=SAMPLES, seed=seed))
    return [Direct(eye, view(Eye(eye))) for eye in report_each(grid_of_eyes(display), progress)]

"""Direct renders of a scene for the page: from a grid of eyes, without a display."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lippmann.display.description import Display
from lippmann.eye.observer import whole_window
from lippmann.eye.page import Direct
from lippmann.optics.display_properties import display_properties
from lippmann.optics.zones import middle_eye, viewing_distance
from lippmann.rendering.renderer import Settings, render_view
from lippmann.scenes.scene import Scene

#: Eyes of the grid, across and down; the middle one is on the axis.
GRID = (7, 3)
#: Width of a render, pixels, and its samples.
WIDTH_PX = 400
SAMPLES = 16
#: Half width of the grid for a display without a viewing zone, as a share of the viewing distance.
LEAST_REACH = 0.05


def grid_of_eyes(display: Display) -> list[tuple[float, float, float]]:
    """Return eyes across the viewing zone, mm, at the viewing distance."""
    x, y, z = middle_eye(display, viewing_distance(display))
    reach = max(display_properties(display).viewing_zone_mm, LEAST_REACH * z)
    across, down = (np.linspace(-reach, reach, count).tolist() for count in GRID)
    return [(x + right, y + up, z) for up in down for right in across]


def render_directs(
    scene: Scene, display: Display, seed: int = 0, progress: Callable[[int, int], None] | None = None
) -> list[Direct]:
    """Render a scene from the grid's eyes."""
    window = whole_window(display, WIDTH_PX)
    eyes = grid_of_eyes(display)
    directs = []
    for k, eye in enumerate(eyes):
        directs.append(Direct(eye, render_view(scene, eye, window, Settings(samples=SAMPLES, seed=seed)).radiance))
        if progress is not None:
            progress(k + 1, len(eyes))
    return directs

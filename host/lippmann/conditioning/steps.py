"""Golden's intermediate values along a ray from the panel outward, to compare a design step by step."""

from __future__ import annotations

import numpy as np

from lippmann.conditioning.search import Floats
from lippmann.display import Display
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.system import System


def steps(display: Display, pixels: Floats, aims: Floats) -> dict[str, Floats]:
    """Return the intermediate values of rays from pixels (N, 2), px, to aims (N, 2), mm, by name.

    Returns
    -------
    dict
        `panel_mm` (N, 2), the pixel's point, panel frame; `home` (N, 2), the lenslet of the cell that contains it,
        integers; `start_mm` (N, 2), the same point from that lenslet's centre, array's axes; `near_mm` (N, 2), the
        point where the ray in air crosses the array's near plane (flat face or domes' vertices), from the same
        centre.
    """
    system = System.of(display)
    px, py = system.frame.panel_from_pixel(pixels[:, 0], pixels[:, 1])
    i, j, x, y = system.lattice.locate(NumpyBackend(), *system.frame.array_from_panel(px, py))
    start = np.stack([x, y], axis=1)
    near = start + system.gap_mm / system.aperture_distance_mm * (aims - start)
    home = np.stack([i, j], axis=1)
    return {"panel_mm": np.stack([px, py], axis=1), "home": home, "start_mm": start, "near_mm": near}

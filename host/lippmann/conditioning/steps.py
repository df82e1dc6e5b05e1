"""Golden's intermediate values on the way out, to compare a design step by step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lippmann.conditioning.search import Floats
from lippmann.display import Display
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.system import System


class Steps(NamedTuple):
    """N rays before the lenslet.

    panel_mm
        (N, 2) the pixel's point, panel frame.
    home
        (N, 2) the lenslet of the cell that contains it, integers.
    start_mm
        (N, 2) the same point from that lenslet's centre, array's axes.
    near_mm
        (N, 2) the point where the ray in air crosses the array's near plane (flat face or domes' vertices), likewise.
    """

    panel_mm: Floats
    home: Floats
    start_mm: Floats
    near_mm: Floats


def steps(display: Display, pixels: Floats, aperture: Floats | None) -> Steps:
    """Return the steps of rays from pixels (N, 2) to aperture points (N, 2), mm; None: chief rays."""
    system = System.of(display)
    px, py = system.frame.panel_from_pixel(pixels[:, 0], pixels[:, 1])
    i, j, x, y = system.lattice.locate(NumpyBackend(), *system.frame.array_from_panel(px, py))
    start = np.stack([x, y], axis=1)
    aim = np.zeros_like(start) if aperture is None else aperture
    near = start + system.gap_mm / system.aperture_distance_mm * (aim - start)
    return Steps(np.stack([px, py], axis=1), np.stack([i, j], axis=1), start, near)

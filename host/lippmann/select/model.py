"""`auto`: the cheapest model that is good enough for this display and this scene's depths.

A probe of pixels over the panel, corners and edges of cells included, is traced by every model and by `exact`. At the
scene's nearest and farthest depth the rays of model and `exact` lie some distance apart; the model is good enough
when that distance, for all of the probe, stays below a tolerance times the pixel of the reconstructed view at that
depth. That pixel is the lenslet pitch, or what a panel pixel spreads to at that depth where this is more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.display import Display, Grid
from lippmann.engines import trace
from lippmann.errors import InputError
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.panel import PanelFrame
from lippmann.optics.rays import MODELS, Model, Rays, gets_through

#: Default tolerance, pixels of the reconstructed view.
TOLERANCE = 0.25
#: Probed cells along each side of the panel, and points along each side of a cell.
PROBE_CELLS = 5
PROBE_POINTS = 9
#: How far the probe goes towards a cell's corners, where the models err most; on them the cell would be a neighbour's.
INSIDE = 1.0 - 1e-6
#: How far towards a cell's rim the probe aims, and at how many places along each side. Beyond, where the domes look at
#: the panel, some rays leave through the neighbour's dome however weak the lens: about 1 - RIM of all at most.
RIM, RIM_POINTS = 0.995, 4


@dataclass(frozen=True)
class Choice:
    """The model taken and each model's largest error over the probe, in pixels of the reconstructed view."""

    model: Model
    tolerance: float
    error_px: dict[Model, float]

    def __str__(self) -> str:
        """Say what was chosen and why, in one line."""
        errors = ", ".join(f"{model} {error:.2g}" for model, error in self.error_px.items())
        return (
            f"model {self.model}: the cheapest within {self.tolerance:g} pixel of the reconstructed view "
            f"(largest errors: {errors})"
        )


def reconstructed_pixel_mm(display: Display, z_mm: float) -> float:
    """Return the pixel of the reconstructed view at a depth, mm."""
    spread = abs(z_mm) * display.panel.pixel_pitch_mm / display.aperture_distance_mm
    return max(display.array.pitch_mm, spread)


def choose_model(
    display: Display,
    depth_range_mm: tuple[float, float],
    aperture: str = "chief",
    tolerance: float = TOLERANCE,
) -> Choice:
    """Choose the cheapest model within a tolerance.

    Parameters
    ----------
    display
        The display.
    depth_range_mm
        (far, near) z of the scene, mm.
    aperture
        "chief" or "full": which rays the renderer will send.
    tolerance
        Largest error allowed, in pixels of the reconstructed view.

    Raises
    ------
    InputError
        For a tolerance that is not positive and finite.
    """
    if not 0.0 < tolerance < math.inf:
        raise InputError(f"tolerance {tolerance:g} is not positive and finite; give pixels, such as {TOLERANCE}")
    pixels, points = probe(display, aperture)
    truth = trace(display, pixels, points, "exact")
    errors: dict[Model, float] = {}
    for model in MODELS[:-1]:
        rays = trace(display, pixels, points, model)
        errors[model] = model_error_px(display, truth, rays, depth_range_mm)
        if errors[model] <= tolerance:
            return Choice(model, tolerance, errors)
    errors["exact"] = 0.0
    return Choice("exact", tolerance, errors)


def probe(
    display: Display, aperture: str, inside: float = INSIDE
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64] | None]:
    """Return pixel coordinates (N, 2) and aperture points (N, 2) in mm, or None for chief rays.

    Cells are spread over the panel; in each stand points, those in its corners drawn in by the factor `inside`. All
    models see a cell alike wherever it stands, so a few cells do; several guard against a panel smaller than a cell at
    its border.
    """
    b = NumpyBackend()
    panel, array = display.panel, display.array
    lattice, frame = Lattice(array.grid, array.pitch_mm), PanelFrame.of(display)
    steps = np.linspace(0.05, 0.95, PROBE_CELLS)
    u, v = (g.ravel() for g in np.meshgrid(steps * panel.width_px, steps * panel.height_px))
    i, j, _, _ = lattice.locate(b, *frame.array_from_panel(*frame.panel_from_pixel(u, v)))
    cx, cy = lattice.centre(i, j)
    corners = inside * cell_corners(array.grid, array.pitch_mm)
    # Points over the cell's bounding square; those outside a hexagon belong to neighbours, which is as good.
    side = np.linspace(-0.49, 0.49, PROBE_POINTS) * array.pitch_mm
    local = np.concatenate([np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2), corners])
    x, y = (cx[:, None] + local[:, 0]).ravel(), (cy[:, None] + local[:, 1]).ravel()
    u, v = frame.pixel_from_panel(*frame.panel_from_array(x, y))
    on_panel = (u >= 0.0) & (u < panel.width_px) & (v >= 0.0) & (v < panel.height_px)
    pixels = np.stack([u, v], axis=1)[on_panel]
    if len(pixels) == 0:
        pixels = np.array([[0.5 * panel.width_px, 0.5 * panel.height_px]])
    if aperture == "chief":
        return pixels, None
    ends = RIM * cell_corners(array.grid, array.pitch_mm)
    along = np.linspace(0.0, 1.0, RIM_POINTS, endpoint=False)[:, None, None]
    rim = ends + along * (np.roll(ends, 1, axis=0) - ends)  # (places, sides, 2)
    aims = np.concatenate([[[0.0, 0.0]], rim.reshape(-1, 2)])
    return np.repeat(pixels, len(aims), axis=0), np.tile(aims, (len(pixels), 1))


def cell_corners(grid: Grid, pitch_mm: float) -> npt.NDArray[np.float64]:
    """Return the corners of a lenslet's cell in turn, (4, 2) or (6, 2) mm, from its centre."""
    if grid == "square":
        angles, radius = np.pi / 4 + np.pi / 2 * np.arange(4), pitch_mm / np.sqrt(2.0)
    else:
        angles, radius = np.pi / 6 + np.pi / 3 * np.arange(6), pitch_mm / np.sqrt(3.0)
    return np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)


def model_error_px(display: Display, truth: Rays, rays: Rays, depth_range_mm: tuple[float, float]) -> float:
    """Return the largest distance between two sets of rays over a depth range, in reconstructed pixels.

    Infinite when the models disagree on which rays there are.
    """
    there = gets_through(truth.status)
    if (there != gets_through(rays.status)).any() or (truth.lenslet != rays.lenslet)[there].any():
        return float("inf")
    if not there.any():
        return 0.0
    worst = 0.0
    far, near = depth_range_mm
    # Where a pixel begins to spread beyond the lenslet; between these depths the error has no other peak.
    kink = display.array.pitch_mm * display.aperture_distance_mm / display.panel.pixel_pitch_mm
    for z in (far, near, *(z for z in (-kink, kink) if far < z < near)):
        apart = np.linalg.norm(_at_depth(truth, z, there) - _at_depth(rays, z, there), axis=1)
        worst = max(worst, float(apart.max()) / reconstructed_pixel_mm(display, z))
    return worst


def _at_depth(rays: Rays, z_mm: float, there: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Return where those rays that are there cross a plane, from their lenslet's centre, (N, 2) mm."""
    crossings: npt.NDArray[np.float64] = crossing(rays.local_mm[there], rays.direction[there], z_mm)
    return crossings


def crossing(local_mm: Any, direction: Any, z_mm: float) -> Any:
    """Return where lines through points (N, 3) along directions (N, 3) cross a plane, (N, 2); arrays of any numbers."""
    t = (z_mm - local_mm[:, 2]) / direction[:, 2]
    return local_mm[:, :2] + t[:, None] * direction[:, :2]

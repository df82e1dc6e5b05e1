"""Chooses the cheapest lens model within a tolerance for a display and a scene's depths (`auto`).

The error of a model is the maximum distance between its rays and the rays of `exact`
over the scene's depths, in pixels of the reconstructed view. A pixel of that view is as
wide as a lenslet or, if wider, as a panel pixel's beam at the depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lippmann.display.description import Array, Display, Pair
from lippmann.errors import InputError, as_number
from lippmann.optics.backend import Arr, NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import MODELS, Floats, Model, Rays, gets_through
from lippmann.optics.system import System
from lippmann.optics.trace import trace_optics

#: Default tolerance, pixels of the reconstructed view.
TOLERANCE = 0.25
#: Tested cells along each side of the panel.
PROBE_CELLS = 5
#: Tested points along each side of a cell.
PROBE_POINTS = 9
#: Scale of the tested cell corners; at 1, rounding may move them into a neighbour.
INSIDE = 1.0 - 1e-6
#: Scale of the cell's rim at which rays aim, and number of aims along each side. Rays
#: nearer to the rim may leave through a neighbour's dome that faces the panel, even if
#: the lens is weak.
RIM, RIM_POINTS = 0.995, 4


@dataclass(frozen=True)
class Choice:
    """The chosen model, and each tested model's maximum error in pixels of the reconstructed view."""

    model: Model
    tolerance: float
    error_px: dict[Model, float]

    def __str__(self) -> str:
        errors = ", ".join(f"{model} {error:.2g}" for model, error in self.error_px.items())
        limit = f"{self.tolerance:g} pixel of the reconstructed view"
        return f"model {self.model}: the cheapest within {limit} (largest errors: {errors})"


def reconstructed_pixel_mm(display: Display, z_mm: float) -> float:
    """Return the shorter side of a pixel of the reconstructed view at a depth, mm."""
    spread = abs(z_mm) * min(display.panel.pitches_mm) / display.aperture_distance_mm
    return max(display.array.finest_mm, spread)


def check_tolerance(tolerance: object) -> None:
    """Refuse an error limit that is not a positive, finite number."""
    if not 0.0 < as_number(tolerance) < math.inf:
        raise InputError(f"tolerance {tolerance!r} is not positive and finite; give pixels, such as {TOLERANCE}")


def choose_model(
    display: Display, depth_range_mm: Pair, aperture: str = "chief", tolerance: float = TOLERANCE
) -> Choice:
    """Choose the cheapest model whose error is within a tolerance in reconstructed pixels.

    `depth_range_mm` has the scene's far and near z; `aperture` is "chief" or "full".
    Raises InputError for an invalid tolerance.
    """
    check_tolerance(tolerance)
    pixels, points = probe(display, aperture)
    truth = trace_optics(display, pixels, points, "exact")
    errors: dict[Model, float] = {}
    for model in MODELS[:-1]:
        rays = trace_optics(display, pixels, points, model)
        errors[model] = model_error_px(display, truth, rays, depth_range_mm)
        if errors[model] <= tolerance:
            return Choice(model, tolerance, errors)
    errors["exact"] = 0.0
    return Choice("exact", tolerance, errors)


def probe(display: Display, aperture: str, inside: float = INSIDE) -> tuple[Floats, Floats | None]:
    """Return test rays: pixel coordinates (N, 2), and aperture points (N, 2) in mm or None for chief rays.

    Rays start in a few cells only, because models treat all cells equally. `inside`
    scales the cells' corners, where rays start too.
    """
    array, size = display.array, panel_size(display)
    steps = np.linspace(0.05, 0.95, PROBE_CELLS)
    grid = np.stack(np.meshgrid(*np.outer(size, steps)), axis=-1)
    cells, _ = located(display, grid.reshape(-1, 2))
    corners = corners_mm(array)
    # Points fill a cell's bounding box; those outside a hexagon are in other cells.
    side, (px, py) = np.linspace(-0.49, 0.49, PROBE_POINTS), array.pitches_mm
    over = np.stack(Lattice.of(array).sheared(*np.meshgrid(side * px, side * py)), axis=-1).reshape(-1, 2)
    local = np.concatenate([over, inside * corners])
    owners, points = np.repeat(cells, len(local), axis=0), np.tile(local, (len(cells), 1))
    pixels = on_panel(display, pixels_from_cells(display, owners, points))
    if len(pixels) == 0:
        pixels = 0.5 * size[None]
    if aperture == "chief":
        return pixels, None
    ends = RIM * corners
    along = np.linspace(0.0, 1.0, RIM_POINTS, endpoint=False)[:, None, None]
    rim = ends + along * (np.roll(ends, 1, axis=0) - ends)  # shape (places, sides, 2)
    aims = np.concatenate([[[0.0, 0.0]], rim.reshape(-1, 2)])
    return np.repeat(pixels, len(aims), axis=0), np.tile(aims, (len(pixels), 1))


def panel_size(display: Display) -> Floats:
    """Return the panel's width and height, (2,) pixels."""
    return np.array(display.panel.size_px, np.float64)


def located(display: Display, pixels: Floats) -> tuple[Floats, Floats]:
    """Return the lenslets (N, 2) of pixels (N, 2), and their positions from the lenslets' centres, (N, 2) mm."""
    i, j, x, y = System.of(display).locate(NumpyBackend(), *pixels.T)
    return np.stack([i, j], axis=1), np.stack([x, y], axis=1)


def in_cells_mm(display: Display, pixels: Floats) -> Floats:
    """Return the points (N, 2) in cells at which the eye sees pixels (N, 2), mm from the cells' centres."""
    system, (lenslets, local) = System.of(display), located(display, pixels)
    cx, cy = system.lattice.centre(*lenslets.T)
    return np.stack(system.convergence.within_cell(local[:, 0], local[:, 1], cx, cy), axis=1)


def pixels_from_cells(display: Display, lenslets: npt.ArrayLike, local_mm: Floats) -> Floats:
    """Return the pixels (N, 2) that the eye sees at points (N, 2) of cells, mm from the cells' centres."""
    system = System.of(display)
    cx, cy = system.lattice.centre(*np.transpose(lenslets))
    x, y = system.convergence.on_panel(local_mm[:, 0], local_mm[:, 1], cx, cy)
    return np.stack(system.frame.pixel_from_panel(*system.frame.panel_from_array(cx + x, cy + y)), axis=1)


def on_panel(display: Display, pixels: Floats) -> Floats:
    """Return the pixel coordinates (N, 2) that are on the panel."""
    return pixels[((pixels >= 0.0) & (pixels < panel_size(display))).all(axis=1)]


def corners_mm(array: Array) -> Floats:
    """Return a cell's corners, counter-clockwise, (4, 2) or (6, 2) mm from its centre."""
    # Keep this rounding: docs/reference/stream.md quotes rays that depend on it.
    angles = np.radians([45, 135, 225, 315] if array.grid == "square" else [30, 90, 150, 210, 270, 330])
    x, y = (pitch / math.sqrt(2.0 if array.grid == "square" else 3.0) for pitch in array.pitches_mm)
    return np.stack(Lattice.of(array).sheared(x * np.cos(angles), y * np.sin(angles)), axis=1)


def model_error_px(display: Display, truth: Rays, rays: Rays, depth_range_mm: Pair) -> float:
    """Return the maximum distance of `rays` from `truth` over depths, in reconstructed pixels.

    The distance is infinite if a ray's status or lenslet differs.
    """
    passes = gets_through(truth.status)
    if (passes != gets_through(rays.status)).any() or (truth.lenslet != rays.lenslet)[passes].any():
        return math.inf
    if not passes.any():
        return 0.0
    some = slice(None) if passes.all() else passes  # a slice makes no copy
    lines = [(each.local_mm[some], each.direction[some]) for each in (truth, rays)]
    # Offset between the two rays at z = 0, and its change per millimetre of z.
    place = crossing(*lines[0], 0.0) - crossing(*lines[1], 0.0)
    slope = np.subtract(*(direction[:, :2] / direction[:, 2:] for _, direction in lines))
    worst = 0.0
    far, near = depth_range_mm
    # Beyond `kink`, view pixels are wider than lenslets; the maximum error is there or at an end.
    kink = display.array.finest_mm * display.aperture_distance_mm / min(display.panel.pitches_mm)
    for z in (far, near, *(z for z in (-kink, kink) if far < z < near)):
        apart = float(np.linalg.norm(place + z * slope, axis=1).max())
        worst = max(worst, apart / reconstructed_pixel_mm(display, z))
    return worst


def crossing(local_mm: Arr, direction: Arr, z_mm: float) -> Arr:
    """Return the points (N, 2) where lines with origins and directions (N, 3) cross the plane z_mm."""
    t = (z_mm - local_mm[:, 2]) / direction[:, 2]
    return local_mm[:, :2] + t[:, None] * direction[:, :2]

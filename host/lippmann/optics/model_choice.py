"""`auto`: the cheapest lens model within a tolerance, for this display and this scene's depths.

A probe of pixels over the panel, corners and edges of cells included, is traced by each model and by `exact`. The error
of a model is the largest distance between its rays and the exact ones over the scene's depths, in pixels of the
reconstructed view. Such a pixel is the lenslet pitch, or the spread of a panel pixel at that depth where this is more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real

import numpy as np
import numpy.typing as npt

from lippmann.display.description import Array, Display
from lippmann.errors import InputError
from lippmann.optics.backend import Arr, NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import MODELS, Floats, Model, Rays, gets_through
from lippmann.optics.system import System
from lippmann.optics.trace import trace_optics

#: Default tolerance, pixels of the reconstructed view.
TOLERANCE = 0.25
#: Probed cells along each side of the panel, and points along each side of a cell.
PROBE_CELLS = 5
PROBE_POINTS = 9
#: The probe's points in a cell's corners, where the models err most: on the corner itself a neighbour may own them.
INSIDE = 1.0 - 1e-6
#: The probe's aims on a cell's rim, and their number along each side. Beyond RIM, where the domes face the panel, some
#: rays leave through the neighbour's dome however weak the lens is: at most about 1 - RIM of all.
RIM, RIM_POINTS = 0.995, 4


@dataclass(frozen=True)
class Choice:
    """The chosen model, and the largest error of each model tried, in pixels of the reconstructed view."""

    model: Model
    tolerance: float
    error_px: dict[Model, float]

    def __str__(self) -> str:
        """Return the choice and its reason in one line."""
        errors = ", ".join(f"{model} {error:.2g}" for model, error in self.error_px.items())
        return (
            f"model {self.model}: the cheapest within {self.tolerance:g} pixel of the reconstructed view "
            f"(largest errors: {errors})"
        )


def reconstructed_pixel_mm(display: Display, z_mm: float) -> float:
    """Return the pixel of the reconstructed view at a depth, mm: its shorter side, so that no error seems too small."""
    return max(display.array.finest_mm, abs(z_mm) * min(display.panel.pitches_mm) / display.aperture_distance_mm)


def choose_model(
    display: Display, depth_range_mm: tuple[float, float], aperture: str = "chief", tolerance: float = TOLERANCE
) -> Choice:
    """Choose the cheapest model within a tolerance, in pixels of the reconstructed view.

    `depth_range_mm` is (far, near) z of the scene; `aperture` ("chief" or "full") the rays that the renderer sends.
    Raises InputError for a tolerance that is not positive and finite.
    """
    if not (isinstance(tolerance, Real) and 0.0 < tolerance < math.inf):
        raise InputError(f"tolerance {tolerance!r} is not positive and finite; give pixels, such as {TOLERANCE}")
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
    """Return pixel coordinates (N, 2) and aperture points (N, 2) in mm, or None for chief rays.

    Cells are spread over the panel, and points over each cell; those in its corners are drawn in by the factor
    `inside`. All models see each cell alike, so a few cells are enough; several serve where a panel's border cuts one.
    """
    array, size = display.array, panel_size(display)
    steps = np.linspace(0.05, 0.95, PROBE_CELLS)
    cells, _ = located(display, np.stack(np.meshgrid(*np.outer(size, steps)), axis=-1).reshape(-1, 2))
    corners = corners_mm(array)
    # Points over the cell's bounding square; those outside a hexagon belong to neighbours, which does no harm.
    side, (px, py) = np.linspace(-0.49, 0.49, PROBE_POINTS), array.pitches_mm
    over = np.stack(Lattice.of(array).sheared(*np.meshgrid(side * px, side * py)), axis=-1).reshape(-1, 2)
    local = np.concatenate([over, inside * corners])
    everywhere = pixels_from_cells(display, np.repeat(cells, len(local), axis=0), np.tile(local, (len(cells), 1)))
    pixels = on_panel(display, everywhere)
    if len(pixels) == 0:
        pixels = 0.5 * size[None]
    if aperture == "chief":
        return pixels, None
    ends = RIM * corners
    along = np.linspace(0.0, 1.0, RIM_POINTS, endpoint=False)[:, None, None]
    rim = ends + along * (np.roll(ends, 1, axis=0) - ends)  # (places, sides, 2)
    aims = np.concatenate([[[0.0, 0.0]], rim.reshape(-1, 2)])
    return np.repeat(pixels, len(aims), axis=0), np.tile(aims, (len(pixels), 1))


def panel_size(display: Display) -> Floats:
    """Return the panel's width and height, (2,) pixels."""
    return np.array([display.panel.width_px, display.panel.height_px], np.float64)


def located(display: Display, pixels: Floats) -> tuple[Floats, Floats]:
    """Return the lenslets (N, 2) of pixel coordinates (N, 2), and the points measured from their centres, (N, 2) mm."""
    i, j, x, y = System.of(display).locate(NumpyBackend(), *pixels.T)
    return np.stack([i, j], axis=1), np.stack([x, y], axis=1)


def in_cells_mm(display: Display, pixels: Floats) -> Floats:
    """Return where the eye sees pixel coordinates (N, 2) in their lenslets' cells: (N, 2) mm from the centres."""
    system, (lenslets, local) = System.of(display), located(display, pixels)
    cx, cy = system.lattice.centre(*lenslets.T)
    return np.stack(system.convergence.within_cell(local[:, 0], local[:, 1], cx, cy), axis=1)


def pixels_from_cells(display: Display, lenslets: npt.ArrayLike, local_mm: Floats) -> Floats:
    """Return the pixel coordinates (N, 2) that points (N, 2) of the cells of lenslets, (N, 2) or (2,), show to the eye.

    The points are measured from the lenslets' centres, mm.
    """
    system = System.of(display)
    cx, cy = system.lattice.centre(*np.transpose(lenslets))
    x, y = system.convergence.on_panel(local_mm[:, 0], local_mm[:, 1], cx, cy)
    return np.stack(system.frame.pixel_from_panel(*system.frame.panel_from_array(cx + x, cy + y)), axis=1)


def on_panel(display: Display, pixels: Floats) -> Floats:
    """Return those of the pixel coordinates (N, 2) that lie on the panel."""
    return pixels[((pixels >= 0.0) & (pixels < panel_size(display))).all(axis=1)]


def corners_mm(array: Array) -> Floats:
    """Return the corners of a lenslet's cell, counter-clockwise, (4, 2) or (6, 2) mm, from its centre."""
    # Not `Lattice.corners`: the published sets of rays (docs/reference/stream.md) depend on the last bits of these.
    angles = np.radians([45, 135, 225, 315] if array.grid == "square" else [30, 90, 150, 210, 270, 330])
    x, y = (pitch / math.sqrt(2.0 if array.grid == "square" else 3.0) for pitch in array.pitches_mm)
    return np.stack(Lattice.of(array).sheared(x * np.cos(angles), y * np.sin(angles)), axis=1)


def model_error_px(display: Display, truth: Rays, rays: Rays, depth_range_mm: tuple[float, float]) -> float:
    """Return the largest distance between two sets of rays over a depth range, in reconstructed pixels.

    Infinite when they disagree on the rays that leave, or on a ray's lenslet.
    """
    there = gets_through(truth.status)
    if (there != gets_through(rays.status)).any() or (truth.lenslet != rays.lenslet)[there].any():
        return float("inf")
    if not there.any():
        return 0.0
    some = slice(None) if there.all() else there  # a slice copies nothing
    lines = [(each.local_mm[some], each.direction[some]) for each in (truth, rays)]
    # Where lines cross z = 0, and how much farther apart they are a millimetre on.
    place = crossing(*lines[0], 0.0) - crossing(*lines[1], 0.0)
    slope = np.subtract(*(direction[:, :2] / direction[:, 2:] for _, direction in lines))
    worst = 0.0
    far, near = depth_range_mm
    # From this depth on a pixel spreads beyond the lenslet; between these depths the error has no other peak.
    kink = display.array.finest_mm * display.aperture_distance_mm / min(display.panel.pitches_mm)
    for z in (far, near, *(z for z in (-kink, kink) if far < z < near)):
        apart = float(np.linalg.norm(place + z * slope, axis=1).max())
        worst = max(worst, apart / reconstructed_pixel_mm(display, z))
    return worst


def crossing(local_mm: Arr, direction: Arr, z_mm: float) -> Arr:
    """Return where lines through points (N, 3) along directions (N, 3) cross a plane, (N, 2); arrays of any numbers."""
    t = (z_mm - local_mm[:, 2]) / direction[:, 2]
    return local_mm[:, :2] + t[:, None] * direction[:, :2]

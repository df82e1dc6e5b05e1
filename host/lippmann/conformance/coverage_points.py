"""Count the rays of a set at each coverage point (a numerically hard case)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np
import numpy.typing as npt

from lippmann.conformance.ray_sets import Bools, PanelRays, cell_steps
from lippmann.display.description import MAX_SIDE_PX
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.model_choice import in_cells_mm
from lippmann.optics.rays import Floats, Status, gets_through

Arrays = Mapping[str, Floats]
#: Maximum cosine between ray and face normal: of a grazing ray, and near total reflection.
GRAZING, FLAT = 0.05, 1e-3
#: Maximum radius of a steep dome, minimum radius of a flat dome, in half diagonals of the cell.
STEEP, NEARLY_FLAT = 1.05, 100.0

#: Description of each coverage point, in the order of a ray's path.
POINTS = {
    # Panel and lattice.
    "pixel-on-an-edge": "A pixel's point lies on the edge of a cell, within rounding error.",
    "pixel-on-a-corner": "A pixel's point lies where three or four cells meet, within rounding error.",
    "tie": "A pixel's point lies exactly on an edge, so the tie rule decides.",
    "aperture-point-on-a-seam": "An aperture point lies on the edge of its cell, within rounding error.",
    "chief-ray": "A ray aims at its lenslet's centre.",
    "tiny-coordinate": "A nonzero coordinate is so small that its square underflows.",
    "turned-array": "The array's rows are parallel neither to the panel's rows nor to its columns.",
    "two-pitches": "The two pitches of the array differ.",
    "shear": "The array has a shear.",
    "far-offset": "The array's origin is at least a hundred pitches from the panel's centre.",
    "wide-panel": "The panel has the maximum width that a file may have.",
    "converged-eye": "The elemental images converge on an eye.",
    "eye-aside": "The eye is in front of no point of the panel.",
    "missing-lenslet": "A ray's lenslet lies beyond the array's end.",
    # Lens.
    "contact": "There is no gap between panel and array.",
    "gap-of-the-focal-length": "The panel lies in the focal plane, within 10^-5 of the focal length.",
    "steep-dome": "The domes are nearly hemispherical.",
    "flat-dome": "The domes are nearly flat.",
    "low-index": "The glass hardly refracts: its index is below 1.01.",
    "high-index": "The glass has an index above 2.",
    "grazing-launch": "A ray leaves the panel at less than 3 degrees to the panel.",
    "grazing-exit": "A ray leaves the last face at less than 3 degrees to the face.",
    "onset-of-total-reflection": "A ray leaves the last face at less than 0.06 degrees to the face.",
    "far-cell": "A ray leaves through a lenslet at least two steps from the pixel's lenslet.",
    # Status.
    "ok": "A ray leaves through its own lenslet.",
    "missed": "A ray meets no dome.",
    "internal-reflection": "A ray is totally reflected.",
    "blocked": "A dome, a wall or the array's end stops a ray.",
    "crosstalk": "A ray leaves through another lenslet.",
}
#: Coverage points that rays in fixed-point words cannot meet, with reasons.
BEYOND_WORDS = {
    "tiny-coordinate": "words are fixed-point numbers",
    "wide-panel": "registers are limited to 16383 pixels",
    "low-index": "registers are limited to an index from 1.16 to 2.2",
    "grazing-launch": "registers are limited to slopes up to 60 degrees",
}


def points_met(inputs: PanelRays, rays: Arrays) -> dict[str, Bools]:
    """Return masks (N,) of the rays at each coverage point; `rays` are the golden rays."""
    display, aims = inputs.display, inputs.aims
    array, panel = display.array, display.panel
    on_edge, on_corner = _border(inputs, in_cells_mm(display, inputs.pixels))
    cosine = _exit_cosine(inputs, rays)
    has = {status: rays["status"][:, 0] == int(status) for status in Status}
    steps = cell_steps(display, rays["lenslet"] - rays["home"])
    focal_mm, half_mm = array.focal_length_mm, array.half_diagonal_mm
    axis_x, axis_y = display.viewing_axis_mm
    met: dict[str, npt.ArrayLike] = {
        "pixel-on-an-edge": on_edge,
        "pixel-on-a-corner": on_corner,
        "tie": tied(inputs),
        "aperture-point-on-a-seam": _border(inputs, aims)[0] & aims.any(axis=1),
        "chief-ray": ~aims.any(axis=1),
        "tiny-coordinate": _tiny(inputs.pixels) | _tiny(aims),
        "turned-array": array.rotation_deg % 90.0 != 0.0,
        "two-pitches": len(set(array.pitches_mm)) == 2,
        "shear": array.shear != 0.0,
        "far-offset": math.hypot(*array.offset_mm) >= 100.0 * array.finest_mm,
        "wide-panel": panel.width_px == MAX_SIDE_PX,
        "converged-eye": display.viewing_distance_mm is not None,
        "eye-aside": display.viewing_distance_mm is not None
        and (2.0 * abs(axis_x) > panel.width_mm or 2.0 * abs(axis_y) > panel.height_mm),
        "missing-lenslet": ~Lattice.of(array).present(NumpyBackend(), *rays["home"].T) & has[Status.BLOCKED],
        "contact": display.gap_mm == 0.0,
        "gap-of-the-focal-length": abs(display.aperture_distance_mm - focal_mm) < 1e-5 * focal_mm,
        "steep-dome": array.radius_mm < STEEP * half_mm,
        "flat-dome": array.radius_mm > NEARLY_FLAT * half_mm,
        "low-index": array.index < 1.01,
        "high-index": array.index > 2.0,
        "grazing-launch": GRAZING * np.hypot(*(aims - rays["start_mm"]).T) > display.aperture_distance_mm,
        "grazing-exit": cosine < GRAZING,
        "onset-of-total-reflection": cosine < FLAT,
        "far-cell": (steps >= 2.0) & has[Status.CROSSTALK],
        **{status.name.lower().replace("_", "-"): rays_of_status for status, rays_of_status in has.items()},
    }
    return {name: np.broadcast_to(np.asarray(met[name], bool), len(rays["status"])) for name in POINTS}


def covered(inputs: PanelRays, rays: Arrays) -> dict[str, int]:
    """Count the rays at each coverage point."""
    return {name: int(np.count_nonzero(which)) for name, which in points_met(inputs, rays).items()}


def summary(sets: Iterable[Mapping[str, int]], words: bool = False) -> tuple[dict[str, int], str]:
    """Return the number of rays at each coverage point, and a summary line.

    If `words` is true, the points `BEYOND_WORDS` are omitted.
    """
    totals = sum(map(Counter, sets), Counter[str]())
    counts = {name: totals[name] for name in POINTS if not (words and name in BEYOND_WORDS)}
    missing = [name for name, rays in counts.items() if not rays]
    line = f"coverage: {len(counts) - len(missing)} of {len(counts)} points met"
    return counts, line + (f"; not {', '.join(missing)}" if missing else "")


def tied_sides(inputs: PanelRays) -> tuple[Bools, ...]:
    """Return masks (N,) of pixels exactly on a cell's left side and, on a square grid, lower side."""
    array = inputs.display.array
    x, y = in_cells_mm(inputs.display, inputs.pixels).T
    left_side = x - array.shear * y == -0.5 * array.pitches_mm[0]
    lower_side = y == -0.5 * array.pitches_mm[1]
    return (left_side, lower_side) if array.grid == "square" else (left_side,)


def tied(inputs: PanelRays) -> Bools:
    """Return a mask (N,) of pixels exactly on a cell's side (`tied_sides`)."""
    return np.asarray(np.any(tied_sides(inputs), axis=0))


def _border(inputs: PanelRays, points: Floats) -> tuple[Bools, Bools]:
    array, panel = inputs.display.array, inputs.display.panel
    lattice = Lattice.of(array)
    roundings = 8.0 * np.spacing(np.abs(inputs.pixels).max() * panel.coarsest_mm + array.coarsest_mm)
    _, _, x, y = lattice.locate(NumpyBackend(), *points.T)
    across = np.abs(np.array(lattice.axes) @ np.stack([x, y]))
    sides = (np.abs(across - lattice.half_mm) <= roundings).sum(axis=0)
    return sides >= 1, sides >= 2


def _tiny(coordinates: Floats) -> Bools:
    return np.asarray(((coordinates != 0.0) & (np.abs(coordinates) < 1e-154)).any(axis=1))


def _exit_cosine(inputs: PanelRays, rays: Arrays) -> Floats:
    array = inputs.display.array
    normal = np.tile([0.0, 0.0, 1.0], (len(rays["status"]), 1))
    if array.plano_side == "panel":
        normal = (rays["local_mm"] + (0.0, 0.0, array.radius_mm)) / array.radius_mm
    through = gets_through(rays["status"][:, 0])
    return np.where(through, (normal * rays["direction"]).sum(axis=1), 1.0)

"""Which hard cases rays contain: coverage points, each a name, a meaning and a predicate on golden's rays.

`regress` tells which points the judged rays meet, so that a set that misses one is seen.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lippmann.conformance.ray_sets import Bools, PanelRays, cell_steps
from lippmann.display.description import MAX_SIDE_PX, Display
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.model_choice import in_cells_mm
from lippmann.optics.rays import Floats, Status

Arrays = Mapping[str, Floats]
#: Units in the last place within which a point is on an edge.
ULPS = 8.0
#: Cosines below which a ray grazes a face; very flatly.
GRAZING, FLAT = 0.05, 1e-3
#: Radii in half diagonals: of steep domes, at most, and of flat ones, at least.
STEEP, NEARLY_FLAT = 1.05, 100.0
#: A coordinate, mm or pixels, whose square underflows.
TINY = 1e-154


@dataclass(frozen=True)
class Point:
    """A coverage point: its meaning, and the predicate that tells which rays meet it.

    The predicate gets the rays' inputs and golden's arrays by name. It returns (N,), or one answer for all rays.
    """

    meaning: str
    predicate: Callable[[PanelRays, Arrays], npt.ArrayLike]

    def __call__(self, inputs: PanelRays, rays: Arrays) -> Bools:
        """Tell which rays meet the point, (N,)."""
        return np.broadcast_to(np.asarray(self.predicate(inputs, rays), bool), len(rays["status"]))


#: The points by name, in the order of the ray.
POINTS = {
    # Panel and lattice.
    "pixel-on-an-edge": Point(
        "A pixel's point on the edge of a cell, within roundings.",
        lambda inputs, rays: _border(inputs, _in_cells(inputs))[0],
    ),
    "pixel-on-a-corner": Point(
        "A pixel's point where three or four cells meet, within roundings.",
        lambda inputs, rays: _border(inputs, _in_cells(inputs))[1],
    ),
    "tie": Point(
        "A pixel's point exactly on an edge, so that the tie rule decides.",
        lambda inputs, rays: tied(inputs),
    ),
    "aperture-point-on-a-seam": Point(
        "An aperture point on the edge of its cell, within roundings.",
        lambda inputs, rays: _border(inputs, inputs.aims)[0] & inputs.aims.any(axis=1),
    ),
    "chief-ray": Point("A ray to the lenslet's centre.", lambda inputs, rays: ~inputs.aims.any(axis=1)),
    "tiny-coordinate": Point(
        "A coordinate, not 0, whose square underflows.",
        lambda inputs, rays: _tiny(inputs.pixels) | _tiny(inputs.aims),
    ),
    "turned-array": Point(
        "Rows that are along neither the panel's rows nor its columns.",
        lambda inputs, rays: inputs.display.array.rotation_deg % 90.0 != 0.0,
    ),
    "two-pitches": Point(
        "Two pitches that differ.",
        lambda inputs, rays: len(set(inputs.display.array.pitches_mm)) == 2,
    ),
    "shear": Point("A shear.", lambda inputs, rays: inputs.display.array.shear != 0.0),
    "far-offset": Point(
        "An array whose origin is a hundred pitches and more from the panel's centre.",
        lambda inputs, rays: math.hypot(*inputs.display.array.offset_mm) >= 100.0 * inputs.display.array.finest_mm,
    ),
    "wide-panel": Point(
        "A panel of the most pixels that a file may have.",
        lambda inputs, rays: inputs.display.panel.width_px == MAX_SIDE_PX,
    ),
    "converged-eye": Point(
        "Elemental images that converge on an eye.",
        lambda inputs, rays: inputs.display.viewing_distance_mm is not None,
    ),
    "eye-aside": Point(
        "An eye that is in front of no point of the panel.",
        lambda inputs, rays: _eye_aside(inputs.display),
    ),
    "missing-lenslet": Point(
        "A ray whose lenslet lies beyond the array's end.",
        lambda inputs, rays: _beyond_end(inputs.display, rays) & _has(rays, Status.BLOCKED),
    ),
    # Lens.
    "contact": Point("No gap between panel and array.", lambda inputs, rays: inputs.display.gap_mm == 0.0),
    "gap-of-the-focal-length": Point(
        "A panel in the focal plane, within 10^-5 of the focal length.",
        lambda inputs, rays: _in_focus(inputs.display),
    ),
    "steep-dome": Point(
        "A nearly hemispherical dome.",
        lambda inputs, rays: inputs.display.array.radius_mm < STEEP * inputs.display.array.half_diagonal_mm,
    ),
    "flat-dome": Point(
        "A nearly flat dome.",
        lambda inputs, rays: inputs.display.array.radius_mm > NEARLY_FLAT * inputs.display.array.half_diagonal_mm,
    ),
    "low-index": Point(
        "Glass that hardly refracts: an index below 1.01.",
        lambda inputs, rays: inputs.display.array.index < 1.01,
    ),
    "high-index": Point("Glass of an index above 2.", lambda inputs, rays: inputs.display.array.index > 2.0),
    "grazing-launch": Point(
        "A ray that leaves the panel within 3 degrees of it.",
        lambda inputs, rays: GRAZING * _aside_mm(inputs, rays) > inputs.display.aperture_distance_mm,
    ),
    "grazing-exit": Point(
        "A ray that leaves the last face within 3 degrees of it.",
        lambda inputs, rays: _exit_cosine(inputs, rays) < GRAZING,
    ),
    "onset-of-total-reflection": Point(
        "A ray that leaves the last face within 0.06 degrees of it.",
        lambda inputs, rays: _exit_cosine(inputs, rays) < FLAT,
    ),
    "far-cell": Point(
        "A ray that leaves through a lenslet two steps and more from the pixel's.",
        lambda inputs, rays: (
            (cell_steps(inputs.display, rays["lenslet"] - rays["home"]) >= 2.0) & _has(rays, Status.CROSSTALK)
        ),
    ),
    # Fate.
    "ok": Point("A ray that leaves through its own lenslet.", lambda inputs, rays: _has(rays, Status.OK)),
    "missed": Point("A ray that meets no dome.", lambda inputs, rays: _has(rays, Status.MISSED)),
    "internal-reflection": Point(
        "A ray that is totally reflected.",
        lambda inputs, rays: _has(rays, Status.INTERNAL_REFLECTION),
    ),
    "blocked": Point(
        "A ray that a dome, a wall or the array's end stops.",
        lambda inputs, rays: _has(rays, Status.BLOCKED),
    ),
    "crosstalk": Point(
        "A ray that leaves through another lenslet.",
        lambda inputs, rays: _has(rays, Status.CROSSTALK),
    ),
}
#: Points that no ray in the RTL's words can meet, and why.
BEYOND_WORDS = {
    "tiny-coordinate": "words have a fixed point",
    "wide-panel": "the registers hold 16383 pixels",
    "low-index": "the registers hold an index of 1.16 to 2.2",
    "grazing-launch": "the registers hold slopes of up to 60 degrees",
}


def covered(inputs: PanelRays, rays: Arrays) -> dict[str, int]:
    """Return how many rays meet each point; `rays` are golden's, by the names of a file's arrays."""
    return {name: int(np.count_nonzero(point(inputs, rays))) for name, point in POINTS.items()}


def summary(sets: Iterable[Mapping[str, int]], words: bool = False) -> tuple[dict[str, int], str]:
    """Return the rays of several sets that meet each point, and a line that names the points that none meets.

    Of rays in `words` without the points beyond them.
    """
    totals = Counter[str]()
    for one in sets:
        totals.update(one)
    counts = {name: totals[name] for name in POINTS if not (words and name in BEYOND_WORDS)}
    missing = [name for name, rays in counts.items() if not rays]
    line = f"coverage: {len(counts) - len(missing)} of {len(counts)} points met"
    return counts, line + (f"; not {', '.join(missing)}" if missing else "")


def tied_sides(inputs: PanelRays) -> tuple[Bools, ...]:
    """Return which pixels' points (N,) lie exactly on each side of a cell that has two owners, left and lower one."""
    array = inputs.display.array
    x, y = _in_cells(inputs).T
    left_side = np.asarray(x - array.shear * y == -0.5 * array.pitches_mm[0])
    lower_side = np.asarray(y == -0.5 * array.pitches_mm[1])
    return (left_side, lower_side) if array.grid == "square" else (left_side,)


def tied(inputs: PanelRays) -> Bools:
    """Return which pixels' points (N,) lie exactly on a side of a cell that has two owners."""
    return np.asarray(np.any(tied_sides(inputs), axis=0))


def _in_cells(inputs: PanelRays) -> Floats:
    """Return the points (N, 2) that decide the pixels' lenslets, mm from their centres, as the eye sees them."""
    return in_cells_mm(inputs.display, inputs.pixels)


def _border(inputs: PanelRays, points: Floats) -> tuple[Bools, Bools]:
    """Tell which points, (N, 2) mm from a cell's centre, are on an edge of it within roundings, and on two."""
    array = inputs.display.array
    lattice = Lattice.of(array)
    x, y = points.T
    step = ULPS * np.spacing(np.abs(inputs.pixels).max() * max(inputs.display.panel.pitches_mm) + array.coarsest_mm)

    def cells_at(some: npt.NDArray[np.intp], sides: Iterable[tuple[int, int]]) -> npt.NDArray[np.complex128]:
        cells = [lattice.locate(NumpyBackend(), x[some] + dx * step, y[some] + dy * step)[:2] for dx, dy in sides]
        return np.stack([i + 1j * j for i, j in cells])

    # A cell that holds three points holds the triangle between them, too: these have the eight within.
    outer = cells_at(np.arange(len(x)), ((-3, -2), (3, -2), (0, 4)))
    near = np.flatnonzero((outer != outer[0]).any(axis=0))
    cells = np.ones(len(x), int)
    around = cells_at(near, ((-1, -1), (-1, 1), (1, -1), (1, 1), (0, 1), (0, -1), (1, 0), (-1, 0)))
    cells[near] += (np.diff(np.sort(around, axis=0), axis=0) != 0).sum(axis=0)
    return np.asarray(cells >= 2), np.asarray(cells >= 3)


def _tiny(coordinates: Floats) -> Bools:
    """Tell which points (N, 2) have a coordinate, not 0, whose square underflows."""
    return np.asarray(((coordinates != 0.0) & (np.abs(coordinates) < TINY)).any(axis=1))


def _in_focus(display: Display) -> bool:
    """Tell whether the panel is in the focal plane."""
    focal = display.array.focal_length_mm
    return abs(display.aperture_distance_mm - focal) < 1e-5 * focal


def _eye_aside(display: Display) -> bool:
    """Tell whether the eye is in front of no point of the panel."""
    panel, (x, y) = display.panel, display.viewing_axis_mm
    aside = abs(x) > 0.5 * panel.width_mm or abs(y) > 0.5 * panel.height_mm
    return display.viewing_distance_mm is not None and aside


def _beyond_end(display: Display, rays: Arrays) -> Bools:
    """Tell which rays start behind a lenslet beyond the array's end."""
    array = display.array
    width, height = array.extent_mm or (math.inf, math.inf)
    x, y = Lattice.of(array).centre(*rays["home"].T)
    return np.asarray((np.abs(x - array.shear * y) > 0.5 * width) | (np.abs(y) > 0.5 * height))


def _aside_mm(inputs: PanelRays, rays: Arrays) -> Floats:
    """Return how far aside of their starts rays aim, (N,)."""
    return np.asarray(np.hypot(*(inputs.aims - rays["start_mm"]).T))


def _exit_cosine(inputs: PanelRays, rays: Arrays) -> Floats:
    """Return the cosine of the exit ray to the normal of the last face, 1 for rays that are lost."""
    array = inputs.display.array
    normal = np.tile([0.0, 0.0, 1.0], (len(rays["status"]), 1))
    if array.plano_side == "panel":
        normal = (rays["local_mm"] + (0.0, 0.0, array.radius_mm)) / array.radius_mm
    through = _has(rays, Status.OK) | _has(rays, Status.CROSSTALK)
    return np.where(through, (normal * rays["direction"]).sum(axis=1), 1.0)


def _has(rays: Arrays, status: Status) -> Bools:
    """Tell which rays have a status, (N,)."""
    return np.asarray(rays["status"][:, 0] == int(status))

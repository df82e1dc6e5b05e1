"""Which hard cases rays contain: coverage points, each a name, a meaning and a predicate on golden's rays.

`regress` tells which points the judged rays meet, so that a set that misses one is seen.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import wraps

import numpy as np
import numpy.typing as npt

from lippmann.conformance.hard_cases import Out
from lippmann.conformance.ray_search import Bools, Floats, cell_steps
from lippmann.display.description import MAX_SIDE_PX
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.model_choice import in_cells_mm
from lippmann.optics.rays import Status

Arrays = Mapping[str, Floats]
Predicate = Callable[[Out, Arrays], Bools]
#: Units in the last place within which a point is on an edge.
ULPS = 8.0
#: Cosines below which a ray grazes a face; very flatly.
GRAZING, FLAT = 0.05, 1e-3
#: Radii in half diagonals: of steep domes, at most, and of flat ones, at least.
STEEP, NEARLY_FLAT = 1.05, 100.0
#: A coordinate, mm or pixels, whose square underflows.
TINY = 1e-154

#: The points by name, in the order of the ray; each docstring is the meaning.
POINTS: dict[str, Predicate] = {}
#: Points that no ray in the RTL's words can meet, and why.
BEYOND_WORDS = {
    "tiny-coordinate": "words have a fixed point",
    "wide-panel": "the registers hold 16383 pixels",
    "low-index": "the registers hold an index of 1.16 to 2.2",
    "grazing-launch": "the registers hold slopes of up to 60 degrees",
}


def _point(predicate: Predicate) -> Predicate:
    POINTS[predicate.__name__.replace("_", "-")] = predicate
    return predicate


def _display(predicate: Callable[[Out], bool]) -> Callable[[Out], bool]:
    """Register a point that is met by all rays of a display."""

    @wraps(predicate)
    def of_rays(given: Out, rays: Arrays) -> Bools:
        return np.full(len(rays["status"]), predicate(given))

    _point(of_rays)
    return predicate


def covered(given: Out, rays: Arrays) -> dict[str, int]:
    """Return how many rays meet each point; `rays` are golden's, by the names of a file's arrays."""
    return {name: int(np.count_nonzero(predicate(given, rays))) for name, predicate in POINTS.items()}


def summary(sets: Iterable[Mapping[str, int]], words: bool = False) -> tuple[dict[str, int], str]:
    """Return the rays of several sets that meet each point, and a line that names the points that none meets.

    Of rays in `words` without the points beyond them.
    """
    met = Counter[str]()
    for one in sets:
        met.update(one)
    every = {name: met[name] for name in POINTS if not (words and name in BEYOND_WORDS)}
    missing = [name for name, rays in every.items() if not rays]
    told = f"coverage: {len(every) - len(missing)} of {len(every)} points met"
    return every, told + (f"; not {', '.join(missing)}" if missing else "")


# ---- panel and lattice ----


def _border(given: Out, points: Floats) -> tuple[Bools, Bools]:
    """Tell which points, (N, 2) mm from a cell's centre, are on an edge of it within roundings, and on two."""
    array = given.display.array
    lattice = Lattice.of(array)
    x, y = points.T
    step = ULPS * np.spacing(np.abs(given.pixels).max() * max(given.display.panel.pitches_mm) + array.coarsest_mm)

    def cells_at(some: npt.NDArray[np.intp], sides: Iterable[tuple[int, int]]) -> npt.NDArray[np.complex128]:
        found = [lattice.locate(NumpyBackend(), x[some] + dx * step, y[some] + dy * step)[:2] for dx, dy in sides]
        return np.stack([i + 1j * j for i, j in found])

    # A cell that holds three points holds the triangle between them, too: these have the eight within.
    outer = cells_at(np.arange(len(x)), ((-3, -2), (3, -2), (0, 4)))
    near = np.flatnonzero((outer != outer[0]).any(axis=0))
    cells = np.ones(len(x), int)
    around = cells_at(near, ((-1, -1), (-1, 1), (1, -1), (1, 1), (0, 1), (0, -1), (1, 0), (-1, 0)))
    cells[near] += (np.diff(np.sort(around, axis=0), axis=0) != 0).sum(axis=0)
    return np.asarray(cells >= 2), np.asarray(cells >= 3)


def _local(given: Out) -> Floats:
    """Return the points (N, 2) that decide the pixels' lenslets, mm from their centres, as the eye sees them."""
    return in_cells_mm(given.display, given.pixels)


@_point
def pixel_on_an_edge(given: Out, rays: Arrays) -> Bools:
    """A pixel's point on the edge of a cell, within roundings."""
    del rays
    return _border(given, _local(given))[0]


@_point
def pixel_on_a_corner(given: Out, rays: Arrays) -> Bools:
    """A pixel's point where three or four cells meet, within roundings."""
    del rays
    return _border(given, _local(given))[1]


@_point
def tie(given: Out, rays: Arrays) -> Bools:
    """A pixel's point exactly on an edge, so that the tie rule decides."""
    del rays
    return np.asarray(np.any(tied_sides(given), axis=0))


def tied_sides(given: Out) -> tuple[Bools, ...]:
    """Return which pixels' points (N,) lie exactly on each side of a cell that has two owners, left and lower one."""
    array = given.display.array
    x, y = _local(given).T
    left = np.asarray(x - array.shear * y == -0.5 * array.pitches_mm[0])
    return (left, np.asarray(y == -0.5 * array.pitches_mm[1])) if array.grid == "square" else (left,)


@_point
def aperture_point_on_a_seam(given: Out, rays: Arrays) -> Bools:
    """An aperture point on the edge of its cell, within roundings."""
    del rays
    return _border(given, given.aims)[0] & given.aims.any(axis=1)


@_point
def chief_ray(given: Out, rays: Arrays) -> Bools:
    """A ray to the lenslet's centre."""
    del rays
    return np.asarray(~given.aims.any(axis=1))


@_point
def tiny_coordinate(given: Out, rays: Arrays) -> Bools:
    """A coordinate, not 0, whose square underflows."""
    del rays
    small = np.concatenate([given.pixels, given.aims], axis=1)
    return np.asarray(((small != 0.0) & (np.abs(small) < TINY)).any(axis=1))


@_display
def turned_array(given: Out) -> bool:
    """Rows that are along neither the panel's rows nor its columns."""
    return given.display.array.rotation_deg % 90.0 != 0.0


@_display
def two_pitches(given: Out) -> bool:
    """Two pitches that differ."""
    px, py = given.display.array.pitches_mm
    return px != py


@_display
def shear(given: Out) -> bool:
    """A shear."""
    return given.display.array.shear != 0.0


@_display
def far_offset(given: Out) -> bool:
    """An array whose origin is a hundred pitches and more from the panel's centre."""
    return math.hypot(*given.display.array.offset_mm) >= 100.0 * given.display.array.finest_mm


@_display
def wide_panel(given: Out) -> bool:
    """A panel of the most pixels that a file may have."""
    return given.display.panel.width_px == MAX_SIDE_PX


@_display
def converged_eye(given: Out) -> bool:
    """Elemental images that converge on an eye."""
    return given.display.viewing_distance_mm is not None


@_display
def eye_aside(given: Out) -> bool:
    """An eye that is in front of no point of the panel."""
    panel, (x, y) = given.display.panel, given.display.viewing_axis_mm
    beside = abs(x) > 0.5 * panel.width_mm or abs(y) > 0.5 * panel.height_mm
    return given.display.viewing_distance_mm is not None and beside


@_point
def missing_lenslet(given: Out, rays: Arrays) -> Bools:
    """A ray whose lenslet lies beyond the array's end."""
    array = given.display.array
    if array.extent_mm is None:
        return np.zeros(len(rays["status"]), bool)
    width, height = array.extent_mm
    lattice = Lattice.of(array)
    x, y = lattice.centre(*rays["home"].T)
    beyond = (np.abs(x - array.shear * y) > 0.5 * width) | (np.abs(y) > 0.5 * height)
    return np.asarray(beyond & (rays["status"][:, 0] == int(Status.BLOCKED)))


# ---- lens ----


@_display
def contact(given: Out) -> bool:
    """No gap between panel and array."""
    return given.display.gap_mm == 0.0


@_display
def gap_of_the_focal_length(given: Out) -> bool:
    """A panel in the focal plane, within 10^-5 of the focal length."""
    focal = given.display.array.focal_length_mm
    return abs(given.display.aperture_distance_mm - focal) < 1e-5 * focal


@_display
def steep_dome(given: Out) -> bool:
    """A nearly hemispherical dome."""
    array = given.display.array
    return array.radius_mm < STEEP * array.half_diagonal_mm


@_display
def flat_dome(given: Out) -> bool:
    """A nearly flat dome."""
    array = given.display.array
    return array.radius_mm > NEARLY_FLAT * array.half_diagonal_mm


@_display
def low_index(given: Out) -> bool:
    """Glass that hardly refracts: an index below 1.01."""
    return given.display.array.index < 1.01


@_display
def high_index(given: Out) -> bool:
    """Glass of an index above 2."""
    return given.display.array.index > 2.0


@_point
def grazing_launch(given: Out, rays: Arrays) -> Bools:
    """A ray that leaves the panel within 3 degrees of it."""
    aside = np.hypot(*(given.aims - rays["start_mm"]).T)
    return np.asarray(given.display.aperture_distance_mm < GRAZING * aside)


def _exit_cosine(given: Out, rays: Arrays) -> Floats:
    """Return the cosine of the exit ray to the normal of the last face, 1 for rays that are lost."""
    array = given.display.array
    normal = np.tile([0.0, 0.0, 1.0], (len(rays["status"]), 1))
    if array.plano_side == "panel":
        normal = (rays["local_mm"] + (0.0, 0.0, array.radius_mm)) / array.radius_mm
    through = np.isin(rays["status"][:, 0], (int(Status.OK), int(Status.CROSSTALK)))
    return np.where(through, (normal * rays["direction"]).sum(axis=1), 1.0)


@_point
def grazing_exit(given: Out, rays: Arrays) -> Bools:
    """A ray that leaves the last face within 3 degrees of it."""
    return np.asarray(_exit_cosine(given, rays) < GRAZING)


@_point
def onset_of_total_reflection(given: Out, rays: Arrays) -> Bools:
    """A ray that leaves the last face within 0.06 degrees of it."""
    return np.asarray(_exit_cosine(given, rays) < FLAT)


@_point
def far_cell(given: Out, rays: Arrays) -> Bools:
    """A ray that leaves through a lenslet two steps and more from the pixel's."""
    steps = cell_steps(given.display, rays["lenslet"] - rays["home"])
    return np.asarray((steps >= 2.0) & (rays["status"][:, 0] == int(Status.CROSSTALK)))


def _with_status(status: Status, meaning: str) -> None:
    def of_rays(given: Out, rays: Arrays) -> Bools:
        del given
        return np.asarray(rays["status"][:, 0] == int(status))

    of_rays.__doc__ = meaning
    POINTS[status.name.lower().replace("_", "-")] = of_rays


for _status, _meaning in {
    Status.OK: "A ray that leaves through its own lenslet.",
    Status.MISSED: "A ray that meets no dome.",
    Status.INTERNAL_REFLECTION: "A ray that is totally reflected.",
    Status.BLOCKED: "A ray that a dome, a wall or the array's end stops.",
    Status.CROSSTALK: "A ray that leaves through another lenslet.",
}.items():
    _with_status(_status, _meaning)

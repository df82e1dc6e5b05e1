"""Where the errors of foreign rays are, and how large: over the panel, over the lenslet, and as histograms.

Only maxima and counts are kept, so that a stream of any length fits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from lippmann.conformance.hard_cases import Out
from lippmann.conformance.ray_search import Bools, Floats

Counts = npt.NDArray[np.int64]

#: Cells of a map, along each side.
CELLS = 48
#: A map over the lenslet reaches so many pitches to each side: a hexagon's corners lie within.
REACH = 0.6
#: Bins of a histogram: decades of the error, in units of the last place, and bins in one.
DECADES, PER_DECADE = (-12, 9), 4
#: Microradian and nanometre, of radians and mm.
SCALE = 1e6


@dataclass
class ErrorMap:
    """The errors of one array.

    `panel` and `lenslet` (CELLS, CELLS) are the largest error in each cell, in microradian or nm; -1 where there is no
    ray. Rows go down the panel, and up the lenslet. `counts` are the rays by their error in units of the last place:
    exact ones, then those in each bin of `edges()`, then larger ones. `worst` is the largest error, and `worst_units`
    the largest in units of the last place.
    """

    unit: str
    panel: Floats = field(default_factory=lambda: np.full((CELLS, CELLS), -1.0))
    lenslet: Floats = field(default_factory=lambda: np.full((CELLS, CELLS), -1.0))
    counts: Counts = field(default_factory=lambda: np.zeros(len(edges()) + 1, np.int64))
    worst: float = 0.0
    worst_units: float = 0.0

    @property
    def rays(self) -> int:
        """Rays counted."""
        return int(self.counts.sum())


def edges() -> Floats:
    """Return the edges of a histogram's bins, in units of the last place."""
    low, high = DECADES
    return np.asarray(10.0 ** np.linspace(low, high, (high - low) * PER_DECADE + 1))


class ErrorMaps:
    """The errors of all rays that were judged, by array."""

    def __init__(self) -> None:
        """Begin without rays."""
        self.maps: dict[str, ErrorMap] = {}

    def add(self, given: Out, apart: Mapping[str, Floats], units: Mapping[str, Floats], judged: Bools) -> None:
        """Count the rays that are judged.

        `apart` are their errors by array, (N,) radians or mm, and `units` (N,) the sizes of a unit of the last place.
        Errors that are not finite are left out.
        """
        panel = given.display.panel
        on_panel = given.pixels / np.array([panel.width_px, panel.height_px])
        on_lenslet = given.aims / (2.0 * REACH * given.display.array.coarsest_mm) + 0.5
        for name, far in apart.items():
            made = self.maps.setdefault(name, ErrorMap("microradian" if name == "direction" else "nm"))
            kept = judged & np.isfinite(far)
            error, steps = far[kept] * SCALE, far[kept] / units[name][kept]
            _largest(made.panel, on_panel[kept], error)
            _largest(made.lenslet, on_lenslet[kept], error)
            bins = np.where(steps > 0.0, np.searchsorted(edges(), steps, side="right").clip(1), 0)
            made.counts += np.bincount(bins, minlength=len(made.counts))
            made.worst = max(made.worst, float(error.max(initial=0.0)))
            made.worst_units = max(made.worst_units, float(steps.max(initial=0.0)))


def _largest(cells: Floats, places: Floats, errors: Floats) -> None:
    """Raise each cell of a map to the largest error of the places (N, 2) in it, 0 to 1; places outside are left out."""
    column, row = np.floor(places * CELLS).astype(np.int64).T
    inside = (column >= 0) & (column < CELLS) & (row >= 0) & (row < CELLS)
    np.maximum.at(cells, (row[inside], column[inside]), errors[inside])

"""Create the page of `lippmann regress`, with maximum errors and error histograms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lippmann.conformance.comparison import INTEGERS, compare, distance
from lippmann.conformance.coverage_points import summary
from lippmann.conformance.error_bounds import Bounds
from lippmann.conformance.judge import Verdict
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import COLOURS, Plot, finish_picture, make_axes
from lippmann.conformance.ray_sets import Bools, ForeignRays, PanelRays
from lippmann.conformance.tracer_faults import FIELDS, Arrays
from lippmann.fixed.conversion import rays_of_words, word_unit
from lippmann.fixed.words import Ints
from lippmann.optics.rays import Floats

#: Cells along each side of an error map.
CELLS = 48
#: Half width of a lenslet's error map, in pitches; a hexagon fits in the map.
REACH = 0.6


@dataclass
class ErrorMap:
    """Errors of one ray array, in microradian or nm.

    `panel` and `lenslet` (CELLS, CELLS) contain the maximum error in each cell, or -1
    in cells without rays. Row 0 is at the top of the panel, but at the bottom of the
    lenslet. `counts` contains the number of exact rays, of rays in each bin of
    `edges()`, and of rays above the bins.
    """

    unit: str
    panel: Floats = field(default_factory=lambda: np.full((CELLS, CELLS), -1.0))
    lenslet: Floats = field(default_factory=lambda: np.full((CELLS, CELLS), -1.0))
    counts: Ints = field(default_factory=lambda: np.zeros(len(edges()) + 1, np.int64))
    worst: float = 0.0
    worst_units: float = 0.0

    @property
    def rays(self) -> int:
        """Number of rays in the map."""
        return int(self.counts.sum())


def edges() -> Floats:
    """Return the edges of the error histogram's bins, in units of the last place."""
    return 10.0 ** np.linspace(-12, 9, 21 * 4 + 1)  # four bins per decade


class ErrorMaps(dict[str, ErrorMap]):
    """Error maps of all checked rays, keyed by array."""

    def add(self, foreign: ForeignRays, bounds: Bounds) -> None:
        """Add a ray set's errors, except of rays on an edge and rays with only a status.

        Also count errors in ulps of the word, or of the vector's largest component as
        float32.
        """
        inputs, fields = foreign.inputs, foreign.fields
        judged = np.ones(len(inputs.pixels), bool)
        if foreign.words is None:
            compared = compare(foreign, bounds, every=False)
            vectors = {name: array for name, array in compared.golden.items() if name in fields.keys() - INTEGERS}
            far = {name: compared.far(name, fields[name], compared.golden) for name in vectors}
            units = {n: np.spacing(np.abs(array).max(axis=1).astype(np.float32)) for n, array in vectors.items()}
            judged = ~compared.edge & ~compared.alone
        else:
            case, _ = foreign.words
            twin = rays_of_words(inputs.display, inputs.pixels, case.trace(), case.build.fraction_bits)
            unit = np.full(len(judged), word_unit(case.build.fraction_bits))
            units = {"local_mm": inputs.display.array.radius_mm * unit, "direction": unit}
            far = {name: distance(name, fields[name], getattr(twin, name)) for name in units}
        self.count(inputs, far, units, judged)

    def count(self, inputs: PanelRays, apart: Arrays, units: Arrays, judged: Bools) -> None:
        """Add the finite errors `apart` (N,), rad or mm, of the rays in mask `judged`; `units` are ulps."""
        on_panel = inputs.pixels / np.array(inputs.display.panel.size_px)
        on_lenslet = inputs.aims / (2.0 * REACH * inputs.display.array.coarsest_mm) + 0.5
        for name, far in apart.items():
            error_map = self.setdefault(name, ErrorMap("microradian" if name == "direction" else "nm"))
            counted = judged & np.isfinite(far)
            error, steps = far[counted] * 1e6, far[counted] / units[name][counted]
            _largest(error_map.panel, on_panel[counted], error)
            _largest(error_map.lenslet, on_lenslet[counted], error)
            bins = np.where(steps > 0.0, np.searchsorted(edges(), steps, side="right").clip(1), 0)
            error_map.counts += np.bincount(bins, minlength=len(error_map.counts))
            error_map.worst = float(error.max(initial=error_map.worst))
            error_map.worst_units = float(steps.max(initial=error_map.worst_units))


def _largest(cells: Floats, places: Floats, errors: Floats) -> None:
    column, row = np.floor(places * CELLS).astype(np.int64).T
    inside = (np.minimum(column, row) >= 0) & (np.maximum(column, row) < CELLS)
    np.maximum.at(cells, (row[inside], column[inside]), errors[inside])


def map_plot(maps: Mapping[str, ErrorMap]) -> Plot:
    """Draw maps of the maximum errors over panel and lenslet, with one row per array."""
    from matplotlib.colors import LogNorm

    picture, axes = make_axes(len(maps), 2)
    for row, (name, error_map) in zip(axes, maps.items(), strict=True):
        errors = np.concatenate([error_map.panel.ravel(), error_map.lenslet.ravel()])
        low = float(errors[errors > 0.0].min(initial=np.inf))
        high = float(errors.max(initial=0.0))
        # Limit the colour scale to six decades.
        low = max(low, 1e-6 * high)
        norm = LogNorm(low, max(high, 1.01 * low)) if high > 0.0 else None
        span = (-REACH, REACH, -REACH, REACH)
        views = (
            ("panel", error_map.panel, "upper", (0.0, 1.0, 1.0, 0.0), "width", "height"),
            ("lenslet", error_map.lenslet, "lower", span, "pitch", "pitch"),
        )
        for axis, (place, cells, origin, extent, across, up) in zip(row, views, strict=True):
            # An error of 0 has no logarithm; give its cell the lowest colour.
            visible = np.ma.masked_less(np.where((cells >= 0.0) & (cells < low), low if norm else 0.0, cells), 0.0)
            image = axis.imshow(visible, norm=norm, cmap="viridis", extent=extent, origin=origin)
            axis.set(title=f"{name} over the {place}", xlabel=f"fraction of {across}", ylabel=f"fraction of {up}")
            picture.colorbar(image, ax=axis, label=f"largest error, {error_map.unit}")
    return Plot("errors-map", finish_picture(picture))


def histogram_plot(maps: Mapping[str, ErrorMap], last_place: str) -> Plot:
    """Draw a histogram of each array's errors."""
    picture, axes = make_axes(1, 1, (8.0, 3.8))
    axis, ends = axes[0, 0], np.append(edges(), 10.0 * edges()[-1])
    used = np.flatnonzero(np.any([error_map.counts[1:] for error_map in maps.values()], axis=0))
    first, last = (used[0], used[-1]) if len(used) else (0, len(ends) - 2)
    for colour, (name, error_map) in zip(COLOURS, maps.items(), strict=False):
        label = f"{name}: {int(error_map.counts[0])} exact"
        axis.stairs(error_map.counts[first + 1 : last + 2], ends[first : last + 2], color=colour, label=label)
    axis.set(xscale="log", yscale="symlog", xlabel=f"error, units of the last place of {last_place}", ylabel="rays")
    axis.legend()
    return Plot("errors-histogram", finish_picture(picture))


def errors_page(
    origin: Mapping[str, str],
    verdicts: Sequence[tuple[str, Verdict]],
    maps: Mapping[str, ErrorMap],
    words: bool,
    ended: str | None = None,
) -> Page:
    """Return the page of verdicts and errors; `ended` is the error if the stream ended early."""
    last_place = "a word" if words else "a float32"
    maps = {name: maps[name] for name in FIELDS if name in maps}
    values = ("rays", "worst", "unit", "worst_units")
    arrays = [
        {"step": FIELDS[name][0], "array": name, **{key: getattr(error_map, key) for key in values}}
        for name, error_map in maps.items()
    ]
    columns = ("rays", "wrong", "first_wrong", "stage", "fault")
    sets = [{"set": name, **{key: getattr(one, key) for key in columns}} for name, one in verdicts]
    met, coverage = summary((one.covered for _, one in verdicts), words)
    context: dict[str, object] = {
        "arrays": arrays,
        "wrong": [one for one in sets if one["wrong"]],
        "rays": sum(one.rays for _, one in verdicts),
        "sets": len(sets),
        "covered": coverage,
        "ended": ended,
        "words": words,
        "last_place": last_place,
        "edge": sum(one.on_edge for _, one in verdicts),
    }
    points = [{"point": name, "rays": rays} for name, rays in met.items()]
    plots = [map_plot(maps), histogram_plot(maps, last_place)] if maps else []
    return Page("errors", origin, plots, {"errors-sets": sets, "errors-coverage": points}, context)

"""The page of `lippmann regress --report`: the errors of foreign rays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lippmann.conformance.coverage_points import summary
from lippmann.conformance.error_maps import REACH, ErrorMap, edges
from lippmann.conformance.lens_faults import FIELDS
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import COLOURS, Plot, finish_picture, make_axes

if TYPE_CHECKING:
    from lippmann.conformance.judge import Verdict

Maps = Mapping[str, ErrorMap]
#: The lowest colour of a map, as a share of the largest error.
SPAN = 1e-6


def map_plot(maps: Maps) -> Plot:
    """Draw the largest errors over the panel and over the lenslet, a row for each array."""
    from matplotlib.colors import LogNorm

    picture, axes = make_axes(len(maps), 2)
    for row, (name, made) in zip(axes, maps.items(), strict=True):
        seen = np.concatenate([made.panel.ravel(), made.lenslet.ravel()])
        low, high = (float(end(seen[seen > 0.0], initial=start)) for end, start in ((np.min, np.inf), (np.max, 0.0)))
        # Errors far below the largest are as good as none.
        low = max(low, SPAN * high)
        norm = LogNorm(low, max(high, 1.01 * low)) if high > 0.0 else None
        for axis, cells, where in zip(row, (made.panel, made.lenslet), ("panel", "lenslet"), strict=True):
            edge = 1.0 if where == "panel" else REACH
            # An exact cell has the lowest colour: a logarithm has no place for it.
            shown = np.ma.masked_less(np.where((cells >= 0.0) & (cells < low), low if norm else 0.0, cells), 0.0)
            extent = (0.0, edge, edge, 0.0) if where == "panel" else (-edge, edge, -edge, edge)
            image = axis.imshow(
                shown, norm=norm, cmap="viridis", extent=extent, origin="upper" if where == "panel" else "lower"
            )
            across, up = ("width", "height") if where == "panel" else ("pitch", "pitch")
            axis.set(title=f"{name} over the {where}", xlabel=f"shares of the {across}", ylabel=f"shares of the {up}")
            picture.colorbar(image, ax=axis, label=f"largest error, {made.unit}")
    return Plot("errors-map", finish_picture(picture))


def histogram_plot(maps: Maps, last_place: str) -> Plot:
    """Draw how many rays have which error."""
    picture, axes = make_axes(1, 1, (8.0, 3.8))
    axis, ends = axes[0, 0], np.append(edges(), 10.0 * edges()[-1])
    used = np.flatnonzero(np.any([made.counts[1:] for made in maps.values()], axis=0))
    first, last = (used[0], used[-1]) if len(used) else (0, len(ends) - 2)
    for colour, (name, made) in zip(COLOURS, maps.items(), strict=False):
        label = f"{name}: {int(made.counts[0])} exact"
        axis.stairs(made.counts[first + 1 : last + 2], ends[first : last + 2], color=colour, label=label)
    axis.set(xscale="log", yscale="symlog", xlabel=f"error, units of the last place of {last_place}", ylabel="rays")
    axis.legend()
    return Plot("errors-histogram", finish_picture(picture))


def errors_page(
    origin: Mapping[str, str],
    verdicts: Sequence[tuple[str, Verdict]],
    maps: Maps,
    words: bool,
    ended: str | None = None,
) -> Page:
    """Return the page of verdicts on sets of rays, and of the errors of all; `ended` says why there are no more."""
    last_place = "a word" if words else "a float32"
    maps = {name: maps[name] for name in FIELDS if name in maps}
    arrays = [
        {"step": FIELDS[name][0], "array": name, "rays": made.rays, "worst": made.worst, "unit": made.unit,
         "units": made.worst_units}
        for name, made in maps.items()
    ]  # fmt: skip
    sets = [
        {"set": name, "rays": one.rays, "wrong": one.wrong, "first_wrong": one.first_wrong, "stage": one.stage,
         "fault": one.fault}
        for name, one in verdicts
    ]  # fmt: skip
    met, told = summary((one.covered for _, one in verdicts), words)
    context: dict[str, Any] = {
        "arrays": arrays,
        "wrong": [one for one in sets if one["wrong"]],
        "rays": sum(one.rays for _, one in verdicts),
        "sets": len(sets),
        "covered": told,
        "ended": ended,
        "words": words,
        "last_place": last_place,
        "edge": sum(one.on_edge for _, one in verdicts),
    }
    points = [{"point": name, "rays": rays} for name, rays in met.items()]
    plots = [map_plot(maps), histogram_plot(maps, last_place)] if maps else []
    return Page("errors", origin, plots, {"errors-sets": sets, "errors-coverage": points}, context)

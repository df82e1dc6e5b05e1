"""The pages and plots of the reports about Lippmann itself."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from lippmann.conformance.figures import Figures, Row, Rows, Value, groups, values, where
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import COLOURS, MARKS, Plot, finish_picture, make_axes
from lippmann.fixed.build import DISPLAYS

from tools.renderer_speed import REFERENCE
from tools.report_builds import on_front

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TEMPLATES = Path(__file__).with_name("templates")
GRIDS = tuple(DISPLAYS)
#: Column and label over which a calibration's errors are drawn, by what is swept.
SWEPT = {
    "positions": ("value", "places of the camera"),
    "steps": ("photographs", "photographs from three places"),
    "noise": ("value", "noise, times the sensor's"),
}
#: Labels of the sizes over which growth is measured. The others are called as in the rows.
GROWTH = {"triangles": "primitives (triangles)", "samples": "samples a pixel"}


def row_of(row: Value) -> dict[str, Value]:
    """Return a dataclass as a table's row: its fields, then its properties."""
    properties = [name for name, value in vars(type(row)).items() if isinstance(value, property)]
    return {**dataclasses.asdict(row), **{name: getattr(row, name) for name in properties}}


def make_page(
    name: str,
    origin: Mapping[str, str],
    plots: Sequence[Plot] = (),
    tables: Mapping[str, Rows] | None = None,
    context: Row | None = None,
) -> Page:
    """Return a page of a template of the tools (see `lippmann.conformance.pages.Page`)."""
    return Page(name, origin, plots, tables or {}, context or {}, TEMPLATES)


def draw_bars(axis: Axes, labels: Sequence[str], lengths: Sequence[float], **options: Any) -> None:
    """Draw a horizontal bar for each label, the first on top."""
    place = np.arange(len(labels))
    axis.barh(place, lengths, **options)
    axis.set_yticks(place, labels, fontsize=8)
    axis.invert_yaxis()


def draw_lines(axis: Axes, rows: Rows, by: str, x: str, y: str) -> None:
    """Draw a line with marks for each value of the column `by`: y over x of its rows that have a value."""
    for mark, colour, group in zip(MARKS, COLOURS, groups(rows, by), strict=False):
        known = [row for row in group if row[y] is not None]
        if known:
            axis.plot(values(known, x), values(known, y), f"{mark}-", color=colour, label=group[0][by])
    axis.legend()


def draw_costs(data: Figures) -> Plot:
    """Draw cells and clock against error of the placed configurations."""
    picture, axes = make_axes(1, 2)
    for name, best in on_front(data).items():
        (row,) = where(data.rows, configuration=name)
        square = row["grid"] == "square"
        colour = COLOURS[GRIDS.index(row["grid"])]
        for axis, key in zip(axes[0], ("lut", "mhz"), strict=True):
            at = (row[key].median, row["max_mm"].median)
            axis.plot(*at, "o", color=colour, fillstyle="full" if best else "none")
            # The marks lie close together: names of square grids stand right of them, of hexagonal ones left.
            axis.annotate(
                name, at, xytext=(4 if square else -4, 4), textcoords="offset points",
                ha="left" if square else "right", color=colour, fontsize=7,
            )  # fmt: skip
    for axis, label in zip(axes[0], ("LUT", "clock, MHz = M rays/s"), strict=True):
        axis.set(yscale="log", xlabel=label, ylabel="largest error in the scene, mm")
        axis.margins(x=0.3, y=0.2)
    return Plot("report-rtl", finish_picture(picture))


def draw_word_lengths(data: Figures) -> Plot:
    """Draw the error of the exact pipeline's rays and pictures over its word length."""
    picture, axes = make_axes(1, 2)
    exact = where(data.rows, model="exact", rays="chief")
    rows = [row for row in exact if row["display"] == DISPLAYS[row["grid"]][0]]
    for axis, key in zip(axes[0], ("max_mm", "image_db"), strict=True):
        draw_lines(axis, sorted(rows, key=lambda row: int(row["fraction_bits"])), "grid", "fraction_bits", key)
    axes[0][0].set(yscale="log", xlabel="F, fraction bits", ylabel="largest error in the scene, mm")
    axes[0][1].set(xlabel="F, fraction bits", ylabel="integral image against golden, dB")
    return Plot("report-word-lengths", finish_picture(picture))


def draw_renderer(data: Figures) -> Plot:
    """Draw the render time against noise and against PSNR."""
    picture, axes = make_axes(1, 2)
    for axis, key in zip(axes[0], ("noise", "psnr_db"), strict=True):
        # A picture without random numbers has no noise, and no place on the logarithmic axis.
        draw_lines(axis, [row for row in data.rows if row[key].median > 0.0], "integrator", "seconds", key)
    axes[0][0].set(xscale="log", yscale="log", xlabel="seconds", ylabel="noise, levels of 255")
    axes[0][1].set(xscale="log", xlabel="seconds", ylabel=f"PSNR against {REFERENCE}, dB")
    return Plot("report-renderer", finish_picture(picture))


def draw_growth(data: Figures) -> Plot:
    """Draw render time over each size that was varied, and memory over pixels."""
    picture, axes = make_axes(2, 4, (3.2, 2.8))
    free = iter(axes.ravel())
    for rows in groups(data.rows, "with"):
        axis, name = next(free), str(rows[0]["with"])
        sizes, times = values(rows, "size"), np.array(values(rows, "seconds"))
        relative = np.array(sizes) / sizes[0]
        axis.plot(sizes, times, "o-", color=COLOURS[0])
        axis.plot(
            sizes, times[0] * (1.0 / relative if name == "threads" else relative), "--", color="grey", linewidth=1
        )
        middle = float(np.exp(np.log(times).mean()))
        # At least a decade, so that noise does not look like growth.
        limits = (min(0.7 * times.min(), middle / 3.2), max(1.4 * times.max(), middle * 3.2))
        axis.set(xscale="log", yscale="log", ylabel="seconds", ylim=limits)
        _mark_sizes(axis, sizes, GROWTH.get(name, name))
    memory = next(free)
    rows = [row for row in data.rows if row["memory_mb"] is not None]
    memory.plot(values(rows, "size"), values(rows, "memory_mb"), "s-", color=COLOURS[1])
    memory.set(xscale="log", ylabel="peak memory, MB", ylim=(0.0, None))
    _mark_sizes(memory, values(rows, "size"), "pixels")
    for axis in free:
        axis.remove()
    return Plot("report-growth", finish_picture(picture))


def _mark_sizes(axis: Axes, sizes: Sequence[float], label: str) -> None:
    """Put ticks at the measured sizes only."""
    axis.set_xlabel(label)
    axis.set_xticks(sizes, [size_label(size) for size in sizes], fontsize=8)
    axis.set_xticks([], minor=True)


def size_label(size: float) -> str:
    """Return a size in three digits and with a prefix: labels must not run into each other."""
    from matplotlib.ticker import EngFormatter

    return str(EngFormatter(sep="")(float(f"{size:.3g}")))


def draw_budget(data: Figures) -> Plot:
    """Draw each step's share of the RTL's error, a column for each configuration."""
    columns = groups(data.rows, "configuration")
    picture, axes = make_axes(2, len(columns), (3.4, 3.0))
    for across, rows in enumerate(columns):
        # The columns share their labels: steps without the grid.
        steps = [row["step"].removesuffix("_square").removesuffix("_hex") if across == 0 else "" for row in rows]
        colours = [*[COLOURS[0]] * (len(rows) - 1), COLOURS[6]]
        for axis, key, unit in zip(axes[:, across], ("rms_urad", "rms_nm"), ("microradian", "nm"), strict=True):
            draw_bars(axis, steps, values(rows, key), color=colours)
            axis.set(xlabel=f"rms, {unit}", title=rows[0]["configuration"])
    return Plot("report-budget", finish_picture(picture))


def draw_bar_charts(name: str, labels: Sequence[str], charts: Mapping[str, Sequence[float]], **options: Any) -> Plot:
    """Draw bar charts side by side, one for each heading, with the same labels; `options` are the axes'."""
    picture, axes = make_axes(1, len(charts), (5.2, 0.9 + 0.22 * len(labels)))
    for across, (heading, lengths) in enumerate(charts.items()):
        draw_bars(axes[0][across], labels if across == 0 else [""] * len(labels), lengths, color=COLOURS[0])
        axes[0][across].set(xlabel=heading, **options)
    return Plot(name, finish_picture(picture))


def draw_layers(rows: Rows) -> Plot:
    """Draw the eye's view of layers over their number and block RAM, for each scene, and that of the streamed frame."""
    scenes = groups(rows, "scene")
    picture, axes = make_axes(2, len(scenes), (4.4, 3.2))
    for across, scene in enumerate(scenes):
        for axis, key, label in zip(axes[:, across], ("layers", "block_rams"), ("layers", "block RAMs"), strict=True):
            cuts = [{**row, "line": f"{row['display']}, {row['drawn']}"} for row in scene if row["drawn"] != "streamed"]
            draw_lines(axis, cuts, "line", key, "view_db")
            for row, colour in zip(where(scene, drawn="streamed"), COLOURS[::2], strict=False):
                axis.axhline(row["view_db"], linestyle="--", color=colour, label=f"{row['display']}, streamed")
            axis.get_legend().remove()
            axis.set(xlabel=label, ylabel="the eye's view, dB", title=scene[0]["scene"])
    picture.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return Plot("layers", finish_picture(picture))


def draw_shading(rows: Rows) -> Plot:
    """Draw the error of ways to shade over their time, a picture for each number of lamps."""
    kinds = groups(rows, "lamps")
    picture, axes = make_axes(1, len(kinds), (3.4, 3.2))
    for axis, kind in zip(axes[0], kinds, strict=True):
        draw_lines(axis, kind, "way", "seconds", "panel_db")
        lamps = kind[0]["lamps"]
        axis.set(
            xlim=(0.0, None), xlabel="seconds", ylabel="panel, dB", title=f"{lamps} lamp{'s' if lamps > 1 else ''}"
        )
    return Plot("shading", finish_picture(picture))


def draw_calibration_sweep(rows: Rows) -> Plot:
    """Draw the errors of a calibration over the photographs, the positions and the noise, one picture for each."""
    solved = [row for row in rows if "refused" not in row]
    kinds = groups(solved, "over")
    picture, axes = make_axes(2, len(kinds), (3.6, 2.8))
    for across, kind in enumerate(kinds):
        for axis, key, label in zip(
            axes[:, across], ("rms_px", "gap_percent"), ("centres, px rms", "gap, %"), strict=True
        ):
            column, heading = SWEPT[kind[0]["over"]]
            draw_lines(axis, kind, "display", column, key)
            axis.set(xlabel=heading, ylabel=label, yscale="log", ylim=(0.5 * min(values(solved, key)), None))
    return Plot("calibration-sweep", finish_picture(picture))

"""The plots of the reports: colours and marks that differ without colour vision, PNG in memory."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lippmann.fixed.named_builds import DISPLAYS
from lippmann.measure.configurations import on_front
from lippmann.measure.figures import Figures, Row
from lippmann.measure.renderer import INTEGRATORS, REFERENCE
from lippmann.optics.rays import ENGINES, MODELS

#: Colours of Okabe and Ito, which all kinds of colour vision tell apart.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
MARKS = ("o", "s", "^", "x", "D", "v", "+")
DPI = 100
GRIDS = tuple(DISPLAYS)
#: Labels of the sizes over which growth is measured.
GROWTH = {
    "pixels": "pixels",
    "lenslets": "lenslets",
    "triangles": "primitives (triangles)",
    "lights": "lights",
    "threads": "threads",
    "samples": "samples a pixel",
}


@dataclass(frozen=True)
class Plot:
    """A picture: the name of its file without extension, and its PNG. The page's template describes it."""

    name: str
    png: bytes


def drawn(down: int, across: int, size: tuple[float, float] = (5.2, 3.8)) -> tuple[Any, Any]:
    """Return a picture and its axes, in rows of `across`, each of a size in inches."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    return plt.subplots(down, across, figsize=(size[0] * across, size[1] * down), squeeze=False, layout="constrained")


def finish(picture: Any) -> bytes:
    """Return the PNG of a picture, and close it."""
    from matplotlib import pyplot as plt

    for axis in picture.axes:
        axis.grid(alpha=0.3)
    buffer = io.BytesIO()
    picture.savefig(buffer, format="png", dpi=DPI)
    plt.close(picture)
    return buffer.getvalue()


def bars(axis: Any, labels: Sequence[str], lengths: Sequence[float], **options: Any) -> None:
    """Draw a horizontal bar for each label, the first on top."""
    place = np.arange(len(labels))
    axis.barh(place, lengths, **options)
    axis.set_yticks(place, labels, fontsize=8)
    axis.invert_yaxis()


def lines(axis: Any, curves: Mapping[str, Sequence[tuple[float, float | None]]]) -> None:
    """Draw a line with marks for each named curve, of its points that have a value."""
    for number, (name, points) in enumerate(curves.items()):
        known = [point for point in points if point[1] is not None]
        if known:
            axis.plot(*zip(*known, strict=True), f"{MARKS[number]}-", color=COLOURS[number], label=name)
    axis.legend()


def _median(row: Row, key: str) -> float | None:
    return None if row[key] is None else row[key].median


def engines(data: Figures) -> Plot:
    """Draw speed against error of every model and engine, on the first display of each grid."""
    kinds = (
        ("chief", "max_mm", "chief rays: largest error in the scene, mm", "log"),
        ("full", "max_mm", "full aperture: largest error in the scene, mm", "log"),
        ("chief", "view_db", "the eye's view, dB", "linear"),
    )
    shown = {row["grid"]: row["display"] for row in reversed(data.rows)}
    picture, axes = drawn(len(kinds), len(shown))
    for across, display in enumerate(reversed(shown.values())):
        for axis, (aperture, key, label, scale) in zip(axes[:, across], kinds, strict=True):
            for row in data.rows:
                if (row["display"], row["rays"]) == (display, aperture) and (value := _median(row, key)) is not None:
                    mark, colour = MARKS[ENGINES.index(row["engine"])], COLOURS[MODELS.index(row["model"])]
                    axis.plot(row["rays_per_second"].median, value, mark, color=colour)
            axis.set(xscale="log", yscale=scale, xlabel="rays/s", ylabel=label, title=display)
    for engine, mark in zip(ENGINES, MARKS, strict=False):
        axes[0][0].plot([], [], mark, color="grey", label=engine)
    for model, colour in zip(MODELS, COLOURS, strict=False):
        axes[0][0].plot([], [], "-", color=colour, label=model)
    axes[0][0].legend(fontsize=7, ncols=2)
    return Plot("report-engines", finish(picture))


def costs(data: Figures) -> Plot:
    """Draw cells and clock against error of the placed configurations."""
    front = on_front(data)
    picture, axes = drawn(1, 2)
    for row in data.rows:
        if row["mhz"] is None:
            continue
        square = row["grid"] == "square"
        colour, error = COLOURS[GRIDS.index(row["grid"])], row["max_mm"].median
        for axis, key in zip(axes[0], ("lut", "mhz"), strict=True):
            at = (row[key].median, error)
            axis.plot(*at, "o", color=colour, fillstyle="full" if front[row["configuration"]] else "none")
            # The marks lie close together: names of square grids stand right of them, of hexagonal ones left.
            axis.annotate(
                row["configuration"], at, xytext=(4 if square else -4, 4), textcoords="offset points",
                ha="left" if square else "right", color=colour, fontsize=7,
            )  # fmt: skip
    for axis, label in zip(axes[0], ("LUT", "clock, MHz = M rays/s"), strict=True):
        axis.set(yscale="log", xlabel=label, ylabel="largest error in the scene, mm")
        axis.margins(x=0.3, y=0.2)
    return Plot("report-rtl", finish(picture))


def word_lengths(data: Figures) -> Plot:
    """Draw the error of the exact pipeline's rays and pictures over its word length."""
    picture, axes = drawn(1, 2)
    for axis, key in zip(axes[0], ("max_mm", "image_db"), strict=True):
        curves: dict[str, Any] = {}
        for grid in GRIDS:
            kind = (grid, "exact", "chief", DISPLAYS[grid][0])
            rows = [r for r in data.rows if (r["grid"], r["model"], r["rays"], r["display"]) == kind]
            curves[grid] = sorted((int(row["fraction_bits"]), _median(row, key)) for row in rows)
        lines(axis, curves)
    axes[0][0].set(yscale="log", xlabel="F, fraction bits", ylabel="largest error in the scene, mm")
    axes[0][1].set(xlabel="F, fraction bits", ylabel="integral image against golden, dB")
    return Plot("report-word-lengths", finish(picture))


def renderer(data: Figures) -> Plot:
    """Draw the render time against noise and against PSNR."""
    picture, axes = drawn(1, 2)
    for axis, key in zip(axes[0], ("noise", "psnr_db"), strict=True):
        # A picture without random numbers has no noise, and no place on the logarithmic axis.
        rows = [row for row in data.rows if row[key].median > 0.0]
        lines(
            axis,
            {
                name: [(row["seconds"].median, row[key].median) for row in rows if row["integrator"] == name]
                for name in INTEGRATORS
            },
        )
    axes[0][0].set(xscale="log", yscale="log", xlabel="seconds", ylabel="noise, levels of 255")
    axes[0][1].set(xscale="log", xlabel="seconds", ylabel=f"PSNR against {REFERENCE}, dB")
    return Plot("report-renderer", finish(picture))


def growth(data: Figures) -> Plot:
    """Draw render time over each size that was varied, and memory over pixels."""
    picture, axes = drawn(2, 4, (3.2, 2.8))
    *timed, memory, spare = axes.ravel()
    spare.remove()
    for axis, (name, label) in zip(timed, GROWTH.items(), strict=True):
        rows = [row for row in data.rows if row["with"] == name]
        if not rows:  # threads, on a GPU
            axis.remove()
            continue
        sizes, times = ([float(row["size"]) for row in rows], [row["seconds"].median for row in rows])
        power = -1.0 if name == "threads" else 1.0
        axis.plot(sizes, times, "o-", color=COLOURS[0])
        axis.plot(sizes, [times[0] * (size / sizes[0]) ** power for size in sizes], "--", color="grey", linewidth=1)
        middle = float(np.exp(np.log(times).mean()))
        # At least a decade, so that noise does not look like growth.
        limits = (min(0.7 * min(times), middle / 3.2), max(1.4 * max(times), middle * 3.2))
        axis.set(xscale="log", yscale="log", ylabel="seconds", ylim=limits)
        _mark_sizes(axis, sizes, label)
    rows = [row for row in data.rows if row["memory_mb"] is not None]
    sizes = [float(row["size"]) for row in rows]
    memory.plot(sizes, [row["memory_mb"].median for row in rows], "s-", color=COLOURS[1])
    memory.set(xscale="log", ylabel="peak memory, MB", ylim=(0.0, None))
    _mark_sizes(memory, sizes, "pixels")
    return Plot("report-growth", finish(picture))


def _mark_sizes(axis: Any, sizes: Sequence[float], label: str) -> None:
    """Put ticks at the measured sizes only."""
    axis.set_xlabel(label)
    axis.set_xticks(sizes, [size_label(size) for size in sizes], fontsize=8)
    axis.set_xticks([], minor=True)


def size_label(size: float) -> str:
    """Return a size in three digits and with a prefix: labels must not run into each other."""
    from matplotlib.ticker import EngFormatter

    return str(EngFormatter(sep="")(float(f"{size:.3g}")))


def budget(data: Figures, name: str = "report-budget") -> Plot:
    """Draw each step's share of the RTL's error, a column for each configuration."""
    names = list(dict.fromkeys(str(row["configuration"]) for row in data.rows))
    picture, axes = drawn(2, len(names), (3.4, 3.0))
    for across, configuration in enumerate(names):
        rows = [row for row in data.rows if row["configuration"] == configuration]
        # The columns share their labels: steps without the grid.
        steps = [row["step"].removesuffix("_square").removesuffix("_hex") if across == 0 else "" for row in rows]
        colours = [*[COLOURS[0]] * (len(rows) - 1), COLOURS[6]]
        for axis, key, unit in zip(axes[:, across], ("rms_urad", "rms_nm"), ("microradian", "nm"), strict=True):
            bars(axis, steps, [row[key].median for row in rows], color=colours)
            axis.set(xlabel=f"rms, {unit}", title=configuration)
    return Plot(name, finish(picture))


def bar_charts(name: str, labels: Sequence[str], charts: Mapping[str, Sequence[float]], **options: Any) -> Plot:
    """Draw bar charts side by side, one for each heading, with the same labels; `options` are the axes'."""
    picture, axes = drawn(1, len(charts), (5.2, 0.9 + 0.22 * len(labels)))
    for across, (heading, lengths) in enumerate(charts.items()):
        bars(axes[0][across], labels if across == 0 else [""] * len(labels), lengths, color=COLOURS[0])
        axes[0][across].set(xlabel=heading, **options)
    return Plot(name, finish(picture))

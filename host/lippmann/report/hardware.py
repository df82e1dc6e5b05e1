"""Configurations of the RTL: what they cost on an FPGA, how fast they are, how far their rays and pictures are off."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from lippmann.display import Display
from lippmann.engines import trace_fixed
from lippmann.errors import input_error
from lippmann.fixed.build import Build
from lippmann.fixed.configurations import CONFIGURATIONS, DISPLAYS, Named
from lippmann.images import psnr_db
from lippmann.measure.rtl import Simulation, words_differ
from lippmann.rendering.sources import Aperture
from lippmann.report.engines import Sample, errors
from lippmann.report.figures import Figures, Measured, in_turn, read_csv
from lippmann.report.pareto import pareto_front
from lippmann.report.plan import Plan
from lippmann.report.plots import COLOURS, MARKS, drawn, finish
from lippmann.report.section import Plot, Section, Shown, column
from lippmann.report.views import Image, Stage
from lippmann.sim.tools import repository

#: What is simulated; the others would each take half a minute to compile.
SIMULATED = ("widest-square", "widest-hex", "compact-square", "compact-hex")
#: Figures of place-and-route that are shown, and by how much each counts as a cost: more of the clock costs less.
PLACED = {"lut": 1.0, "mult18x18d": 1.0, "dp16kd": 1.0, "ramw": 1.0, "mhz": -1.0}
#: Where they are kept (`make synth`).
SYNTHESIS = "docs/reports/synthesis.csv"
#: The shipped displays' grids.
GRIDS = tuple(DISPLAYS)


@dataclass(frozen=True)
class PlacedFigures:
    """Stored figures of place-and-route: where they come from, and those of `PLACED` of each configuration."""

    origin: dict[str, str]
    of: dict[str, dict[str, float]]


def placed() -> PlacedFigures:
    """Read the stored figures of place-and-route.

    Raises
    ------
    InputError
        When they are not there or lack a column.
    """
    path = repository() / SYNTHESIS
    origin, rows = read_csv(path)
    try:
        return PlacedFigures(origin, {row["configuration"]: {key: float(row[key]) for key in PLACED} for row in rows})
    except (KeyError, ValueError) as error:
        raise input_error(str(path), f"holds no figures of place-and-route ({error})", "run make synth") from None


def configurations(plan: Plan) -> list[Named]:
    """Return the configurations of a plan: named ones, and the exact ones of each word length that have no name."""
    named = [c for name, c in CONFIGURATIONS.items() if plan.named or name in SIMULATED]
    builds = {c.build for c in named}
    lengths = [Build(bits, grid) for grid in GRIDS for bits in plan.fraction_bits]
    return named + [Named(f"{b.grid}-{b.fraction_bits}", b) for b in lengths if b not in builds]


def aperture_of(build: Build) -> Aperture:
    """Return which rays a build traces."""
    return "full" if build.aims else "chief"


def measure(scenes: Path, plan: Plan, seed: int, sizes: PlacedFigures, log: Callable[[str], None]) -> Figures:
    """Measure the plan's configurations, each on the founding paper's display of its grid."""
    chosen = configurations(plan)
    log("configurations of the RTL: simulation ...")
    rates = _simulated([c for c in chosen if plan.simulate and c.name in SIMULATED], scenes, plan, seed)
    rows = []

    @cache
    def stage(display: Display) -> Stage:
        return Stage.of(scenes, display, plan.panel_px, seed)

    @cache
    def golden(display: Display, model: Any, aperture: Aperture) -> Image:
        return stage(display).integral(model, "golden", aperture=aperture)

    for named in chosen:
        log(f"configurations of the RTL: {named.name} ...")
        build, display = named.build, named.displays(scenes)[0]
        aperture = aperture_of(build)
        sample = Sample.of(display, aperture, plan.rays, seed)
        twin = trace_fixed(
            display,
            sample.pixels,
            sample.aperture,
            named.model,
            build.fraction_bits,
            max_cell_steps=build.max_cell_steps,
        )
        depths = stage(display).scene.depth_range_mm
        picture = stage(display).integral(named.model, "twin", build.fraction_bits, aperture)
        own, whole = (psnr_db(picture, golden(display, model, aperture)) for model in (named.model, "exact"))
        size = sizes.of.get(named.name)
        rows.append(
            {
                "configuration": named.name,
                "grid": build.grid,
                "model": build.model,
                "fraction_bits": build.fraction_bits,
                "rays": aperture,
                "display": display.name,
                **{key: None if size is None else Measured(size[key]) for key in PLACED},
                **rates.get(named.name, dict.fromkeys(("simulated_rays_per_second", "words_differ"))),
                **{key: Measured(value) for key, value in errors(sample.traced("exact"), twin, depths).items()},
                "image_db": Measured(own) if math.isfinite(own) else None,
                "exact_image_db": Measured(whole) if math.isfinite(whole) else None,
            }
        )
    return Figures("report-rtl", ("configuration", "grid", "model", "fraction_bits", "rays", "display"), rows)


def _simulated(chosen: Sequence[Named], scenes: Path, plan: Plan, seed: int) -> dict[str, dict[str, Measured | None]]:
    """Return rates of simulation, and the words in which simulation and twin differ."""
    runs = {
        c.name: Simulation.of(c.displays(scenes)[0], replace(c.build, cross_cells=True), seed, plan.timed_rays, c.model)
        for c in chosen
    }

    def rate(run: Simulation) -> Callable[[], float]:
        return lambda: plan.timed_rays / run.rtl()[1]

    rates = in_turn({name: rate(run) for name, run in runs.items()}, plan.rounds)
    return {
        name: {
            "simulated_rays_per_second": Measured.of(rates[name]),
            "words_differ": Measured(words_differ(run.rtl()[0], run.twin()[0])),
        }
        for name, run in runs.items()
    }


def on_front(data: Figures) -> dict[str, bool]:
    """Tell which of the placed configurations are on the Pareto front of those that trace the same rays.

    No other one of the same display and rays has as few or fewer of all cells, as fast or a faster clock and as small
    or a smaller error (the largest in the scene, against the exact model), and is better in one of them.
    """
    found: dict[str, bool] = {}
    rows = [row for row in data.rows if row["mhz"] is not None]
    for group in dict.fromkeys((row["display"], row["rays"]) for row in rows):
        some = [row for row in rows if (row["display"], row["rays"]) == group]
        costs = [[*(sign * row[key].median for key, sign in PLACED.items()), row["max_mm"].median] for row in some]
        found |= dict(zip((row["configuration"] for row in some), pareto_front(costs).tolist(), strict=True))
    return found


def section(data: Figures, origin: Mapping[str, str]) -> Section:
    """Return the section; `origin` is that of the figures of place-and-route."""
    front = on_front(data)
    rows = data.rows
    table = Shown(
        "Configurations of the RTL",
        {
            "configuration": column(rows, "configuration"),
            "model": column(rows, "model"),
            "F": column(rows, "fraction_bits"),
            "rays": column(rows, "rays"),
            "LUT": column(rows, "lut"),
            "multipliers": column(rows, "mult18x18d"),
            "memory blocks": column(rows, "dp16kd"),
            "RAMW": column(rows, "ramw"),
            "clock, MHz = M rays/s": column(rows, "mhz"),
            "simulated, M rays/s": column(rows, "simulated_rays_per_second", 1e6),
            "words unlike the twin's": column(rows, "words_differ"),
            "direction max, urad": column(rows, "max_urad"),
            "rms": column(rows, "rms_urad"),
            "exit max, nm": column(rows, "max_nm"),
            "exit rms": column(rows, "rms_nm"),
            "in the scene max, mm": column(rows, "max_mm"),
            "other fates": column(rows, "other_fates"),
            "image, dB": column(rows, "image_db"),
            "image against exact, dB": column(rows, "exact_image_db"),
            "Pareto front": ["front" if front.get(row["configuration"]) else None for row in rows],
        },
    )
    return Section(
        "Configurations of the RTL",
        (
            "Cells and clock are those of place-and-route, which takes minutes for each configuration: they are not "
            f"measured again but read from `{SYNTHESIS}` (machine: {origin.get('machine')}; date: "
            f"{origin.get('date')}; command: `{origin.get('command')}`; versions: {origin.get('versions')}). One ray "
            "leaves each clock, so the clock in MHz is the rate in M rays/s. A dash: not placed, or not simulated.",
            "Errors are the integer twin's against golden and the exact model, over random pixels of the founding "
            "paper's display of the grid; the RTL gives the twin's words, bit for bit, and where it was simulated all "
            "of them were compared. `image` is the PSNR of the fish's integral image, one ray a pixel from this "
            "configuration, against the same from golden's rays of the same model; `against exact` of the exact model. "
            "They too are rendered with the twin, which needs no compilation: `lippmann render --engine rtl "
            "--fraction-bits F` gives the same pixels.",
            "On the Pareto front are the placed configurations that no other for the same display and rays equals or "
            "beats in cells of every kind, clock and largest error in the scene.",
        ),
        (table,),
        (_plot_cost(data, front), _plot_lengths(data)),
        (data,),
    )


def _plot_cost(data: Figures, front: dict[str, bool]) -> Plot:
    picture, axes = drawn(1, 2)
    for row in data.rows:
        if row["mhz"] is None:
            continue
        colour, error = COLOURS[GRIDS.index(row["grid"])], row["max_mm"].median
        for axis, key in zip(axes[0], ("lut", "mhz"), strict=True):
            filled = "full" if front[row["configuration"]] else "none"
            axis.plot(row[key].median, error, "o", color=colour, fillstyle=filled)
            # Names of square grids right of their marks, of hexagonal ones left: the marks lie close together.
            square = row["grid"] == "square"
            axis.annotate(
                row["configuration"],
                (row[key].median, error),
                xytext=(4 if square else -4, 4),
                textcoords="offset points",
                ha="left" if square else "right",
                color=colour,
                fontsize=7,
            )
    for axis, label in zip(axes[0], ("LUT", "clock, MHz = M rays/s"), strict=True):
        axis.set(yscale="log", xlabel=label, ylabel="largest error in the scene, mm")
        axis.margins(x=0.3, y=0.2)
    return Plot(
        "report-rtl",
        finish(picture),
        "Cost and speed against error of the placed configurations; filled: on the Pareto front. Blue square grids, "
        "orange hexagonal ones.",
        "Two scatter plots of the placed configurations: the largest error in the scene over the number of LUT, and "
        "over the clock. The table below has the values.",
    )


def _plot_lengths(data: Figures) -> Plot:
    picture, axes = drawn(1, 2)
    for number, grid in enumerate(GRIDS):
        kind = (grid, "exact", "chief", DISPLAYS[grid][0])
        rows = [r for r in data.rows if (r["grid"], r["model"], r["rays"], r["display"]) == kind]
        rows.sort(key=lambda row: row["fraction_bits"])
        for axis, key in zip(axes[0], ("max_mm", "image_db"), strict=True):
            points = [(row["fraction_bits"], row[key].median) for row in rows if row[key] is not None]
            if points:
                axis.plot(*zip(*points, strict=True), f"{MARKS[number]}-", color=COLOURS[number], label=grid)
    axes[0][0].set(yscale="log", xlabel="F, fraction bits", ylabel="largest error in the scene, mm")
    axes[0][1].set(xlabel="F, fraction bits", ylabel="integral image against golden, dB")
    for axis in axes[0]:
        axis.legend()
    return Plot(
        "report-word-lengths",
        finish(picture),
        "The exact model's pipeline by its word length: error of its rays, and of the picture made with them.",
        "Two line plots over the number of fraction bits, a line for each grid: the largest error in the scene, and "
        "the PSNR of the integral image. The table below has the values.",
    )

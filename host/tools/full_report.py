"""Writes the report of speed and error to docs/generated/reports (`python -m tools.full_report`, `make report`)."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from lippmann.base.images import Radiance
from lippmann.base.tones import psnr_db
from lippmann.cli import run
from lippmann.cli.frame import make_command
from lippmann.cli.report import ReportOptions, write_report
from lippmann.conformance import engine_report
from lippmann.conformance.engine_report import Pictures, Section, errors, in_turn, logger, words_of_chief_rays
from lippmann.conformance.figures import Comparison, Figures, Measured, Stored, groups, read_csv, where
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import COLOURS, Plot, finish_picture, make_axes
from lippmann.display.description import Display
from lippmann.engines import trace_fixed
from lippmann.errors import input_error
from lippmann.fixed.build import Build
from lippmann.rendering.sampling import Aperture
from lippmann.simulation.harness import rtl_pipeline
from lippmann.simulation.toolchain import repository

from tools import renderer_speed, stage_errors
from tools.measured_page import SYNTHESIS
from tools.named_builds import CONFIGURATIONS, DISPLAYS, Named
from tools.report_plots import TEMPLATES, draw_lines

#: Names of the report's tables, in the order of its sections.
TABLES = ("report-engines", "report-rtl", "report-renderer", "report-growth", "report-budget")
#: Configurations that Verilator simulates; each further configuration would take half a minute to compile.
SIMULATED = ("widest-square", "widest-hex", "compact-square", "compact-hex")
#: Place-and-route figures in the file `SYNTHESIS`, each with its sign as a cost.
PLACED = {"lut": 1.0, "mult18x18d": 1.0, "dp16kd": 1.0, "ramw": 1.0, "mhz": -1.0}
#: Columns that together identify a row.
KEYS = ("configuration", "grid", "model", "fraction_bits", "rays", "display")


@dataclass(frozen=True)
class Plan(engine_report.Plan):
    """The sizes of a report's measurements."""

    #: Word lengths of exact pipelines; whether all named configurations are measured, or only those in `SIMULATED`.
    fraction_bits: tuple[int, ...] = tuple(range(14, 24))
    all_configurations: bool = True
    #: Renders that measure noise: picture width, samples per pixel, samples per pixel of the reference.
    noise_px: int = 320
    noise_samples: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64)
    reference_samples: int = 1024
    #: Configurations for which the error of each step is measured.
    budget: tuple[str, ...] = SIMULATED
    #: Panel width, px, of growth measurements (except growth with pixels); number of runs for each memory peak.
    growth_px: int = 800
    memory_rounds: int = 3
    #: Sizes in the growth measurements.
    pixels_across: tuple[int, ...] = (600, 1200, 2400, 4800)
    lenslets_across: tuple[int, ...] = (11, 26, 51, 102, 204)
    triangles: tuple[int, ...] = (200, 2_000, 20_000, 200_000, 2_000_000)
    lights: tuple[int, ...] = (1, 2, 4, 8, 16, 32)
    samples: tuple[int, ...] = (1, 2, 4, 8, 16, 32)


WHOLE = Plan()
#: The small plan for tests and for a quick run.
QUICK = Plan(
    **dataclasses.asdict(engine_report.QUICK),
    fraction_bits=(16, 23),
    all_configurations=False,
    noise_px=64,
    noise_samples=(1, 4),
    reference_samples=16,
    budget=("compact-square",),
    growth_px=150,
    pixels_across=(150, 300),
    lenslets_across=(4, 8),
    triangles=(200, 2_000),
    lights=(1, 2),
    samples=(1, 2),
)


def make_sections(scenes: Path, plan: Plan, seed: int) -> list[Section]:
    """Return all sections of the report, in the order of the page."""
    sections = {
        "rtl": (measure_builds, (draw_costs, draw_word_lengths)),
        "noise": (renderer_speed.measure_noise, (renderer_speed.draw_renderer,)),
        "growth": (renderer_speed.measure_growth, (renderer_speed.draw_growth,)),
        "budget": (stage_errors.measure_budget, (stage_errors.draw_budget,)),
    }
    return [
        *engine_report.display_sections(scenes, plan, seed),
        *(Section(name, partial(measure, scenes, plan, seed), draws) for name, (measure, draws) in sections.items()),
    ]


def template_names(tables: Mapping[str, Figures]) -> dict[str, Any]:
    """Return the variables of the page's template that are not tables."""
    front = [name for name, is_best in on_front(tables["rtl"]).items() if is_best]
    return {"powers": renderer_speed.powers_of(tables["growth"]), "front": front, "placed": placed()[0]}


def placed() -> tuple[dict[str, str], dict[str, dict[str, float]]]:
    """Read the origin and each configuration's figures `PLACED` from `SYNTHESIS`; raise InputError if one is absent."""
    path = repository() / SYNTHESIS
    origin, rows = read_csv(path)
    try:
        return origin, {row["configuration"]: {key: float(row[key]) for key in PLACED} for row in rows}
    except (KeyError, TypeError, ValueError) as error:
        raise input_error(str(path), f"has no figures of place-and-route ({error})", "run make synth") from None


def configurations(plan: Plan) -> list[Named]:
    """Return a plan's configurations: named configurations, and an exact one for each further word length."""
    configs = [c for name, c in CONFIGURATIONS.items() if plan.all_configurations or name in SIMULATED]
    builds = {c.build for c in configs}
    lengths = [Build(bits, grid) for grid in DISPLAYS for bits in plan.fraction_bits]
    return configs + [Named(f"{b.grid}-{b.fraction_bits}", b) for b in lengths if b not in builds]


def measure_builds(scenes: Path, plan: Plan, seed: int) -> Figures:
    """Measure the plan's configurations, each on the founding paper's display with the same grid."""
    configs, (_, sizes) = configurations(plan), placed()
    logger.info("configurations of the RTL: simulation ...")
    runs = {
        c.name: words_of_chief_rays(c.displays(scenes)[0], replace(c.build, cross_cells=True), seed, plan.timed_rays)
        for c in configs
        if plan.simulate and c.name in SIMULATED
    }
    rates = in_turn({name: engine_report.rtl_rate(run) for name, run in runs.items()}, plan.rounds)

    @cache
    def pictures(display: Display) -> Pictures:
        return Pictures.of(scenes, display, plan, seed)

    @cache
    def golden(display: Display, model: Any, aperture: Aperture) -> Radiance:
        return pictures(display).integral(model, "golden", aperture=aperture)

    rows = []
    for config in configs:
        logger.info("configurations of the RTL: %s ...", config.name)
        build, display, run = config.build, config.displays(scenes)[0], runs.get(config.name)
        aperture: Aperture = "full" if build.aims else "chief"
        sample = engine_report.random_rays(display, aperture, plan.rays, seed)
        words = (build.model, build.fraction_bits)
        twin = trace_fixed(display, sample.pixels, sample.aperture, *words, max_cell_steps=build.max_cell_steps)
        ray_errors = errors(sample.trace(), twin, pictures(display).scene.depth_range_mm)
        picture = pictures(display).integral(build.model, "twin", build.fraction_bits, aperture)
        own_db, exact_db = (psnr_db(picture, golden(display, model, aperture)) for model in (build.model, "exact"))
        size = sizes.get(config.name)
        keys = (config.name, build.grid, build.model, build.fraction_bits, aperture, display.name)
        row: dict[str, Any] = dict(zip(KEYS, keys, strict=True))
        row |= {key: None if size is None else Measured(size[key]) for key in PLACED}
        row["simulated_rays_per_second"] = None if run is None else Measured.of(rates[config.name])
        row["words_differ"] = None if run is None else Measured(run.count_differences(rtl_pipeline))
        row |= {key: Measured(value) for key, value in ray_errors.items()}
        rows.append({**row, "image_db": Measured.finite(own_db), "exact_image_db": Measured.finite(exact_db)})
    return Figures("report-rtl", KEYS, rows)


def pareto_front(costs: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Return which designs are Pareto-optimal: no design costs less in one column and no more in the others."""
    cost = np.asarray(costs, np.float64)
    no_more = (cost[:, None] <= cost[None]).all(axis=2)
    less = (cost[:, None] < cost[None]).any(axis=2)
    return np.asarray(~(no_more & less).any(axis=0))


def on_front(data: Figures) -> dict[str, bool]:
    """Return which placed configurations are Pareto-optimal in cells, clock and error, for equal display and rays."""
    front: dict[str, bool] = {}
    for rows in groups((row for row in data.rows if row["mhz"] is not None), "display", "rays"):
        costs = [[*(sign * row[key].median for key, sign in PLACED.items()), row["max_mm"].median] for row in rows]
        front |= dict(zip((row["configuration"] for row in rows), pareto_front(costs).tolist(), strict=True))
    return front


def draw_costs(data: Figures) -> Plot:
    """Draw the placed configurations' error against cells and against clock."""
    picture, axes = make_axes(1, 2)
    for name, best in on_front(data).items():
        (row,) = where(data.rows, configuration=name)
        square = row["grid"] == "square"
        colour = COLOURS[[*DISPLAYS].index(row["grid"])]
        for axis, key in zip(axes[0], ("lut", "mhz"), strict=True):
            at = (row[key].median, row["max_mm"].median)
            axis.plot(*at, "o", color=colour, fillstyle="full" if best else "none")
            # Marks are close together: names are right of marks of square grids, and left of marks of hexagonal grids.
            axis.annotate(
                name, at, xytext=(4 if square else -4, 4), textcoords="offset points",
                ha="left" if square else "right", color=colour, fontsize=7,
            )  # fmt: skip
    for axis, label in zip(axes[0], ("LUT", "clock, MHz = M rays/s"), strict=True):
        axis.set(yscale="log", xlabel=label, ylabel="largest error in the scene, mm")
        axis.margins(x=0.3, y=0.2)
    return Plot("report-rtl", finish_picture(picture))


def draw_word_lengths(data: Figures) -> Plot:
    """Draw the errors of the exact pipeline's rays and pictures against the word length."""
    picture, axes = make_axes(1, 2)
    exact = where(data.rows, model="exact", rays="chief")
    rows = [row for row in exact if row["display"] == DISPLAYS[row["grid"]][0]]
    for axis, key in zip(axes[0], ("max_mm", "image_db"), strict=True):
        draw_lines(axis, sorted(rows, key=lambda row: int(row["fraction_bits"])), "grid", "fraction_bits", key)
    axes[0][0].set(yscale="log", xlabel="F, fraction bits", ylabel="largest error in the scene, mm")
    axes[0][1].set(xlabel="F, fraction bits", ylabel="integral image against golden, dB")
    return Plot("report-word-lengths", finish_picture(picture))


@make_command("full_report")
def main(options: ReportOptions = ReportOptions) -> None:  # type: ignore[assignment]
    """Measure speed and error of the complete product, and write a report.

    The report covers engines, models, word lengths and the renderer, and lists figures that changed since an earlier
    run. The files are report.md, report.html, plots and CSV. Run the program on an idle machine, in the project's top
    folder.

    Example: python -m tools.full_report -o out/report
    """

    def measure(scenes: Path, before: Stored | None) -> tuple[Page, Comparison]:
        # Raise InputError before anything is measured.
        placed()
        plan, words = QUICK if options.quick else WHOLE, f"python -m tools.full_report {options.words()}"
        sections = make_sections(scenes, plan, options.seed)
        return engine_report.make_report(sections, plan, options.seed, words, before, template_names, TEMPLATES)

    write_report(options, TABLES, measure)


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:], main, None))

"""Configurations of the RTL: cells and clock, simulated rate, error of rays and pictures, and the Pareto front."""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from lippmann.base.images import Radiance
from lippmann.base.tones import psnr_db
from lippmann.conformance.engine_speeds import Pictures, Simulation, errors, in_turn, random_rays
from lippmann.conformance.figures import Figures, Measured, groups, read_csv
from lippmann.display.description import Display
from lippmann.engines import trace_fixed
from lippmann.errors import input_error
from lippmann.fixed.build import CONFIGURATIONS, DISPLAYS, Build, Named
from lippmann.rendering.sources import Aperture
from lippmann.simulation.toolchain import repository

if TYPE_CHECKING:
    from tools.full_report import Plan

logger = logging.getLogger("lippmann.report")
#: The configurations that are simulated. Each of the others would take half a minute to compile.
SIMULATED = ("widest-square", "widest-hex", "compact-square", "compact-hex")
#: Figures of place-and-route, and the sign with which each counts as a cost: a faster clock costs less.
PLACED = {"lut": 1.0, "mult18x18d": 1.0, "dp16kd": 1.0, "ramw": 1.0, "mhz": -1.0}
#: Where `make synth` keeps them.
SYNTHESIS = "docs/reports/synthesis.csv"
#: Columns that name a row.
KEYS = ("configuration", "grid", "model", "fraction_bits", "rays", "display")


def placed() -> tuple[dict[str, str], dict[str, dict[str, float]]]:
    """Read the kept figures of place-and-route: their origin, and those of `PLACED` of each configuration.

    Raises InputError when the file is missing or lacks a column.
    """
    path = repository() / SYNTHESIS
    origin, rows = read_csv(path)
    try:
        return origin, {row["configuration"]: {key: float(row[key]) for key in PLACED} for row in rows}
    except (KeyError, TypeError, ValueError) as error:
        raise input_error(str(path), f"holds no figures of place-and-route ({error})", "run make synth") from None


def configurations(plan: Plan) -> list[Named]:
    """Return a plan's configurations: the named ones, and the exact ones of each word length that have no name."""
    named = [c for name, c in CONFIGURATIONS.items() if plan.named or name in SIMULATED]
    builds = {c.build for c in named}
    lengths = [Build(bits, grid) for grid in DISPLAYS for bits in plan.fraction_bits]
    return named + [Named(f"{b.grid}-{b.fraction_bits}", b) for b in lengths if b not in builds]


def measure(scenes: Path, plan: Plan, seed: int) -> Figures:
    """Measure the plan's configurations, each on the founding paper's display with its grid."""
    chosen, (_, sizes) = configurations(plan), placed()
    logger.info("configurations of the RTL: simulation ...")
    runs = {
        c.name: Simulation(c.displays(scenes)[0], replace(c.build, cross_cells=True), seed, plan.timed_rays)
        for c in chosen
        if plan.simulate and c.name in SIMULATED
    }
    rates = in_turn({name: run.rtl_rate for name, run in runs.items()}, plan.rounds)

    @cache
    def pictures(display: Display) -> Pictures:
        return Pictures.of(scenes, display, plan, seed)

    @cache
    def golden(display: Display, model: Any, aperture: Aperture) -> Radiance:
        return pictures(display).integral(model, "golden", aperture=aperture)

    rows = []
    for named in chosen:
        logger.info("configurations of the RTL: %s ...", named.name)
        build, display, run = named.build, named.displays(scenes)[0], runs.get(named.name)
        aperture: Aperture = "full" if build.aims else "chief"
        sample = random_rays(display, aperture, plan.rays, seed)
        words = (build.model, build.fraction_bits)
        twin = trace_fixed(display, sample.pixels, sample.aperture, *words, max_cell_steps=build.max_cell_steps)
        found = errors(sample.trace(), twin, pictures(display).scene.depth_range_mm)
        picture = pictures(display).integral(build.model, "twin", build.fraction_bits, aperture)
        own, whole = (psnr_db(picture, golden(display, model, aperture)) for model in (build.model, "exact"))
        size = sizes.get(named.name)
        keys = (named.name, build.grid, build.model, build.fraction_bits, aperture, display.name)
        rows.append(
            {
                **dict(zip(KEYS, keys, strict=True)),
                **{key: None if size is None else Measured(size[key]) for key in PLACED},
                "simulated_rays_per_second": None if run is None else Measured.of(rates[named.name]),
                "words_differ": None if run is None else Measured(run.words_differ()),
                **{key: Measured(value) for key, value in found.items()},
                "image_db": Measured.finite(own),
                "exact_image_db": Measured.finite(whole),
            }
        )
    return Figures("report-rtl", KEYS, rows)


def pareto_front(costs: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Tell which designs no other design dominates, from costs (N, columns); turn the sign of what should be large.

    One dominates another when it costs no more in any column, and less in one. Designs of equal cost do not dominate
    each other.
    """
    cost = np.asarray(costs, np.float64)
    no_more = (cost[:, None] <= cost[None]).all(axis=2)
    less = (cost[:, None] < cost[None]).any(axis=2)
    return np.asarray(~(no_more & less).any(axis=0))


def on_front(data: Figures) -> dict[str, bool]:
    """Tell which placed configurations are on the Pareto front of those with the same display and rays.

    The costs are the cells of each kind, the clock, and the largest error in the scene against the exact model.
    """
    found: dict[str, bool] = {}
    for rows in groups((row for row in data.rows if row["mhz"] is not None), "display", "rays"):
        costs = [[*(sign * row[key].median for key, sign in PLACED.items()), row["max_mm"].median] for row in rows]
        found |= dict(zip((row["configuration"] for row in rows), pareto_front(costs).tolist(), strict=True))
    return found

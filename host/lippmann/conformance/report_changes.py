"""Compares a run with the one before: which measured values moved by more than the noise.

The noise of a value is its spread over the repeats of one run. A value has moved when its medians in the two runs are
farther apart than the sum of both spreads: then no repeat of one run lies among the repeats of the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lippmann.conformance.figures import Figures, Measured, Stored

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

    def flat(self) -> dict[str, Any]:
        """Return the move as a CSV holds it."""
        before = {"before": self.before.median, "spread_before": self.before.spread}
        now = {"now": self.now.median, "spread_now": self.now.spread, "ratio": self.ratio}
        return {"table": self.table, "row": self.row, "figure": self.figure, **before, **now}


@dataclass(frozen=True)
class Comparison:
    """The result of a comparison."""

    #: The origin of the run before; empty when there is none.
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

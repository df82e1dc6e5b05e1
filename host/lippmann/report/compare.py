"""A run beside the one before: which figures moved by more than the noise.

The noise of a figure is its spread over the repeats of one run. A figure has moved when its medians in the two runs lie
farther apart than both spreads together: then no repeat of the one run can lie among those of the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lippmann.report.figures import Figures, Measured, Stored

#: Relative differences up to this are the last digits of other versions of the same arithmetic.
SAME = 1e-6
#: What must be alike for two runs to measure the same.
ALIKE = ("command", "seed")


@dataclass(frozen=True)
class Move:
    """A figure that moved: its table, its row's keys, its column, and its values before and now."""

    table: str
    row: str
    figure: str
    before: Measured
    now: Measured

    @property
    def ratio(self) -> float | None:
        """Now over before; None from 0."""
        return self.now.median / self.before.median if self.before.median else None


@dataclass(frozen=True)
class Comparison:
    """What came out of comparing.

    Attributes
    ----------
    before
        Where the run before comes from; empty when there is none.
    differs
        What is not alike (`ALIKE`), so that nothing was compared.
    changed
        Other things that the two say differently of themselves: machine, versions.
    compared
        Figures that both runs have.
    moved
        Those of them that moved.
    new, gone
        How many only the one run has.
    """

    before: Mapping[str, str]
    differs: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    compared: int = 0
    moved: tuple[Move, ...] = ()
    new: int = 0
    gone: int = 0


def has_moved(before: Measured, now: Measured) -> bool:
    """Tell whether a figure moved by more than the noise."""
    apart = abs(now.median - before.median)
    return apart > max(before.spread + now.spread, SAME * abs(before.median))


def compare(origin: Mapping[str, str], tables: Sequence[Figures], before: Stored | None) -> Comparison:
    """Compare a run with one that was kept.

    Parameters
    ----------
    origin
        What the run says of itself.
    tables
        Its tables.
    before
        The other run; None: there is none.
    """
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

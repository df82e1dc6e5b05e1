"""The section that tells what moved since the run before."""

from __future__ import annotations

from collections.abc import Mapping

from lippmann.report.compare import Comparison
from lippmann.report.section import Section, Shown

RULE = (
    "A figure is the median of its repeats, its spread the largest of them less the smallest. It has moved when the "
    "medians of the two runs lie farther apart than both spreads together; what comes out alike each time moves with "
    "any change."
)


def section(found: Comparison, origin: Mapping[str, str]) -> Section:
    """Return the section of a comparison."""
    title = "Since the run before"
    if not found.before:
        return Section(
            title, ("No run was kept in the folder: there is nothing to compare with yet.", RULE), (), (), ()
        )
    run = f"The run before: {'; '.join(f'{key}: {value}' for key, value in found.before.items())}."
    if found.differs:
        what = " and ".join(found.differs)
        return Section(title, (run, f"Not compared: {what} differ, so that it measured something else."), (), (), ())
    text = [run]
    if found.changed:
        text.append(
            "Mind that these differ: "
            + "; ".join(f"{key}, now {origin[key]}, then {found.before.get(key, 'not told')}" for key in found.changed)
            + "."
        )
    text.append(
        f"{len(found.moved)} of {found.compared} figures moved by more than the noise; {found.new} are new, "
        f"{found.gone} are gone. {RULE}"
    )
    tables: tuple[Shown, ...] = ()
    if found.moved:
        tables = (
            Shown(
                "Figures that moved by more than the noise",
                {
                    "table": [move.table for move in found.moved],
                    "row": [move.row for move in found.moved],
                    "figure": [move.figure for move in found.moved],
                    "before": [move.before.median for move in found.moved],
                    "spread before": [move.before.spread for move in found.moved],
                    "now": [move.now.median for move in found.moved],
                    "spread now": [move.now.spread for move in found.moved],
                    "ratio": [move.ratio for move in found.moved],
                },
            ),
        )
    return Section(title, text, tables, (), ())

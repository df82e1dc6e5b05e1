"""`lippmann bench hard`: every engine on the hard cases, and what its formulas gain."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from lippmann.conditioning.cases import CASES, Out, changed, hard_sets
from lippmann.conditioning.measure import FixedRow, Row, measure, measure_fixed, truth_of
from lippmann.display import Display, load_display
from lippmann.fixed.words import COMPACT, WIDEST
from lippmann.measure.naive import Gain
from lippmann.optics.rays import Engine
from lippmann.report.tables import table
from lippmann.sim.harness import rtl_pipeline

#: Engines that are held to the truth.
REAL: tuple[Engine, ...] = ("golden", "fast")


def displays(scenes: Path) -> Iterator[Display]:
    """Yield the founding paper's displays, as they ship and with the plano side to the viewer."""
    for name in ("paper-square", "paper-hex"):
        display = load_display(scenes / f"displays/{name}.toml")
        yield display
        yield changed(display, plano_side="viewer", gap_mm=display.array.focal_length_mm)


def bench_hard(scenes: Path, seed: int, device: str, log: Callable[[str], None]) -> tuple[list[Row], list[FixedRow]]:
    """Measure golden and fast against the truth, the twin against golden, and the RTL (F = 23) against the twin."""
    real, fixed = [], []
    for display in displays(scenes):
        log(f"{display.name}, plano side to the {display.array.plano_side} ...")
        for rays in hard_sets(display, "all", seed):
            known = truth_of(rays)
            real += [measure(known, engine, device) for engine in REAL]
            if isinstance(rays, Out):
                fixed.append(measure_fixed(rays, COMPACT))
                fixed.append(measure_fixed(rays, WIDEST, rtl_pipeline))
    return real, fixed


def _of(rows: Sequence[Any], case: str, **wanted: Any) -> list[Any]:
    return [
        row
        for row in rows
        if row.set.split("/")[0] == case and all(getattr(row, key) == value for key, value in wanted.items())
    ]


def report_text(real: list[Row], fixed: list[FixedRow], gains: list[Gain]) -> str:
    """Return the page."""
    golden = [row for row in real if row.engine == "golden"]
    fast = [row for row in real if row.engine == "fast"]
    differ = [row.words_differ for row in fixed if row.words_differ is not None]
    outside = sum(row.outside_band for row in golden)
    lines = {
        "golden": f"{max(row.worst for row in golden):.2f} units at most where 4 are allowed, over "
        f"{sum(row.rays for row in golden)} rays; {sum(row.status_differs for row in golden)} fates differ, "
        f"{outside} of them outside the band of 4 units of the last place of one input",
        "fast": f"{max(row.worst for row in fast if row.unit == 'microradian'):.2f} microradian at most over "
        f"{sum(row.conditioned for row in fast if row.unit == 'microradian')} conditioned rays from the panel, "
        f"{max((row.worst for row in fast if row.unit == 'micrometre'), default=0.0):.2f} micrometre on the panel over "
        f"{sum(row.conditioned for row in fast if row.unit == 'micrometre')} from the world; "
        f"{sum(row.status_differs for row in fast)} fates differ, {sum(row.outside_band for row in fast)} of them "
        "outside the band of 4 units of a float32's last place of one input; "
        f"{sum(row.not_a_number for row in fast)} values are not a number",
        "twin": f"{sum(row.rays for row in fixed)} rays: {sum(row.refused for row in fixed)} refused, "
        f"{sum(row.flagged for row in fixed)} flagged by their status, {sum(row.through for row in fixed)} through; "
        f"{sum(row.overflowed for row in fixed)} overflowed unseen",
        "rtl": f"{sum(differ)} words differ from the twin's, over {len(differ)} sets at F = {WIDEST}"
        if differ
        else "not simulated",
    }
    return (
        "# Hard cases\n\n"
        "What the figures mean, and what each case is for: [stability](../reference/stability.md).\n\n"
        + "".join(f"- **{engine}**: {said}.\n" for engine, said in lines.items())
        + "\n## Golden and fast against 50 digits\n\n"
        + table(
            {
                "case": list(CASES),
                "rays": [sum(r.rays for r in _of(golden, c)) for c in CASES],
                "condition, at most": [max((r.condition for r in _of(golden, c)), default=0.0) for c in CASES],
                "golden, units": [max((r.worst for r in _of(golden, c)), default=0.0) for c in CASES],
                "other fate": [sum(r.status_differs for r in _of(golden, c)) for c in CASES],
                "outside band": [sum(r.outside_band for r in _of(golden, c)) for c in CASES],
                "fast, conditioned rays": [sum(r.conditioned for r in _of(fast, c)) for c in CASES],
                "fast, microradian or micrometre": [max((r.worst for r in _of(fast, c)), default=0.0) for c in CASES],
                "fast, other fate": [sum(r.status_differs for r in _of(fast, c)) for c in CASES],
                "fast, outside band": [sum(r.outside_band for r in _of(fast, c)) for c in CASES],
                "kept": [all(r.kept for r in _of(real, c)) for c in CASES],
            }
        )
        + f"\n## Fixed point, F = {WIDEST} (F = {COMPACT} in the CSV)\n\n"
        + table(_fixed_table(fixed))
        + "\n## What the formulas gain\n\nLargest errors against 50 digits.\n\n"
        + table({key: [getattr(gain, key) for gain in gains] for key in (f.name for f in dataclasses.fields(Gain))})
    )


def _fixed_table(fixed: list[FixedRow]) -> dict[str, list[Any]]:
    cases = [case for case in CASES if _of(fixed, case)]
    rows = {case: _of(fixed, case, fraction_bits=WIDEST) for case in cases}
    columns: dict[str, list[Any]] = {"case": cases}
    for name in ("rays", "refused", "flagged", "through"):
        columns[name] = [sum(getattr(row, name) for row in rows[case]) for case in cases]
    for name, heading in (("worst_urad", "microradian, at most"), ("worst_nm", "nm, at most")):
        columns[heading] = [max(getattr(row, name) for row in rows[case]) for case in cases]
    columns["overflowed unseen"] = [sum(row.overflowed for row in rows[case]) for case in cases]
    differ = [[row.words_differ for row in rows[case] if row.words_differ is not None] for case in cases]
    columns["words of the RTL that differ"] = [sum(some) if some else None for some in differ]
    return columns

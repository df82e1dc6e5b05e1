"""Pages of single measurements, `lippmann bench NAME --report FOLDER`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from lippmann.animation import write_contact_sheet
from lippmann.conditioning.cases import CASES
from lippmann.conditioning.word_sets import SAMPLE
from lippmann.fixed.words import COMPACT, WIDEST
from lippmann.images import Radiance
from lippmann.measure import depth, fixed
from lippmann.measure.configurations import SYNTHESIS
from lippmann.measure.figures import read_csv
from lippmann.report import plots
from lippmann.report.pages import Page, where
from lippmann.sim.tools import repository

Rows = Sequence[Mapping[str, Any]]
Origin = Mapping[str, str]


def groups(rows: Rows, *keys: str) -> list[list[Mapping[str, Any]]]:
    """Return the rows in groups that have the same keys, in the order of their first rows."""
    found: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        found.setdefault(tuple(row[key] for key in keys), []).append(row)
    return list(found.values())


def fixed_page(origin: Origin, rows: Rows, budget: Rows) -> Page:
    """Return the page of `lippmann bench fixed`."""
    worst = []
    for group in groups(rows, "configuration"):
        kept = [row["kept"] for row in group if row["kept"] is not None]
        most = max(group, key=lambda row: float(row["max_weighted_urad"]))
        maxima = ("max_direction_urad", "max_weighted_urad", "max_point_nm", "edge_nm")
        sums = ("rays", "status_differs", "lenslet_differs", "refused", "lost")
        worst.append(
            {
                **{key: most[key] for key in ("configuration", "fraction_bits", "display")},
                **{key: max(row[key] for row in group) for key in maxima},
                **{key: sum(row[key] for row in group) for key in sums},
                "kept": all(kept) if kept else None,
            }
        )
    steps = []
    for configuration in groups(budget, "configuration"):
        *shares, whole = where(configuration, display=configuration[0]["display"])
        largest = max(shares, key=lambda row: float(row["rms_direction_urad"]))
        steps.append({**largest, "whole_urad": whole["rms_direction_urad"], "whole_nm": whole["rms_point_nm"]})
    most_urad, most_nm = ([row[key] for row in worst] for key in ("max_weighted_urad", "max_point_nm"))
    charts = {"weighted direction, microradian": most_urad, "exit point, nm": most_nm}
    plot = plots.bar_charts("fixed-point-error", [row["configuration"] for row in worst], charts, xscale="log")
    context = {"worst": worst, "steps": steps, "fixed": fixed, "sample": SAMPLE}
    return Page("fixed-point-error", origin, [plot], {"fixed-point-error": rows, "fixed-point-budget": budget}, context)


def depth_page(origin: Origin, rows: Rows, views: tuple[list[Radiance], list[str]] | None = None) -> Page:
    """Return the page of `lippmann bench depth`; `views` are the pictures of its contact sheet, and their captions."""
    sheet = []
    if views is not None:
        with TemporaryDirectory() as folder:
            write_contact_sheet(Path(folder) / "depth.png", *views, columns=2)
            sheet.append(plots.Plot("depth", (Path(folder) / "depth.png").read_bytes()))
    setups = []
    for group in groups(rows, "setup", "rotated"):
        nearer = np.diff([row["centres_mm"] for row in group]) < 0.0
        shifts = [row["wide_mm"] - row["theory_mm"] for row in group]
        setups.append(
            {
                **group[0],
                "images": "rotated" if group[0]["rotated"] else "as captured",
                "relief": "orthoscopic" if nearer.all() else "neither" if nearer.any() else "pseudoscopic",
                "range": f"{group[0]['theory_mm']:+.1f} to {group[-1]['theory_mm']:+.1f}",
                "error": max(abs(row["error_percent"]) for row in group),
                "lenslets": max(abs(row["lenslets_mm"] - row["theory_mm"]) for row in group),
                "shift": f"{min(shifts):+.1f} to {max(shifts):+.1f}",
            }
        )
    near, far = (f"{eyes[0]:+.0f} to {eyes[-1]:+.0f}" for eyes in (depth.EYES_MM, depth.WIDE_EYES_MM))
    rotated = where(rows, rotated=True)
    shifts = [row["wide_mm"] - row["theory_mm"] for row in rotated]
    signs = sum(row["lenslets_mm"] * row["theory_mm"] > 0 for row in rotated)
    context = {
        "rows": rotated,
        "signs": signs,
        "shifts": shifts,
        "setups": setups,
        "near": near,
        "far": far,
        "depth": depth,
    }
    return Page("depth", origin, sheet, {"depth": rows}, context)


def link_page(origin: Origin, efficiency: Rows, frames: Rows) -> Page:
    """Return the page of `lippmann bench link`."""
    share = [100.0 * row["efficiency"] for row in efficiency]
    labels = [f"{row['baud']} baud" for row in efficiency]
    plot = plots.bar_charts("link", labels, {"share of the line's time that carries pixels, %": share}, xlim=(0, 100))
    tables = {"link-efficiency": efficiency, "link-frames": frames}
    return Page("link", origin, [plot], tables, {"lines": efficiency, "frames": frames})


def hard_page(origin: Origin, real: Rows, fixed_rows: Rows, formulas: Rows) -> Page:
    """Return the page of `lippmann bench hard`."""

    def of(case: str, rows: Rows, **wanted: Any) -> Rows:
        return [row for row in where(rows, **wanted) if row["set"].split("/")[0] == case]

    def most(rows: Rows, key: str) -> Any:
        return max((row[key] for row in rows), default=None)

    cases = []
    for case in CASES:
        golden, fast = (of(case, real, engine=engine) for engine in ("golden", "fast"))
        twin = of(case, fixed_rows, fraction_bits=WIDEST)
        cases.append(
            {
                "case": case,
                "rays": sum(row["rays"] for row in golden),
                "condition": most(golden, "condition"),
                "golden": most(golden, "worst"),
                "fast": most(fast, "worst"),
                "outside": sum(row["outside_band"] for row in (*golden, *fast)),
                "kept": all(row["kept"] for row in (*golden, *fast)),
                "twin_urad": most(twin, "worst_urad"),
                "refused": sum(row["refused"] for row in twin) if twin else None,
                "shares": [max(100.0 * row["worst"] / row["bound"] for row in rows) for rows in (golden, fast)],
            }
        )
    charts = {
        f"{engine}: largest error, % of its bound": [case["shares"][k] for case in cases]
        for k, engine in enumerate(("golden", "fast"))
    }
    plot = plots.bar_charts("hard-cases", list(CASES), charts, xlim=(0, 105))
    tables = {"hard-cases": real, "hard-cases-fixed": fixed_rows, "hard-cases-formulas": formulas}
    context = {"real": real, "fixed": fixed_rows, "formulas": formulas, "cases": cases}
    return Page("hard-cases", origin, [plot], tables, {**context, "widest": WIDEST, "compact": COMPACT})


#: Measurements of `docs/measured.md`.
MEASURED = ("trace", "render", "rtl", "view", "animate", "observe")


def measured_page(folder: Path) -> Page:
    """Return the page of the rows that `lippmann bench NAME --report FOLDER` has kept in FOLDER/measured.

    Raises
    ------
    InputError
        When a file cannot be read.
    """
    kept = {name: folder / f"measured/{name}.csv" for name in MEASURED}
    found = {name: read_csv(path) for name, path in kept.items() if path.exists()}
    rows = {name: [_numbers(row) for row in found[name][1]] if name in found else [] for name in MEASURED}
    origins = {name: origin for name, (origin, _) in found.items()}
    placed = [_numbers(row) for row in read_csv(repository() / SYNTHESIS)[1]]
    context = {**rows, "origins": origins, "placed": placed, "groups": groups, "ratios": _ratios(rows["render"])}
    return Page("measured", {}, (), {}, context)


def _ratios(render: Rows) -> list[dict[str, Any]]:
    """Return the ratios of `lippmann bench render`, a row for each kind and integrator, a column for each scene."""
    kinds = {
        "against Mitsuba's perspective": ("rate relative to Mitsuba's own perspective camera", "rate_ratio"),
        "10,404 lenslets against 121": ("time with 10,404 lenslets over time with 121, same panel", "ratio"),
    }
    found: dict[str, dict[str, Any]] = {}
    for row in render:
        for kind, (words, key) in kinds.items():
            if row["what"].startswith(f"{kind}, "):
                scene, integrator = row["what"].removeprefix(f"{kind}, ").split(", ")[:2]
                what = f"{words}, `{integrator}`"
                found.setdefault(what, {"what": what})[scene] = row[key]
    return list(found.values())


def _numbers(row: Mapping[str, str]) -> dict[str, Any]:
    """Return a row of text with its numbers as numbers, and empty cells as None."""

    def value(text: str) -> Any:
        try:
            return int(text) if text.isdecimal() else float(text)
        except ValueError:
            return text or None

    return {key: value(text) for key, text in row.items()}

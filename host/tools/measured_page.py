"""Makes docs/generated/measured.md from the rows that `tools.bench NAME --report docs/generated` writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lippmann.base.machine import has_avx512
from lippmann.conformance.figures import Rows, groups, read_csv
from lippmann.conformance.pages import Page
from lippmann.simulation.toolchain import repository

from tools.report_plots import make_page

#: The file of place-and-route figures that `make synth` writes.
SYNTHESIS = "docs/generated/reports/synthesis.csv"
#: Names of the measurements that docs/generated/measured.md shows.
MEASURED = (
    *("trace", "render", "render-avx512", "stages", "stages-avx512", "stages-cuda", "live", "live-cuda"),
    *("rtl", "view", "animate", "observe"),
)


def measured_name(name: str, device: str) -> str:
    """Return the name of a measurement's file, which depends on the device and, for some measurements, on AVX-512."""
    if device == "cuda":
        return f"{name}-cuda"
    return f"{name}-avx512" if has_avx512() and f"{name}-avx512" in MEASURED else name


def measured_page(folder: Path) -> Page:
    """Return the page made from the rows in `folder`/measured; raise InputError if a file cannot be read."""
    rows: dict[str, Rows] = dict.fromkeys(MEASURED, ())
    origins = {}
    for name in MEASURED:
        if (path := folder / f"measured/{name}.csv").exists():
            origins[name], rows[name] = read_csv(path)
    _, placed = read_csv(repository() / SYNTHESIS)
    tables = {name.replace("-", "_"): table for name, table in rows.items()}
    context = {**tables, "origins": origins, "placed": placed, "groups": groups, "ratios": _ratios}
    return make_page("measured", {}, context=context)


def _ratios(render: Rows) -> list[dict[str, Any]]:
    """Return the ratios in the rows of `tools.bench render`: a row per kind and integrator, a column per scene."""
    kinds = {
        "against Mitsuba's perspective": ("rate relative to Mitsuba's own perspective camera", "rate_ratio"),
        "10,404 lenslets against 121": ("time with 10,404 lenslets over time with 121, same panel", "ratio"),
    }
    ratios: dict[str, dict[str, Any]] = {}
    for row in render:
        for kind, (words, key) in kinds.items():
            if row["what"].startswith(f"{kind}, "):
                scene, integrator = row["what"].removeprefix(f"{kind}, ").split(", ")[:2]
                what = f"{words}, `{integrator}`"
                ratios.setdefault(what, {"what": what})[scene] = row[key]
    return list(ratios.values())

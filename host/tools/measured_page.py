"""The page docs/generated/measured.md, of the rows that `python -m tools.bench NAME --report docs/generated` keeps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lippmann.base.machine import has_avx512
from lippmann.conformance.figures import Rows, groups, read_csv
from lippmann.conformance.pages import Page
from lippmann.simulation.toolchain import repository

from tools.report_plots import make_page

#: Where `make synth` keeps the figures of place-and-route.
SYNTHESIS = "docs/generated/reports/synthesis.csv"
#: Measurements of `docs/generated/measured.md`.
MEASURED = (
    *("trace", "render", "render-avx512", "stages", "stages-avx512", "stages-cuda", "live", "live-cuda"),
    *("rtl", "view", "animate", "observe"),
)


def measured_name(name: str, device: str) -> str:
    """Return the name under which a measurement is kept: a GPU's figures stand beside the CPU's.

    So do those of `render` and `stages` with AVX-512, where rays are traced otherwise (`lippmann.rendering.lights`).
    """
    if device == "cuda":
        return f"{name}-cuda"
    own = f"{name}-avx512"
    return own if has_avx512() and own in MEASURED else name


def measured_page(folder: Path) -> Page:
    """Return the page of the rows that `python -m tools.bench NAME --report FOLDER` has kept in FOLDER/measured.

    Raises InputError when a file cannot be read.
    """
    rows: dict[str, Rows] = dict.fromkeys(MEASURED, ())
    origins = {}
    for name in MEASURED:
        if (path := folder / f"measured/{name}.csv").exists():
            origins[name], rows[name] = read_csv(path)
    _, placed = read_csv(repository() / SYNTHESIS)
    rows = {name.replace("-", "_"): kept for name, kept in rows.items()}
    context = {**rows, "origins": origins, "placed": placed, "groups": groups, "ratios": _ratios}
    return make_page("measured", {}, context=context)


def _ratios(render: Rows) -> list[dict[str, Any]]:
    """Return the ratios of `tools.bench render`, a row for each kind and integrator, a column for each scene."""
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

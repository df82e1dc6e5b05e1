"""Pages of single measurements, `python -m tools.bench NAME --report FOLDER`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from lippmann.base.animation import write_contact_sheet
from lippmann.base.images import Radiance
from lippmann.base.machine import has_avx512
from lippmann.conformance.figures import Rows, columns, groups, read_csv, values, where
from lippmann.conformance.hard_cases import CASES
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import Plot
from lippmann.fixed.scene_build import SceneBuild
from lippmann.fixed.words import COMPACT, WIDEST
from lippmann.layers.layer_choice import FULL_SAMPLES
from lippmann.layers.scene_cutting import SLOT
from lippmann.simulation.toolchain import repository

from tools import adaptive, content_gallery, depth, fixed_errors, layers_likeness, shading_speed
from tools.calibration_accuracy import photo_width
from tools.report_builds import SYNTHESIS
from tools.report_plots import draw_bar_charts, draw_calibration_sweep, draw_layers, draw_shading, make_page
from tools.word_sets import SAMPLE

Origin = Mapping[str, str]


def fixed_page(origin: Origin, rows: Rows, budget: Rows) -> Page:
    """Return the page of `tools.bench fixed`."""
    worst = []
    for group in groups(rows, "configuration"):
        kept = [kept for kept in values(group, "kept") if kept is not None]
        most = max(group, key=lambda row: float(row["max_weighted_urad"]))
        counts = ("rays", "status_differs", "lenslet_differs", "refused", "lost")
        worst.append(
            {
                **{key: most[key] for key in ("configuration", "fraction_bits", "display")},
                **{key: max(values(group, key)) for key in fixed_errors.MAXIMA},
                **{key: sum(values(group, key)) for key in counts},
                "kept": all(kept) if kept else None,
            }
        )
    steps = []
    for configuration in groups(budget, "configuration"):
        *shares, whole = where(configuration, display=configuration[0]["display"])
        largest = max(shares, key=lambda row: float(row["rms_direction_urad"]))
        steps.append({**largest, "whole_urad": whole["rms_direction_urad"], "whole_nm": whole["rms_point_nm"]})
    charts = columns(worst, {"weighted direction, microradian": "max_weighted_urad", "exit point, nm": "max_point_nm"})
    plot = draw_bar_charts("fixed-point-error", values(worst, "configuration"), charts, xscale="log")
    context = {"worst": worst, "steps": steps, "fixed": fixed_errors, "sample": SAMPLE}
    return make_page(
        "fixed-point-error", origin, [plot], {"fixed-point-error": rows, "fixed-point-budget": budget}, context
    )


def calibration_page(origin: Origin, tables: Mapping[str, Rows], panel_px: int) -> Page:
    """Return the page of `tools.bench calibration`; `panel_px` is the width of the random displays' panels."""
    random = [*tables["rows"], *tables["solids"], *tables["bowed"]]
    found = {name: [row for row in rows if "refused" not in row] for name, rows in tables.items()}
    refused = [row for row in random if "refused" in row]
    context = {**found, "sweep": tables["sweep"], "refused": refused, "tried": len(random)}
    widths = {"panel_px": panel_px, "photo_px": photo_width(panel_px)}
    solved = found["rows"]
    sums = {name: sum(row[name] for row in solved) for name in ("outside", "numbers")}
    labels = [f"{row['display']} {row['grid']} {row['plano_side']}" for row in solved]
    charts = {"centres, px rms": values(solved, "rms_px"), "gap, %": values(solved, "gap_percent")}
    plot = [draw_bar_charts("calibration-accuracy", labels, charts)] if solved else []
    plot += [draw_calibration_sweep(tables["sweep"])] if tables["sweep"] else []
    kept = {"accuracy": solved, **{name: rows for name, rows in tables.items() if name != "rows"}}
    files = {f"calibration-{name}": rows for name, rows in kept.items() if rows}
    return make_page("calibration-accuracy", origin, plot, files, {**context, **widths, **sums})


def depth_page(origin: Origin, rows: Rows, views: tuple[list[Radiance], list[str]] | None = None) -> Page:
    """Return the page of `tools.bench depth`; `views` are the pictures of its sheet, and captions."""
    sheet = _sheet("depth", views, 2)
    moved = [{**row, "shift": row["wide_mm"] - row["theory_mm"]} for row in rows]
    setups = []
    for group in groups(moved, "setup", "rotated"):
        nearer, shifts = np.diff(values(group, "centres_mm")) < 0.0, values(group, "shift")
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
    rotated = where(moved, rotated=True)
    signs = sum(row["lenslets_mm"] * row["theory_mm"] > 0 for row in rotated)
    context = {"rows": rotated, "signs": signs, "setups": setups, "near": near, "far": far, "depth": depth}
    return make_page("depth", origin, sheet, {"depth": rows}, context)


def _sheet(name: str, views: tuple[list[Radiance], list[str]] | None, across: int) -> list[Plot]:
    """Return the contact sheet of views and their captions; without views, none."""
    if views is None:
        return []
    with TemporaryDirectory() as folder:
        write_contact_sheet(Path(folder) / "sheet.png", *views, columns=across)
        return [Plot(name, (Path(folder) / "sheet.png").read_bytes())]


def content_page(origin: Origin, rows: Rows, views: tuple[list[Radiance], list[str]] | None = None) -> Page:
    """Return the page of `tools.bench content`; `views` are the pictures of its sheet, and captions."""
    context = {
        "rows": rows, "display": content_gallery.DISPLAY, "gallery": content_gallery.GALLERY,
        "samples": content_gallery.SAMPLES, "eye_mm": round(content_gallery.EYE_MM),
    }  # fmt: skip
    return make_page("content", origin, _sheet("content", views, 4), {"content": rows}, context)


def shading_page(
    origin: Origin, tables: Mapping[str, Rows], views: tuple[list[Radiance], list[str]] | None = None
) -> Page:
    """Return the page of `tools.bench shading`; `views` are the pictures of its sheet, and captions."""
    drawn = [draw_shading(tables["shading"]), *_sheet("shading-map", views, 3)]
    context = {
        "rows": tables["shading"], "pairs": tables["shading-likeness"], "saved": tables["shading-adaptive"],
        "shading": shading_speed, "adaptive": adaptive,
    }  # fmt: skip
    return make_page("shading", origin, drawn, tables, context)


def link_page(origin: Origin, efficiency: Rows, frames: Rows) -> Page:
    """Return the page of `tools.bench link`."""
    share = values(efficiency, "efficiency", 0.01)
    labels = [f"{row['baud']} baud" for row in efficiency]
    plot = draw_bar_charts("link", labels, {"share of the line's time that carries pixels, %": share}, xlim=(0, 100))
    tables = {"link-efficiency": efficiency, "link-frames": frames}
    return make_page("link", origin, [plot], tables, {"lines": efficiency, "frames": frames})


def hard_page(origin: Origin, real: Rows, fixed_rows: Rows, formulas: Rows) -> Page:
    """Return the page of `tools.bench hard`."""
    engines = ("golden", "fast")
    named, words = ([{**row, "case": row["set"].split("/")[0]} for row in rows] for rows in (real, fixed_rows))
    cases = []
    for case in CASES:
        golden, fast = (where(named, case=case, engine=engine) for engine in engines)
        twin = where(words, case=case, fraction_bits=WIDEST)
        cases.append(
            {
                "case": case,
                "rays": sum(values(golden, "rays")),
                "condition": max(values(golden, "condition")),
                "golden": max(values(golden, "worst")),
                "fast": max(values(fast, "worst")),
                "outside": sum(values([*golden, *fast], "outside_band")),
                "kept": all(values([*golden, *fast], "kept")),
                "twin_urad": max(values(twin, "worst_urad"), default=None),
                "refused": sum(values(twin, "refused")) if twin else None,
            }
        )
    charts = {
        f"{engine}: largest error, % of its bound": [
            max(100.0 * row["worst"] / row["bound"] for row in where(named, case=case, engine=engine)) for case in CASES
        ]
        for engine in engines
    }
    plot = draw_bar_charts("hard-cases", list(CASES), charts, xlim=(0, 105))
    tables = {"hard-cases": real, "hard-cases-fixed": fixed_rows, "hard-cases-formulas": formulas}
    context = {"real": real, "fixed": fixed_rows, "formulas": formulas, "cases": cases}
    return make_page("hard-cases", origin, [plot], tables, {**context, "widest": WIDEST, "compact": COMPACT})


def layers_page(origin: Origin, rows: Rows) -> Page:
    """Return the page of `tools.bench layers`, of the rows of `layers_likeness.measure`."""
    built, drawn = SceneBuild().layers, [row for row in rows if row["drawn"] != "streamed"]
    seen = [
        {**group[0], **{str(row["layers"]): f"{row['view_db']:.1f} ({row['worst_db']:.1f})" for row in group}}
        for group in groups(drawn, "display", "scene", "drawn")
    ]
    beside = []
    for row in where(rows, drawn="streamed"):
        cut = where(drawn, display=row["display"], scene=row["scene"], layers=built)
        decibels = {f"{one['drawn']}_db": one["view_db"] for one in cut}
        sent = {"sent_bytes": row["line_bytes"], "sent_seconds": layers_likeness.line_seconds(row["line_bytes"])}
        beside.append({**row, **decibels, **sent, **{key: cut[0][key] for key in ("line_bytes", "frame_bytes")}})
        beside[-1]["line_seconds"] = layers_likeness.line_seconds(cut[0]["line_bytes"])
    context = {
        "rows": drawn, "seen": seen, "beside": beside, "layers": layers_likeness, "slot": SLOT, "built": built,
        "full_samples": FULL_SAMPLES, "baud": layers_likeness.BAUD // 10**6,
    }  # fmt: skip
    return make_page("layers", origin, [draw_layers(rows)], {"layers": rows}, context)


#: Measurements of `docs/measured.md`.
MEASURED = (
    *("trace", "render", "render-avx512", "stages", "stages-avx512", "stages-cuda", "live", "live-cuda"),
    *("rtl", "view", "animate", "observe"),
)


def measured_name(name: str, device: str) -> str:
    """Return the name under which a measurement is kept: a GPU's figures stand beside the CPU's.

    So do those of `render` and `stages` with AVX-512, where rays are traced otherwise (`lippmann.rendering.coherence`).
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
    return make_page("measured", {}, (), {}, context)


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

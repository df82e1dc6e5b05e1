"""Create the report page of `lippmann calibrate report`."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from lippmann.base.tones import psnr_db
from lippmann.calibration.check import rings
from lippmann.calibration.result import Calibration
from lippmann.conformance.figures import Rows
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import COLOURS, Plot, finish_picture, make_axes
from lippmann.display.description import Display, Point3
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.optics.rays import Floats

#: Names of the columns of `calibration.result.Calibration.field`.
FIELD = ("position", "i", "j", "x_mm", "y_mm", "right_px", "down_px", "kept")
POSITION, _, _, X, Y, RIGHT, DOWN, KEPT = range(len(FIELD))


def draw_residuals(field: Floats, cameras: Rows) -> Plot:
    """Draw the residuals as arrows over the array, one plot per camera position."""
    picture, axes = make_axes(1, max(1, len(cameras)))
    rng = np.random.default_rng(1)
    for axis, k in zip(axes[0], range(len(cameras)), strict=False):
        rows = field[(field[:, POSITION] == k) & (field[:, KEPT] > 0)]
        rows = rows[np.sort(rng.permutation(len(rows))[:600])]  # more than 600 arrows would overlap
        typical = max(1e-3, float(np.median(np.hypot(rows[:, RIGHT], rows[:, DOWN]))) if len(rows) else 1.0)
        span = max(1e-6, float(np.ptp(rows[:, X])) if len(rows) else 1.0)
        scale = {"angles": "xy", "scale_units": "xy", "scale": 40.0 * typical / span}
        arrows = (rows[:, X], rows[:, Y], rows[:, RIGHT], -rows[:, DOWN])
        axis.quiver(*arrows, color=COLOURS[0], width=0.003, **scale)
        axis.set(title=f"{cameras[k]['name']}: median {typical:.3f} px", xlabel="x, mm", ylabel="y, mm", aspect="equal")
    return Plot("calibration-residuals", finish_picture(picture))


def draw_histogram(field: Floats) -> Plot:
    """Draw histograms of the residuals' x and y components."""
    picture, axes = make_axes(1, 2)
    used = field[field[:, KEPT] > 0]
    for axis, column, label in zip(axes[0], (RIGHT, DOWN), ("residual to the right", "residual down"), strict=True):
        axis.hist(used[:, column], bins=60, color=COLOURS[0])
        axis.set(xlabel=f"{label}, panel pixels", ylabel="lenslets")
    return Plot("calibration-histogram", finish_picture(picture))


def draw_views(nominal: Display, display: Display, eye: Eye) -> Plot:
    """Draw an eye's view of rings before calibration, after it, and on an ideal display."""
    window = whole_window(display, min(640, display.panel.width_px))
    picture, axes = make_axes(1, 3, (4.0, 3.2))
    views = {"before": (nominal, display), "after": (display, display), "ideal": (nominal, nominal)}
    lights = {
        name: observe(rings(described), through, eye, window, samples=64).radiance
        for name, (described, through) in views.items()
    }
    for axis, (name, light) in zip(axes[0], lights.items(), strict=True):
        axis.imshow(np.clip(light, 0.0, 1.0) ** (1.0 / 2.2))
        title = name if name == "ideal" else f"{name}: {psnr_db(light, lights['ideal']):.1f} dB"
        axis.set(title=title, xticks=[], yticks=[])
    return Plot("calibration-views", finish_picture(picture))


def digits(number: float, half: float) -> str:
    """Format a number, rounded at the second digit of its uncertainty `half`."""
    places = max(0, 1 - math.floor(math.log10(half))) if half > 0.0 else 6
    return f"{round(number, places) + 0.0:.{places}f}"


def calibration_page(origin: Mapping[str, str], calibration: Calibration, eye_mm: Point3 | None = None) -> Page:
    """Return a calibration's report page; by default, the eye is at the first camera position."""
    summary, nominal, display = calibration.summary(), calibration.nominal, calibration.display
    place = tuple(summary["cameras"][0]["place_mm"]) if eye_mm is None else eye_mm
    views_plot = draw_views(nominal, display, Eye((place[0], place[1], place[2])))
    rows = []
    for one in summary["parameters"]:
        half = one["uncertainty"]
        numbers = {name: one[name] for name in ("value", "nominal", "uncertainty")}
        numbers["change"] = one["value"] - one["nominal"]
        rows.append({**one, **{name: digits(number, half) for name, number in numbers.items()}})
    cameras = []
    for one in summary["cameras"]:
        sides = zip(one["place_mm"], one["uncertainty_mm"], strict=True)
        cameras.append({**one, "place": ", ".join(f"{digits(x, half)} +- {digits(half, half)}" for x, half in sides)})
    field = calibration.field
    plots = [views_plot, draw_residuals(field, summary["cameras"]), draw_histogram(field)]
    tables = {"calibration-residuals": [dict(zip(FIELD, map(float, row), strict=True)) for row in field]}
    context = {"summary": summary, "display": display, "eye": place, "rows": rows, "cameras": cameras}
    return Page("calibration", origin, plots, tables, context)

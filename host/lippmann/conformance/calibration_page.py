"""The page of `lippmann calibrate report`."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from lippmann.base.tones import psnr_db
from lippmann.calibration.check import rings
from lippmann.calibration.result import Calibration
from lippmann.conformance.figures import Rows
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import COLOURS, Plot, finish_picture, make_axes
from lippmann.display.description import Display
from lippmann.eye.observer import Eye, observe, whole_window

#: Columns of the field of residuals (`calibration.result.Calibration.field`).
FIELD = ("position", "i", "j", "x_mm", "y_mm", "right_px", "down_px", "kept")
POSITION, _, _, X, Y, RIGHT, DOWN, KEPT = range(len(FIELD))
#: Most arrows in a plot of a position.
MOST_ARROWS = 600
#: Samples of a view's pixel.
SAMPLES = 64
Floats = npt.NDArray[np.float64]


def draw_residuals(field: Floats, cameras: Rows) -> Plot:
    """Draw the residuals of the panel points over the array, one picture for each position."""
    picture, axes = make_axes(1, max(1, len(cameras)))
    rng = np.random.default_rng(1)
    for axis, k in zip(axes[0], range(len(cameras)), strict=False):
        rows = field[(field[:, POSITION] == k) & (field[:, KEPT] > 0)]
        rows = rows[np.sort(rng.permutation(len(rows))[:MOST_ARROWS])]
        typical = max(1e-3, float(np.median(np.hypot(rows[:, RIGHT], rows[:, DOWN]))) if len(rows) else 1.0)
        span = max(1e-6, float(np.ptp(rows[:, X])) if len(rows) else 1.0)
        axis.quiver(
            rows[:, X],
            rows[:, Y],
            rows[:, RIGHT],
            -rows[:, DOWN],
            color=COLOURS[0],
            angles="xy",
            scale_units="xy",
            scale=40.0 * typical / span,
            width=0.003,
        )
        axis.set(title=f"{cameras[k]['name']}: median {typical:.3f} px", xlabel="x, mm", ylabel="y, mm", aspect="equal")
    return Plot("calibration-residuals", finish_picture(picture))


def draw_histogram(field: Floats) -> Plot:
    """Draw how the residuals of the panel points are distributed."""
    picture, axes = make_axes(1, 2)
    used = field[field[:, KEPT] > 0]
    for axis, column, label in zip(axes[0], (RIGHT, DOWN), ("residual to the right", "residual down"), strict=True):
        axis.hist(used[:, column], bins=60, color=COLOURS[0])
        axis.set(xlabel=f"{label}, panel pixels", ylabel="lenslets")
    return Plot("calibration-histogram", finish_picture(picture))


def draw_views(nominal: Display, display: Display, eye: Eye) -> Plot:
    """Draw what an eye sees of the rings: made for the nominal file, for the calibrated one, and on a perfect display.

    The first two are seen through the calibrated array; their titles give the decibels against the last.
    """
    window = whole_window(display, min(640, display.panel.width_px))
    picture, axes = make_axes(1, 3, (4.0, 3.2))
    views = {"before": (nominal, display), "after": (display, display), "ideal": (nominal, nominal)}
    lights = {
        name: observe(rings(described), through, eye, window, SAMPLES).radiance
        for name, (described, through) in views.items()
    }
    for axis, (name, light) in zip(axes[0], lights.items(), strict=True):
        axis.imshow(np.clip(light, 0.0, 1.0) ** (1.0 / 2.2))
        title = name if name == "ideal" else f"{name}: {psnr_db(light, lights['ideal']):.1f} dB"
        axis.set(title=title, xticks=[], yticks=[])
    return Plot("calibration-views", finish_picture(picture))


def digits(number: float, half: float) -> str:
    """Return a number with the digits that its uncertainty has, two of which it tells; 0 has no sign."""
    places = max(0, 1 - math.floor(math.log10(half))) if half > 0.0 else 6
    return f"{round(number, places) + 0.0:.{places}f}"


def calibration_page(
    origin: Mapping[str, str], found: Calibration, eye_mm: tuple[float, float, float] | None = None
) -> Page:
    """Return the page of a calibration; the eye is the first camera's place, unless it is given."""
    summary = found.summary()
    place = tuple(summary["cameras"][0]["place_mm"]) if eye_mm is None else eye_mm
    views_plot = draw_views(found.nominal, found.display, Eye((place[0], place[1], place[2])))
    rows = []
    for one in summary["parameters"]:
        half = one["uncertainty"]
        numbers = {"value": one["value"], "nominal": one["nominal"], "change": one["value"] - one["nominal"]}
        texts = {name: digits(number, half) for name, number in numbers.items()}
        rows.append({**one, **texts, "uncertainty": digits(half, half)})
    cameras = []
    for one in summary["cameras"]:
        sides = zip(one["place_mm"], one["uncertainty_mm"], strict=True)
        cameras.append({**one, "place": ", ".join(f"{digits(x, half)} +- {digits(half, half)}" for x, half in sides)})
    table = [dict(zip(FIELD, map(float, row), strict=True)) for row in found.field]
    described = {"summary": summary, "display": found.display, "nominal": found.nominal, "eye": place}
    plots = [views_plot, draw_residuals(found.field, summary["cameras"]), draw_histogram(found.field)]
    context = {**described, "rows": rows, "cameras": cameras}
    return Page("calibration", origin, plots, {"calibration-residuals": table}, context)

"""Repeats the founding paper's benchmark (figure 9) with Lippmann and POV-Ray on the same files (`tools.bench seed`).

The benchmark shows t_R = t_SR / T (paper, equation 6) against the number of lenslets in the window: a picture's time
over the same program's time for the base scene (720 x 720 pixels, 2 lights, 2 stems, anti-aliased with threshold 0.3,
no optics). Times are CPU seconds of all threads: POV-Ray's include parsing, Lippmann's exclude loading and compiling.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from lippmann.capturing.capture import capture_source
from lippmann.capturing.capture_setup import Setup, load_setup
from lippmann.capturing.povray_export import POVRAY, write_folder
from lippmann.capturing.povray_optics import setup_view
from lippmann.cli.frame import option
from lippmann.conformance.figures import Rows, groups, values, where
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import MARKS, Plot, finish_picture, make_axes
from lippmann.display.description import MM_PER_INCH, Display
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import Rendered, render_rays
from lippmann.rendering.sampling import RaySource, Window, eye_source
from lippmann.scenes.placement import placement_beside
from lippmann.scenes.scene import Scene, load_scene

from tools.bench import MeasurementRun, measurement
from tools.povray_runs import Run, export_view, render_folder
from tools.renderer_speed import with_pitch
from tools.report_plots import make_page

#: Set-ups of the sweep, keyed by grid; the array is displaced 6 cm towards the imaging lens (paper, figure 8 a).
SETUPS = {"square": "fig8a", "hex": "hex"}
#: Lippmann's samples per pixel, for no more noise than POV-Ray's anti-aliasing with threshold 0.3 (4 suffice in
#: `bench peers`). Each picture without anti-aliasing is rendered `ROUNDS` times; the fastest render counts.
SAMPLES, ROUNDS = 8, 2
ANTIALIAS = ("+WT2", "+A0.3")
EYE_MM = (0.0, 0.0, 600.0)


class Sweep(NamedTuple):
    """The sizes of the benchmark: windows (px at 600 dpi), lenslet pitches (mm) and grids."""

    windows_px: tuple[int, ...] = (720, 1200, 1800, 2400, 3600)
    pitches_mm: tuple[float, ...] = (1.0, 2.0, 4.0, 9.0)
    grids: tuple[str, ...] = tuple(SETUPS)
    #: Largest window that Lippmann renders with anti-aliasing, and largest window that POV-Ray renders, px.
    antialiased_px: int = 2400
    povray_px: int = 720
    #: Side of the base scene's picture, px.
    base_px: int = 720


#: The sizes with `--quick`, for tests. Such small windows give no valid figures: start-up takes most of the time.
QUICK = Sweep((48,), (1.0,), ("square",), povray_px=48, base_px=96)


def with_window(setup: Setup, width_px: int, pitch_mm: float) -> Setup:
    """Return the set-up with `width_px` x `width_px` pixels of unchanged pitch, behind lenslets scaled to a pitch."""
    panel = dataclasses.replace(setup.display.panel, width_px=width_px, height_px=width_px)
    display = dataclasses.replace(setup.display, panel=panel, array=with_pitch(setup.display.array, pitch_mm))
    return dataclasses.replace(setup, display=display, array=with_pitch(setup.array, pitch_mm))


def lenslets_in(display: Display) -> int:
    """Return the number of lenslets of a window: ceil(25.4 w / (p D))^2 for w px, D dpi (paper, equation 5)."""
    array, panel = display.array, display.panel
    dpi_x, dpi_y = (MM_PER_INCH / pitch for pitch in panel.pitches_mm)
    across = math.ceil(MM_PER_INCH * panel.width_px / (array.pitches_mm[0] * dpi_x) - 1e-9)
    down = math.ceil(MM_PER_INCH * panel.height_px / (array.row_pitch_mm * dpi_y) - 1e-9)
    return across * down


def load_for(path: Path, setup: Setup) -> Scene:
    """Load a scene, and place it in front of a set-up's lens."""
    return load_scene(path, placement_beside(path).then(setup.subject.placement))


def fastest(scene: Scene, source: RaySource, samples: int, rounds: int = 1) -> Rendered:
    """Render `rounds` times, and return the render with the shortest CPU time."""
    renders = (render_rays(scene, source, Settings(samples=samples)) for _ in range(rounds))
    return min(renders, key=lambda rendered: rendered.cpu_seconds)


def bench_seed(scenes: Path, work: Path, sweep: Sweep) -> Iterator[dict[str, Any]]:
    """Yield rows of Lippmann's and POV-Ray's times, first for the base scene; files are written into `work`."""
    # Measure the times T of the base scene through the window of the paper's display, 2400 px at 600 dpi.
    side_mm = 2400 * MM_PER_INCH / 600.0
    window = Window(side_mm, side_mm, sweep.base_px, sweep.base_px)
    scene = load_scene(scenes / "seed/base.xml")
    ours = fastest(scene, eye_source(EYE_MM, window), SAMPLES)
    _, theirs = render_folder(export_view(scene, EYE_MM, window, work / "base"), *ANTIALIAS)
    base: dict[str, Rendered | Run] = {"lippmann": ours, "POV-Ray": theirs}
    cpu_seconds = {tracer: run.cpu_seconds for tracer, run in base.items()}
    for tracer, run in base.items():
        yield _row(tracer, sweep.base_px, None, True, run, cpu_seconds)
    for width, grid, pitch in itertools.product(sweep.windows_px, sweep.grids, sweep.pitches_mm):
        setup = with_window(load_setup(scenes / f"setups/{SETUPS[grid]}.toml"), width, pitch)
        scene = load_for(scenes / "seed/full.xml", setup)
        # Anti-aliasing takes several times as long, so only the smallest and the largest pitch have it.
        looks = (False, True) if pitch in (min(sweep.pitches_mm), max(sweep.pitches_mm)) else (False,)
        for antialias in looks if width <= sweep.antialiased_px else (False,):
            samples, rounds = (SAMPLES, 1) if antialias else (1, ROUNDS)
            rendered = fastest(scene, capture_source(setup), samples, rounds)
            yield _row("lippmann", width, setup.display, antialias, rendered, cpu_seconds)
        if width <= sweep.povray_px:
            exported = write_folder(scene, setup_view(setup), work / f"{grid}-{width}-{pitch:g}")
            for antialias in looks:
                _, run = render_folder(exported, *(ANTIALIAS if antialias else ()))
                yield _row("POV-Ray", width, setup.display, antialias, run, cpu_seconds)


def _row(
    tracer: str,
    width_px: int,
    display: Display | None,
    antialias: bool,
    run: Rendered | Run,
    base: Mapping[str, float],
) -> dict[str, Any]:
    """Return the row of a square picture (`display` None: of the base scene); `relative` is t_R."""
    array, lenslets = (None, 0) if display is None else (display.array, lenslets_in(display))
    row = {"tracer": tracer, "grid": "none" if array is None else array.grid, "window_px": width_px}
    row |= {"pitch_mm": None if array is None else array.pitches_mm[0], "lenslets": lenslets, "antialias": antialias}
    times = {"seconds": run.seconds, "cpu_seconds": run.cpu_seconds}
    return {**row, **times, "relative": run.cpu_seconds / base[tracer]}


def findings(rows: Rows) -> dict[str, Any]:
    """Return ratios of CPU times in the sweep, for Lippmann and, with the prefix `povray_`, for POV-Ray.

    `growth`, keyed by window (px), is the slowest pitch's time divided by the fastest pitch's, for square arrays
    without anti-aliasing. `hex_share` is the median of hexagonal arrays' times divided by square arrays' times, minus
    1. `plain_share` is the median of times without anti-aliasing divided by times with it, minus 1. A ratio is None if
    no pair was measured.
    """
    keys = ("tracer", "grid", "window_px", "pitch_mm", "antialias")
    times = {tuple(row[key] for key in keys): row["cpu_seconds"] for row in rows}

    def share(tracer: str, **changed: Any) -> float | None:
        """Return the median ratio, minus 1, of rows' times to those of rows that differ only in `changed`."""
        pairs = [[tuple(one[key] for key in keys) for one in (row, {**row, **changed})] for row in rows]
        pairs = [pair for pair in pairs if pair[0][0] == tracer]
        shares = [times[one] / times[other] - 1.0 for one, other in pairs if one != other and other in times]
        return float(np.median(shares)) if shares else None

    ratios: dict[str, Any] = {}
    for prefix, tracer in (("", "lippmann"), ("povray_", "POV-Ray")):
        plain = groups(where(rows, tracer=tracer, grid="square", antialias=False), "window_px")
        seconds = {some[0]["window_px"]: values(some, "cpu_seconds") for some in plain}
        ratios[f"{prefix}growth"] = {window: max(some) / min(some) for window, some in seconds.items()}
        ratios[f"{prefix}hex_share"] = share(tracer, grid="square")
        ratios[f"{prefix}plain_share"] = share(tracer, antialias=True)
    return ratios


def plot(rows: Rows) -> Plot:
    """Draw t_R against the number of lenslets for each window and program; hexagonal arrays have dashed lines."""
    picture, axes = make_axes(1, 2, (5.5, 4.5))
    windows = sorted({row["window_px"] for row in rows if row["grid"] != "none"})
    for axis, antialias in zip(axes[0], (False, True), strict=True):
        for tracer, window, grid in itertools.product(("lippmann", "POV-Ray"), windows, SETUPS):
            some = where(rows, tracer=tracer, window_px=window, grid=grid, antialias=antialias)
            curve = sorted((row["lenslets"], row["relative"]) for row in some)
            if curve:
                style = f"{MARKS[tracer != 'lippmann']}{'-' if grid == 'square' else '--'}"
                colour = "black" if tracer == "POV-Ray" else f"C{windows.index(window)}"
                label = f"{tracer}, {window} px" if grid == "square" else None
                axis.plot(*zip(*curve, strict=True), style, color=colour, label=label)
        axis.set(xscale="log", yscale="log", xlabel="lenslets in the window", ylabel="relative time t_R")
        axis.set_title("anti-aliasing" if antialias else "no anti-aliasing")
        axis.legend(fontsize=7)
    return Plot("seed", finish_picture(picture))


def page(origin: Mapping[str, str], rows: Rows, trial: bool = False) -> Page:
    """Return the page; `trial` adds a note that the windows are too small for valid figures."""
    ratios = findings(rows)
    ours, theirs = where(rows, grid="none")
    windows = sorted(ratios["growth"])
    growth = {"window, px": windows, "lippmann": [ratios["growth"][window] for window in windows]}
    growth["POV-Ray"] = [ratios["povray_growth"].get(window) for window in windows]
    context = {"found": ratios, "ours": ours, "theirs": theirs, "growth": growth, "trial": trial, "samples": SAMPLES}
    return make_page("seed", origin, [plot(rows)], {"seed": rows}, context)


@measurement(page="seed")
def seed(
    bench: MeasurementRun,
    quick: bool = option("Use tiny windows, for a trial; the figures are not valid.", False),
) -> tuple[Mapping[str, Any], Page]:
    """Repeat the founding paper's benchmark with Lippmann and with POV-Ray.

    Example: python -m tools.bench seed --quick
    """
    POVRAY.path()
    with TemporaryDirectory() as work:
        rows = bench.collect(bench_seed(bench.scenes, Path(work), QUICK if quick else Sweep()))
    return {"rows": rows, "findings": findings(rows)}, page(bench.origin, rows, quick)

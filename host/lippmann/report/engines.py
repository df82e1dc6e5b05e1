"""Models and engines: rays a second against the error of the rays, and of what the eye sees."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.conditioning.digits import TrueRays, exact_array, size, true_rays
from lippmann.display import Display, load_display
from lippmann.engines import trace
from lippmann.fixed.build import Build
from lippmann.fixed.conversion import aims_of_words, words_of_aims
from lippmann.fixed.words import WIDEST
from lippmann.images import psnr_db
from lippmann.measure.rtl import Simulation
from lippmann.measure.trace import fast_launch
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.rays import ENGINES, MODELS, Engine, Model, Rays, gets_through
from lippmann.optics.sampling import square_to_cell
from lippmann.rendering.sources import APERTURES, Aperture
from lippmann.report.figures import Figures, Measured, in_turn
from lippmann.report.plan import Plan
from lippmann.report.plots import COLOURS, MARKS, drawn, finish, legend
from lippmann.report.section import Plot, Section, Shown, column
from lippmann.report.views import EYE_MM, Stage
from lippmann.select.model import crossing
from lippmann.variant import current_device

Row = dict[str, Any]
Floats = npt.NDArray[np.float64]
#: The errors of rays, of which `errors` tells the largest and the root mean square; what else they are is named here.
ERRORS = ("max_urad", "rms_urad", "max_nm", "rms_nm", "max_mm", "rms_mm")


def errors(truth: Rays | TrueRays, rays: Rays, depths_mm: tuple[float, float]) -> dict[str, float]:
    """Return how far rays lie from the true ones of the same pixels, over those that leave by the same lenslet in both.

    Parameters
    ----------
    truth
        Of another engine or model, or in 50 digits.
    rays
        To be judged.
    depths_mm
        Two planes z, of which each ray's farther error counts.

    Returns
    -------
    dict
        `max_` and `rms_` of `urad`, between the directions; `nm`, where they cross the plane of the lenslets' vertices;
        `mm`, at the depths; and `other_fates`, rays of another status or lenslet.
    """
    same = (truth.status == rays.status) & (truth.lenslet == rays.lenslet).all(axis=1)
    same |= ~gets_through(truth.status) & ~gets_through(rays.status)
    alive = same & gets_through(rays.status)
    exact = isinstance(truth, TrueRays)
    true_local, true_way = truth.local_mm[alive], truth.direction[alive]
    local, way = rays.local_mm[alive], rays.direction[alive]
    if exact:
        local, way = exact_array(local), exact_array(way)

    def apart(z_mm: float) -> Floats:
        return _lengths(crossing(true_local, true_way, z_mm) - crossing(local, way, z_mm))

    found = {
        "urad": 1e6 * _lengths(true_way - way),
        "nm": 1e6 * apart(0.0),
        "mm": np.maximum(*(apart(z) for z in depths_mm)),
    }
    worst = {f"max_{unit}": float(values.max(initial=0.0)) for unit, values in found.items()}
    rms = {f"rms_{unit}": math.sqrt(float((values**2).sum()) / max(len(values), 1)) for unit, values in found.items()}
    return {**worst, **rms, "other_fates": float((~same).sum())}


def _lengths(vectors: Any) -> Floats:
    if vectors.dtype == object:
        return size(vectors)
    lengths: Floats = np.linalg.norm(vectors, axis=1)
    return lengths


@dataclass(frozen=True)
class Sample:
    """Rays of a display that every engine can take as they are.

    `pixels` (N, 2), centres of random ones; `aperture` (N, 2), points of the lenslet's cell as the twin's words hold
    them, mm, or None for chief rays.
    """

    display: Display
    pixels: Floats
    aperture: Floats | None

    @classmethod
    def of(cls, display: Display, aperture: str, count: int, seed: int) -> Sample:
        """Draw some."""
        panel, array = display.panel, display.array
        random = np.random.default_rng(seed)
        pixels = np.float64(0.5) + random.integers((0, 0), (panel.width_px, panel.height_px), (count, 2))
        if aperture == "chief":
            return cls(display, pixels, None)
        s, t = random.uniform(0.0, 1.0, (2, count))
        points = np.stack(square_to_cell(NumpyBackend(), s, t, array.grid, array.pitch_mm), axis=1)
        words = words_of_aims(display, points, WIDEST)
        return cls(display, pixels, aims_of_words(display, *words, WIDEST))

    def first(self, count: int) -> Sample:
        """Return the first ones."""
        return Sample(self.display, self.pixels[:count], None if self.aperture is None else self.aperture[:count])

    def traced(self, model: Model, engine: Engine = "golden", device: str = "llvm") -> Rays:
        """Trace them."""
        return trace(self.display, self.pixels, self.aperture, model, engine, device)

    def digits(self, model: Model) -> TrueRays:
        """Trace them in 50 digits."""
        return true_rays(self.display, self.pixels, self.aperture, model)


def measure(scenes: Path, plan: Plan, seed: int, log: Callable[[str], None]) -> Figures:
    """Measure every model by every engine on the plan's displays."""
    rows: list[Row] = []
    for name in plan.displays:
        display = load_display(scenes / f"displays/{name}.toml")
        log(f"engines: {display.name} ...")
        stage = Stage.of(scenes, display, plan.panel_px, seed)
        views = _views(stage, _engines(plan, "chief"))
        for aperture in APERTURES:
            rows += _measure_rays(display, aperture, stage.scene.depth_range_mm, views, plan, seed)
    return Figures("report-engines", ("display", "grid", "rays", "model", "engine"), rows)


def _engines(plan: Plan, aperture: Aperture) -> list[Engine]:
    """Return the engines that are measured; the RTL with aims is no further build, the twin stands for it."""
    return [engine for engine in ENGINES if engine != "rtl" or (plan.simulate and aperture == "chief")]


def _views(stage: Stage, engines: list[Engine]) -> dict[tuple[Model, Engine], tuple[float, float]]:
    """Return the PSNR of each view against golden's exact one, and against the scene itself."""
    views = {(model, engine): stage.seen(stage.integral(model, engine)) for model in MODELS for engine in engines}
    direct = stage.direct()
    true = views["exact", "golden"]
    return {key: (psnr_db(view, true), psnr_db(view, direct)) for key, view in views.items()}


def _measure_rays(
    display: Display,
    aperture: Aperture,
    depths_mm: tuple[float, float],
    views: Mapping[tuple[Model, Engine], tuple[float, float]],
    plan: Plan,
    seed: int,
) -> list[Row]:
    engines = _engines(plan, aperture)
    sample = Sample.of(display, aperture, plan.rays, seed)
    some = sample.first(plan.digits_rays)
    rates = _rates(sample.first(plan.timed_rays), aperture, engines, plan, seed)
    exact = sample.traced("exact")
    rows = []
    for model in MODELS:
        golden = sample.traced(model)
        for engine in engines:
            rays = golden if engine == "golden" else sample.traced(model, engine, current_device())
            own = (
                errors(some.digits(model), some.traced(model), depths_mm)
                if engine == "golden"
                else errors(golden, rays, depths_mm)
            )
            whole = own if (model, engine) == ("exact", "golden") else errors(exact, rays, depths_mm)
            view, direct = views[model, engine] if aperture == "chief" else (math.inf, math.inf)
            per_second = rates[model, engine]
            rows.append(
                {
                    "display": display.name,
                    "grid": display.array.grid,
                    "rays": aperture,
                    "model": model,
                    "engine": engine,
                    "rays_per_second": Measured.of(per_second),
                    "relative": Measured.of(a / b for a, b in zip(per_second, rates["exact", "golden"], strict=True)),
                    **{key: Measured(value) for key, value in whole.items()},
                    **{f"own_{key}": Measured(own[key]) for key in ERRORS},
                    "view_db": _finite(view),
                    "direct_db": _finite(direct),
                }
            )
    return rows


def _finite(value: float) -> Measured | None:
    return Measured(value) if math.isfinite(value) else None


def _rates(
    sample: Sample, aperture: Aperture, engines: list[Engine], plan: Plan, seed: int
) -> dict[tuple[Model, Engine], list[float]]:
    """Return the rays a second of each model and engine in each round."""
    display, count = sample.display, len(sample.pixels)

    def work(model: Model, engine: Engine) -> Callable[[], float]:
        if engine == "fast":
            launch, number = fast_launch(display, model, aperture, plan.fast_rays), itertools.count(1)
            return lambda: plan.fast_rays / launch(next(number))
        if engine == "rtl":
            build = replace(Build.of(display, model, WIDEST, aims=False), cross_cells=True)
            simulation = Simulation.of(display, build, seed, count, model)
            return lambda: count / simulation.rtl()[1]

        def arrays() -> float:
            started = time.perf_counter()
            sample.traced(model, engine)
            return count / (time.perf_counter() - started)

        return arrays

    return in_turn({(model, engine): work(model, engine) for model in MODELS for engine in engines}, plan.rounds)


def section(data: Figures) -> Section:
    """Return the section."""
    tables = []
    for display, aperture in dict.fromkeys((str(row["display"]), str(row["rays"])) for row in data.rows):
        rows = [row for row in data.rows if (row["display"], row["rays"]) == (display, aperture)]
        kind = {"chief": "chief rays", "full": "rays over the full aperture"}[aperture]
        views = {
            "view, dB": column(rows, "view_db"),
            "view against the scene, dB": column(rows, "direct_db"),
        }
        tables.append(
            Shown(
                f"{display}, {kind}: rays a second and errors, by model and engine",
                {
                    "model": column(rows, "model"),
                    "engine": column(rows, "engine"),
                    "M rays/s": column(rows, "rays_per_second", 1e6),
                    "of golden exact": column(rows, "relative"),
                    "direction max, urad": column(rows, "max_urad"),
                    "rms": column(rows, "rms_urad"),
                    "exit max, nm": column(rows, "max_nm"),
                    "exit rms": column(rows, "rms_nm"),
                    "in the scene max, mm": column(rows, "max_mm"),
                    "scene rms": column(rows, "rms_mm"),
                    "other fates": column(rows, "other_fates"),
                    "engine alone max, urad": column(rows, "own_max_urad"),
                    "alone max, nm": column(rows, "own_max_nm"),
                    **(views if aperture == "chief" else {}),
                },
            )
        )
    eye = ", ".join(f"{x:g}" for x in EYE_MM)
    return Section(
        "Models and engines",
        (
            "Rays of random pixels by every engine and lens model: chief rays, and rays to random points of the whole "
            "lenslet. Errors are those against the exact model by "
            "golden, model and engine together; `engine alone` is against golden of the same model, of golden itself "
            "against the same formulas in 50 digits (fewer rays). `exit` is where the ray crosses the plane of the "
            "lenslets' vertices, `in the scene` the farther of its errors at the fish's nearest and farthest depth; "
            "`other fates` counts rays of another status or lenslet, which have no such distance.",
            f"`view` is the PSNR of what an eye at ({eye}) mm sees through exact lenslets, of the fish rendered for "
            "the middle of the display by this model and engine, one ray a pixel, against the same by golden and the "
            "exact model; `against the scene` holds it to the scene seen directly: there the array's own sampling "
            "costs the decibels. A dash: the reference itself, or every value alike.",
            "Rates count one ray in, one ray out: of golden and twin with the turning of numbers into words and back, "
            "of fast with every output used, on all cores; of the RTL the simulation, by its one thread's processor "
            f"time (the hardware's are in the next section). Twin and RTL have F = {WIDEST}. Over the full aperture "
            "the twin stands for the RTL, whose words are the same. `of golden exact` is the ratio within a round.",
        ),
        tables,
        [_plot(data)],
        [data],
    )


def _plot(data: Figures) -> Plot:
    kinds = (
        ("chief", "max_mm", "chief rays: largest error in the scene, mm", "log"),
        ("full", "max_mm", "full aperture: largest error in the scene, mm", "log"),
        ("chief", "view_db", "the eye's view, dB", "linear"),
    )
    # The first display of each grid.
    shown = {row["grid"]: row["display"] for row in reversed(data.rows)}
    picture, axes = drawn(len(kinds), len(shown))
    for across, display in enumerate(reversed(shown.values())):
        for axis, (aperture, key, label, scale) in zip(axes[:, across], kinds, strict=True):
            for row in data.rows:
                if (row["display"], row["rays"]) == (display, aperture) and (value := row[key]) is not None:
                    mark = MARKS[ENGINES.index(row["engine"])]
                    colour = COLOURS[MODELS.index(row["model"])]
                    axis.plot(row["rays_per_second"].median, value.median, mark, color=colour)
            axis.set(xscale="log", yscale=scale, xlabel="rays/s", ylabel=label, title=display)
    legend(axes[0][0], dict(zip(ENGINES, MARKS, strict=False)), dict(zip(MODELS, COLOURS, strict=False)))
    return Plot(
        "report-engines",
        finish(picture),
        "Speed against error: engines by the form of their marks, models by colour. Below, what the eye sees.",
        "Scatter plots of rays a second against the largest error in the scene, of chief rays and over the full "
        "aperture, and against the PSNR of the eye's view, for every model and engine. The tables below have the "
        "values.",
    )

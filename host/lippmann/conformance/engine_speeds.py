"""Rays a second of every engine and lens model, and the error of their rays and of the eye's view of their pictures."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.base.tones import psnr_db
from lippmann.base.variant import current_device, mitsuba
from lippmann.conformance.fifty_digits import exact_array, size, true_rays
from lippmann.conformance.figures import Figures, Measured, in_turn
from lippmann.conformance.hard_cases import Out
from lippmann.conformance.ray_search import random_aims
from lippmann.conformance.report_plan import Plan
from lippmann.conformance.simulation_speed import Simulation
from lippmann.conformance.test_pictures import Pictures
from lippmann.display.description import Display, load_display
from lippmann.fixed.build import Build
from lippmann.fixed.conversion import aims_of_words, words_of_aims
from lippmann.fixed.words import WIDEST
from lippmann.optics.backend import DrJitBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.model_choice import crossing
from lippmann.optics.rays import ENGINES, MODELS, Engine, Floats, Model, Rays, gets_through
from lippmann.optics.sampling import points_in_square, square_to_cell
from lippmann.optics.system import System
from lippmann.optics.trace import rays_from_pixels
from lippmann.rendering.sources import APERTURES, Aperture

#: The largest and root mean square errors that `errors` returns.
ERRORS = ("max_urad", "rms_urad", "max_nm", "rms_nm", "max_mm", "rms_mm")
#: What `tools.bench trace` measures.
TRACE_PLAN = Plan(displays=("paper-square", "paper-hex", "uhd-8k"), timed_rays=200_000, digits_rays=0)
TRACED: tuple[tuple[Model, Aperture], ...] = (*((model, "chief") for model in MODELS), ("exact", "full"))


def errors(truth: Rays, rays: Rays, depths_mm: tuple[float, float]) -> dict[str, float]:
    """Return how far rays lie from the true ones of the same pixels. Rays of another fate are only counted.

    `max_` and `rms_` are of `urad`, the angle between the directions; of `nm`, the distance where they cross the plane
    of the lenslets' vertices; of `mm`, the distance at two depths z, of each ray the larger. `other_fates` counts the
    rays whose status or lenslet differs.
    """
    same = (truth.status == rays.status) & (truth.lenslet == rays.lenslet).all(axis=1)
    same |= ~gets_through(truth.status) & ~gets_through(rays.status)
    alive = same & gets_through(rays.status)
    true_local, true_way = truth.local_mm[alive], truth.direction[alive]
    local, way = rays.local_mm[alive], rays.direction[alive]
    if true_way.dtype == object:
        local, way = exact_array(local), exact_array(way)

    def lengths(vectors: Any) -> Floats:
        return size(vectors) if vectors.dtype == object else np.asarray(np.linalg.norm(vectors, axis=1))

    def apart(z_mm: float) -> Floats:
        return lengths(crossing(true_local, true_way, z_mm) - crossing(local, way, z_mm))

    found = {
        "urad": 1e6 * lengths(true_way - way),
        "nm": 1e6 * apart(0.0),
        "mm": np.maximum(*(apart(z) for z in depths_mm)),
    }
    most = {f"max_{unit}": float(values.max(initial=0.0)) for unit, values in found.items()}
    rms = {f"rms_{unit}": math.sqrt(float((values**2).sum()) / max(len(values), 1)) for unit, values in found.items()}
    return {**most, **rms, "other_fates": float((~same).sum())}


def random_rays(display: Display, aperture: Aperture, count: int, seed: int) -> Out:
    """Return rays that every engine takes as they are, from the centres of random pixels.

    They are chief rays, or aim at points of the lenslet's cell that are words of the widest twin.
    """
    panel, random = display.panel, np.random.default_rng(seed)
    pixels = np.float64(0.5) + random.integers((0, 0), (panel.width_px, panel.height_px), (count, 2))
    if aperture == "chief":
        return Out("sample", display, pixels, None)
    words = words_of_aims(display, random_aims(display, random, count), WIDEST)
    return Out("sample", display, pixels, aims_of_words(display, *words, WIDEST))


def fast_rate(display: Display, model: Model, aperture: Aperture, rays: int) -> Callable[[], float]:
    """Return a function that traces rays with the fast engine, other ones at each call, and returns the rays/s.

    Every output is used, as by a renderer: all are summed in the same program, so that no memory traffic is timed. The
    first launch, which compiles the program, is done before this returns.
    """
    mi = mitsuba()
    import drjit as dr

    b = DrJitBackend(current_device())
    system = System.of(display)
    panel = display.panel
    numbers = itertools.count()

    def launch() -> float:
        started = time.perf_counter()
        index = dr.arange(mi.UInt32, rays) + dr.opaque(mi.UInt32, next(numbers))
        row = index // panel.width_px
        u = b.double(index - row * panel.width_px) + 0.5
        v = b.double(row % panel.height_px) + 0.5
        points = None
        if aperture == "full":
            s, t = points_in_square(index, mi.UInt32(0), 0)
            points = square_to_cell(b, s, t, Lattice.of(display.array))
        out = rays_from_pixels(b, system, u, v, points, model)
        value = mi.Float(out.centre_x + out.centre_y) + sum(out.ray[1:], out.ray[0])
        dr.eval(dr.sum(dr.select(gets_through(out.status), mi.Float(value), 0.0)))
        dr.sync_thread()
        return rays / (time.perf_counter() - started)

    launch()
    return launch


def rates_of(
    sample: Out, aperture: Aperture, models: Sequence[Model], engines: Sequence[Engine], plan: Plan, seed: int
) -> dict[tuple[Model, Engine], list[float]]:
    """Return the rays/s of each model and engine in each round."""
    display, count = sample.display, len(sample.pixels)

    def rate(model: Model, engine: Engine) -> Callable[[], float]:
        if engine == "fast":
            return fast_rate(display, model, aperture, plan.fast_rays)
        if engine == "rtl":
            build = replace(Build.of(display, model, WIDEST, aims=False), cross_cells=True)
            return Simulation(display, build, seed, count, model).rtl_rate

        rays = replace(sample, model=model)

        def arrays() -> float:
            started = time.perf_counter()
            rays.traced(engine)
            return count / (time.perf_counter() - started)

        return arrays

    return in_turn({key: rate(*key) for key in itertools.product(models, engines)}, plan.rounds)


def measure_rays(
    display: Display,
    aperture: Aperture,
    depths_mm: tuple[float, float],
    models: Sequence[Model],
    engines: Sequence[Engine],
    plan: Plan,
    seed: int,
) -> list[dict[str, Any]]:
    """Return a row for each model and engine: its rates, its errors against golden with the exact model, and its own.

    The own errors, `own_...`, are those against golden with the same model; golden's own are against 50 digits.
    """
    sample = random_rays(display, aperture, plan.rays, seed)
    rates = rates_of(sample.some(slice(plan.timed_rays)), aperture, models, engines, plan, seed)
    exact = sample.traced()
    rows = []
    for model in models:
        sample = replace(sample, model=model)
        golden, some = sample.traced(), sample.some(slice(plan.digits_rays))
        for engine in engines:
            rays = golden if engine == "golden" else sample.traced(engine, current_device())
            if engine == "golden":
                own = errors(true_rays(some), some.traced(), depths_mm) if plan.digits_rays else {}
            else:
                own = errors(golden, rays, depths_mm)
            whole = own if own and (model, engine) == ("exact", "golden") else errors(exact, rays, depths_mm)
            relative = (a / b for a, b in zip(rates[model, engine], rates[models[-1], "golden"], strict=True))
            rows.append(
                {
                    "display": display.name,
                    "grid": display.array.grid,
                    "rays": aperture,
                    "model": model,
                    "engine": engine,
                    "rays_per_second": Measured.of(rates[model, engine]),
                    "relative": Measured.of(relative),
                    **{key: Measured(value) for key, value in whole.items()},
                    **{f"own_{key}": Measured(value) for key, value in own.items()},
                }
            )
    return rows


def measure_all(scenes: Path, plan: Plan, seed: int, log: Callable[[str], None]) -> Figures:
    """Measure every model with every engine on the plan's displays."""
    rows = []
    for name in plan.displays:
        display = load_display(scenes / f"displays/{name}.toml")
        log(f"engines: {display.name} ...")
        pictures = Pictures.of(scenes, display, plan, seed)
        for aperture in APERTURES:
            # With aims the RTL would need further builds. The twin gives the same words.
            engines = [e for e in ENGINES if e != "rtl" or (plan.simulate and aperture == "chief")]
            views = _views(pictures, engines) if aperture == "chief" else {}
            for row in measure_rays(display, aperture, pictures.scene.depth_range_mm, MODELS, engines, plan, seed):
                del row["own_other_fates"]
                view, direct = views.get((row["model"], row["engine"]), (math.inf, math.inf))
                rows.append({**row, "view_db": Measured.finite(view), "direct_db": Measured.finite(direct)})
    return Figures("report-engines", ("display", "grid", "rays", "model", "engine"), rows)


def _views(pictures: Pictures, engines: Sequence[Engine]) -> dict[tuple[Model, Engine], tuple[float, float]]:
    """Return the PSNR of each view against the view by golden and the exact model, and against the scene itself."""
    views = {(m, e): pictures.seen(pictures.integral(m, e)) for m in MODELS for e in engines}
    true, direct = views["exact", "golden"], pictures.direct()
    return {key: (psnr_db(view, true), psnr_db(view, direct)) for key, view in views.items()}


def measure(scenes: Path, seed: int, plan: Plan = TRACE_PLAN) -> Iterator[dict[str, Any]]:
    """Measure golden and fast on some displays: all models with chief rays, `exact` over the full aperture too.

    Rates are in rays/s. The errors are those of fast against golden: microradian, and nm at the exit; `status_differs`
    counts the rays, of those `compared`, that have another fate and so no such error.
    """
    for name in plan.displays:
        display = load_display(scenes / f"displays/{name}.toml")
        for model, aperture in TRACED:
            golden, fast = measure_rays(display, aperture, (0.0, 0.0), [model], ["golden", "fast"], plan, seed)
            yield {
                "display": display.name,
                "grid": display.array.grid,
                "model": model,
                "aperture": aperture,
                "golden_rays_per_second": golden["rays_per_second"].median,
                "fast_rays_per_second": fast["rays_per_second"].median,
                "max_direction_urad": fast["own_max_urad"].median,
                "rms_direction_urad": fast["own_rms_urad"].median,
                "max_origin_nm": fast["own_max_nm"].median,
                "status_differs": int(fast["own_other_fates"].median),
                "compared": plan.rays,
            }

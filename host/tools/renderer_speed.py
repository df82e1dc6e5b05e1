"""Measures the renderer's noise, growth with size, stages and rate (`tools.bench render`, `tools.bench stages`)."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from lippmann.base.images import Radiance
from lippmann.base.tones import encode, psnr_db
from lippmann.base.variant import current_device, mitsuba
from lippmann.conformance.engine_report import in_turn, logger, middle
from lippmann.conformance.figures import Figures, Measured, groups, values
from lippmann.conformance.plots import COLOURS, Plot, finish_picture, make_axes
from lippmann.display.description import Array, Display, display_text, load_display
from lippmann.errors import LippmannError
from lippmann.rendering.lights import coherence_hint
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import make_integrator, render_integral
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Scene, load_scene

from tools.report_plots import draw_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tools.full_report import Plan

#: A function that returns its duration in seconds.
Work = Callable[[], float]
#: The result of an integrator's method `sample`: light, validity, further values.
Light = tuple[Any, Any, list[Any]]

INTEGRATORS = ("lights", "direct", "path")
REFERENCE = "path"
#: Number of triangles in scenes with varied lights; number of lights in scenes with varied triangles.
TRIANGLES, LIGHTS = 20_000, 2
#: Number of rounds of timings; distance, mm, of a perspective camera whose field of view covers the display.
ROUNDS, CAMERA_MM = 3, 600.0
#: Pairs of a display and samples per pixel: renders in a separate process; stages on a CPU, and on a GPU.
SEPARATE = (("paper-square", 4), ("paper-hex", 4), ("uhd-4k", 1), ("uhd-8k", 1))
CPU_RENDERS = (("paper-square", 4), ("uhd-4k", 1))
GPU_RENDERS = (*CPU_RENDERS, ("uhd-4k", 16))
#: Integrators, keyed by the last stage that they compute.
STAGES = {"optics": "nothing", "camera": "first_hit", "shading": "unshadowed", "shadows": "lights"}
#: Keys of a render's JSON: the times of the process in order, and the results that `tools.bench render` reports.
PROCESS = ("start_seconds", "load_seconds", "prepare_seconds", "seconds", "write_seconds")
RENDER_KEYS = ("seconds", "prepare_seconds", "samples_per_second", "peak_memory_mb")


def gpu_name() -> str:
    """Return the GPUs' names from nvidia-smi, or "" if it is missing."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return ""
    query = [program, "--query-gpu=name", "--format=csv,noheader"]
    run = subprocess.run(query, check=False, capture_output=True, text=True, errors="replace")
    return ", ".join(run.stdout.split("\n")[:-1]) if run.returncode == 0 else ""


def timed(scene: Scene, display: Display, settings: Settings, pictures: list[Radiance] | None = None) -> Work:
    """Return a function that renders a picture with a new seed, appends it to `pictures`, and returns seconds."""
    seeds = itertools.count(settings.seed)

    def render() -> float:
        rendered = render_integral(scene, display, "exact", replace(settings, seed=next(seeds) % 2**32))
        if pictures is not None:
            pictures.append(rendered.radiance)
        return rendered.seconds

    return render


def noise_levels(one: Radiance, other: Radiance) -> float:
    """Return a pixel's noise (standard deviation, 8-bit sRGB levels) from two renders with different seeds."""
    apart = 255.0 * (encode(one, "srgb").astype(np.float64) - encode(other, "srgb"))
    return float(np.sqrt((apart**2).mean() / 2.0))


def measure_noise(scenes: Path, plan: Plan, seed: int) -> Figures:
    """Measure each integrator's noise for each number of samples, with a new seed in each round."""
    logger.info("renderer: noise ...")
    scene = load_scene(scenes / f"{plan.scene}/{plan.scene}.xml")
    display = middle(load_display(scenes / "displays/paper-square.toml"), plan.noise_px)
    settings = Settings(samples=plan.reference_samples, integrator=REFERENCE, seed=seed)
    reference = render_integral(scene, display, "exact", settings).radiance
    runs = list(itertools.product(INTEGRATORS, plan.noise_samples))
    pictures: dict[tuple[str, int], list[Radiance]] = {run: [] for run in runs}
    works = {}
    for run in runs:
        settings = Settings(run[1], integrator=run[0], seed=seed + 1)
        works[run] = timed(scene, display, settings, pictures[run])
    times = in_turn(works, plan.rounds)
    rows = []
    for run in runs:
        noise = Measured.of(noise_levels(*pair) for pair in itertools.pairwise(pictures[run]))
        psnr = Measured.of(psnr_db(picture, reference) for picture in pictures[run])
        row = {"integrator": run[0], "samples": run[1], "seconds": Measured.of(times[run])}
        rows.append({**row, "noise": noise, "psnr_db": psnr})
    return Figures("report-renderer", ("integrator", "samples"), rows)


def resized(display: Display, across: int) -> Display:
    """Return the display with `across` pixel columns on a panel of unchanged width, mm."""
    return replace(display, panel=display.panel.with_columns(across))


def with_pitch(array: Array, pitch_mm: float) -> Array:
    """Return the array with its lenslets scaled to another pitch."""
    factor = pitch_mm / array.pitches_mm[0]
    radius_mm, thickness_mm = array.radius_mm * factor, array.thickness_mm * factor
    return replace(array, pitch_mm=array.pitch_of(pitch_mm), radius_mm=radius_mm, thickness_mm=thickness_mm)


def with_lenslets_across(display: Display, across: int) -> Display:
    """Return the display with lenslets scaled so that `across` of them span the unchanged width, mm."""
    array = with_pitch(display.array, display.panel.width_mm / (across - 0.4))
    return replace(display, array=array, gap_mm=display.gap_mm * array.pitches_mm[0] / display.array.pitches_mm[0])


def waves(triangles: int, lights: int) -> Scene:
    """Return a scene: a wavy sheet of about `triangles`, 160 mm wide, under point lights of constant total power."""
    mi = mitsuba()
    side = max(1, round(np.sqrt(triangles / 2)))
    steps = np.linspace(-80.0, 80.0, side + 1)
    x, y = (g.ravel() for g in np.meshgrid(steps, steps))
    z = -30.0 + 8.0 * np.sin(0.3 * x) * np.cos(0.2 * y)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    right, up = corner + 1, corner + side + 1
    faces = np.concatenate([np.stack([corner, right, up], axis=1), np.stack([right, up + 1, up], axis=1)])
    mesh = mi.Mesh("waves", vertex_count=len(x), face_count=len(faces))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(np.stack([x, y, z], axis=1).astype(np.float32).ravel())
    parameters["faces"] = mi.UInt32(faces.astype(np.uint32).ravel())
    parameters.update()
    lamps = {
        f"light{k}": {
            "type": "point",
            "position": [200.0 * np.cos(angle), 200.0 * np.sin(angle), 300.0],
            "intensity": {"type": "rgb", "value": 1e5 / lights},
        }
        for k, angle in enumerate(2.0 * np.pi * np.arange(lights) / lights)
    }
    scene = mi.load_dict({"type": "scene", "mesh": mesh, **lamps})
    return Scene(Path("waves"), scene, Placement(near_mm=0.0, far_mm=-50.0))


def measure_growth(scenes: Path, plan: Plan, seed: int) -> Figures:
    """Time renders for each kind of growing size; renders of one kind are timed in turn."""
    path = scenes / f"{plan.scene}/{plan.scene}.xml"
    scene, display = load_scene(path), load_display(scenes / "displays/paper-square.toml")
    small = resized(display, plan.growth_px)
    device = current_device()

    def lenslets(across: int) -> int:
        array = with_lenslets_across(small, across).array
        return round(small.panel.width_mm * small.panel.height_mm / (array.pitches_mm[0] * array.row_pitch_mm))

    panels = [resized(display, across) for across in plan.pixels_across]
    cores = len(os.sched_getaffinity(0)) if device == "llvm" else 0
    threads = sorted({min(2**k, cores) for k in range(cores.bit_length() + 1)} - {0})
    one = Settings(seed=seed, shading="each")
    works: dict[str, dict[int, Work]] = {
        "pixels": {_pixels(panel): timed(scene, panel, one) for panel in panels},
        "lenslets": {lenslets(n): timed(scene, with_lenslets_across(small, n), one) for n in plan.lenslets_across},
        "triangles": {n: timed(waves(n, LIGHTS), small, one) for n in plan.triangles},
        "lights": {n: timed(waves(TRIANGLES, n), small, one) for n in plan.lights},
        "threads": {n: _with_threads(n, timed(scene, small, replace(one, samples=4))) for n in threads},
        "samples": {n: timed(scene, small, replace(one, samples=n)) for n in plan.samples},
    }
    rows = []
    for name, sizes in works.items():
        logger.info("growth: %s ...", name)
        times = in_turn(sizes, plan.rounds)
        memory = _memory(device, path, panels, plan.memory_rounds) if name == "pixels" else {}
        first = next(iter(times.values()), [])
        for size, seconds in times.items():
            relative = Measured.of(a / b for a, b in zip(seconds, first, strict=True))
            row = {"with": name, "size": size, "seconds": Measured.of(seconds)}
            rows.append({**row, "relative": relative, "memory_mb": memory.get(size)})
    return Figures("report-growth", ("with", "size"), rows)


def exponent(sizes: Sequence[float], values: Sequence[float]) -> float | None:
    """Return the exponent of growth with size, from a fit to logarithms, or None for a single size."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0]) if len(sizes) > 1 else None


def powers_of(growth: Figures) -> dict[str, float]:
    """Return the exponents of growth of the render time, keyed by kind of size."""
    kinds = groups(growth.rows, "with")
    powers = {rows[0]["with"]: exponent(values(rows, "size"), values(rows, "relative")) for rows in kinds}
    return {name: power for name, power in powers.items() if power is not None}


def _pixels(display: Display) -> int:
    return display.panel.width_px * display.panel.height_px


def _with_threads(count: int, work: Work) -> Work:
    import drjit as dr

    def limited() -> float:
        before = dr.thread_count()
        dr.set_thread_count(count)
        try:
            return work()
        finally:
            dr.set_thread_count(before)

    return limited


def _memory(device: str, scene: Path, displays: Sequence[Display], rounds: int) -> dict[int, Measured]:
    """Return the peak memory (MB) of renders in separate processes, two at once, keyed by number of pixels."""

    def peak(display: Display) -> float:
        with TemporaryDirectory() as folder:
            file = Path(folder) / "display.toml"
            file.write_text(display_text(display), encoding="utf-8")
            return float(separately(device, scene, file, 1)["peak_memory_mb"])

    with ThreadPoolExecutor(2) as pool:
        peaks = {display: [pool.submit(peak, display) for _ in range(rounds)] for display in displays}
    return {_pixels(display): Measured.of(one.result() for one in runs) for display, runs in peaks.items()}


def separately(
    device: str, scene: Path, display: Path, samples: int, keys: Sequence[str] = RENDER_KEYS
) -> dict[str, Any]:
    """Render (exact model) in a new process; return results named by `keys`; raise LippmannError on failure."""
    with TemporaryDirectory() as folder:
        words = ["render", str(scene), "--display", str(display), "--model", "exact", "--samples", str(samples)]
        words += ["--device", device, "-o", f"{folder}/out.exr", "--json"]
        command = [sys.executable, "-P", "-m", "lippmann", *words]
        run = subprocess.run(command, check=False, capture_output=True, text=True)
    if run.returncode:
        message = run.stderr.strip().splitlines()[-1:]
        raise LippmannError(f"{scene} for {display}: rendering in a separate process failed: {message}")
    return {key: json.loads(run.stdout)[key] for key in keys}


def compared(**works: Work) -> tuple[dict[str, float], list[float]]:
    """Time two functions in turn; return both median times, and each round's ratio of the first to the second."""
    times = in_turn(works, ROUNDS)
    ratios = [a / b for a, b in zip(*times.values(), strict=True)]
    return {name: float(np.median(seconds)) for name, seconds in times.items()}, ratios


def lenslet_growth(scene: Scene, display: Display, settings: Settings) -> dict[str, float]:
    """Time renders of a display with its lenslets (102 x 102 on paper-square), and with 11 x 11 lenslets."""
    seconds, ratios = compared(
        seconds_10404_lenslets=timed(scene, display, settings),
        seconds_121_lenslets=timed(scene, with_lenslets_across(display, 11), settings),
    )
    return {**seconds, "ratio": float(np.median(ratios)), "ratio_least": min(ratios), "ratio_most": max(ratios)}


def against_perspective(scene: Scene, display: Display, settings: Settings) -> dict[str, float]:
    """Time an integral render against Mitsuba's perspective sensor, with equal settings and numbers of pixels."""
    mi = mitsuba()
    import drjit as dr

    panel = display.panel
    size = {"width": panel.width_px, "height": panel.height_px}
    sensor = mi.load_dict(
        {
            "type": "perspective",
            "fov": float(2.0 * np.degrees(np.arctan2(0.5 * panel.width_mm, CAMERA_MM))),
            "to_world": mi.ScalarTransform4f().look_at([0, 0, CAMERA_MM], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", **size, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent"},
        }
    )
    own, seeds = make_integrator(scene, settings), itertools.count(settings.seed)

    def plain() -> float:
        started = time.perf_counter()
        dr.eval(mi.render(scene.mitsuba, sensor=sensor, integrator=own, spp=settings.samples, seed=next(seeds)))
        dr.sync_thread()
        return time.perf_counter() - started

    plain()  # compiles the program
    seconds, ratios = compared(perspective_seconds=plain, integral_seconds=timed(scene, display, settings))
    return {**seconds, "rate_ratio": float(np.median(ratios))}


def measure(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of `tools.bench render`. Each round has a different seed."""
    for name, samples in SEPARATE:
        path = scenes / f"displays/{name}.toml"
        row = separately(current_device(), scenes / "fish/fish.xml", path, samples)
        yield {"what": _label(name, samples), **row}
    display = load_display(scenes / "displays/paper-square.toml")
    settings = {name: Settings(samples=4, integrator=name, seed=seed, shading="each") for name in INTEGRATORS[::-1]}
    for name in ("fish", "chart", "knot"):
        scene = load_scene(scenes / f"{name}/{name}.xml")
        for integrator in ("depth", "path", "lights"):
            row = lenslet_growth(scene, display, replace(settings["path"], integrator=integrator))
            yield {"what": f"10,404 lenslets against 121, {name}, {integrator}, 4 samples", **row}
        for integrator, own in settings.items():
            row = against_perspective(scene, display, own)
            yield {"what": f"against Mitsuba's perspective, {name}, {integrator}, 4 samples", **row}


def _label(display: str, samples: int) -> str:
    return f"fish, {display}, exact, {samples} sample{'s' if samples > 1 else ''}"


def register_stages() -> None:
    """Register integrators that stop early: after the optics, after the primary rays' hits, or before shadow rays."""
    mi = mitsuba()
    import drjit as dr

    base: Any = mi.SamplingIntegrator

    class Nothing(base):  # type: ignore[misc]
        def sample(self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True) -> Light:
            # Use every part of the ray in the result, so that the compiler removes no optics.
            return mi.Spectrum(ray.d.x + ray.d.y + ray.d.z + ray.o.x + ray.o.y), active, []

    class FirstHit(base):  # type: ignore[misc]
        def sample(self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True) -> Light:
            hit = scene.ray_intersect_preliminary(ray, coherent=coherence_hint(mi.UInt32(0)), active=active)
            return mi.Spectrum(dr.select(hit.is_valid(), hit.t + hit.prim_uv.x, 0.0)), active, []

    class Unshadowed(base):  # type: ignore[misc]
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            depth = props.get("max_depth", 4)
            self.lights = mi.load_dict({"type": "lights", "max_depth": depth, "shadows": False})

        def sample(self, *arguments: Any) -> Light:
            light: Light = self.lights.sample(*arguments)
            return light

    for name, one in (("nothing", Nothing), ("first_hit", FirstHit), ("unshadowed", Unshadowed)):
        mi.register_integrator(name, one)


def stages(scene: Scene, display: Display, settings: Settings) -> dict[str, float]:
    """Time renders that stop after each of `STAGES`, in turn, after compilation; `shared` uses the irradiance cache."""
    register_stages()
    each = replace(settings, shading="each")
    works = {stage: timed(scene, display, replace(each, integrator=integrator)) for stage, integrator in STAGES.items()}
    works["shared"] = timed(scene, display, replace(settings, shading="shared"))
    seconds = {stage: float(np.median(times)) for stage, times in in_turn(works, ROUNDS).items()}
    pixels = display.panel.width_px * display.panel.height_px * settings.samples
    columns = {f"{stage}_seconds": value for stage, value in seconds.items()}
    return {**columns, "pixels_per_second": pixels / seconds["camera"]}


def measure_stages(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of `tools.bench stages`."""
    device, fish = current_device(), scenes / "fish/fish.xml"
    scene = load_scene(fish)
    for name, samples in GPU_RENDERS if device == "cuda" else CPU_RENDERS:
        path = scenes / f"displays/{name}.toml"
        within = stages(scene, load_display(path), Settings(samples=samples, seed=seed))
        process = separately(device, fish, path, samples, PROCESS)
        gpu = gpu_name() if device == "cuda" else ""
        yield {"what": _label(name, samples), "gpu": gpu, **within, **process}


#: Axis labels of the varied sizes, where they differ from the name in the column `with`.
GROWTH = {"triangles": "primitives (triangles)", "samples": "samples a pixel"}


def draw_renderer(data: Figures) -> Plot:
    """Draw noise and PSNR against the render time."""
    picture, axes = make_axes(1, 2)
    for axis, key in zip(axes[0], ("noise", "psnr_db"), strict=True):
        # A picture without noise has no position on a logarithmic axis.
        draw_lines(axis, [row for row in data.rows if row[key].median > 0.0], "integrator", "seconds", key)
    axes[0][0].set(xscale="log", yscale="log", xlabel="seconds", ylabel="noise, levels of 255")
    axes[0][1].set(xscale="log", xlabel="seconds", ylabel=f"PSNR against {REFERENCE}, dB")
    return Plot("report-renderer", finish_picture(picture))


def draw_growth(data: Figures) -> Plot:
    """Draw render time against each size, and peak memory against the number of pixels."""
    picture, axes = make_axes(2, 4, (3.2, 2.8))
    free = iter(axes.ravel())
    for rows in groups(data.rows, "with"):
        axis, name = next(free), str(rows[0]["with"])
        sizes, times = values(rows, "size"), np.array(values(rows, "seconds"))
        relative = np.array(sizes) / sizes[0]
        ideal = times[0] * (1.0 / relative if name == "threads" else relative)
        axis.plot(sizes, times, "o-", color=COLOURS[0])
        axis.plot(sizes, ideal, "--", color="grey", linewidth=1)
        middle = float(np.exp(np.log(times).mean()))
        # Let the axis span at least a decade, so that noise does not look like growth.
        limits = (min(0.7 * times.min(), middle / 3.2), max(1.4 * times.max(), middle * 3.2))
        axis.set(xscale="log", yscale="log", ylabel="seconds", ylim=limits)
        _mark_sizes(axis, sizes, GROWTH.get(name, name))
    memory = next(free)
    rows = [row for row in data.rows if row["memory_mb"] is not None]
    memory.plot(values(rows, "size"), values(rows, "memory_mb"), "s-", color=COLOURS[1])
    memory.set(xscale="log", ylabel="peak memory, MB", ylim=(0.0, None))
    _mark_sizes(memory, values(rows, "size"), "pixels")
    for axis in free:
        axis.remove()
    return Plot("report-growth", finish_picture(picture))


def _mark_sizes(axis: Axes, sizes: Sequence[float], label: str) -> None:
    axis.set_xlabel(label)
    axis.set_xticks(sizes, [size_label(size) for size in sizes], fontsize=8)
    axis.set_xticks([], minor=True)


def size_label(size: float) -> str:
    """Return a size with three digits and a unit prefix such as k, so that labels do not overlap."""
    from matplotlib.ticker import EngFormatter

    return str(EngFormatter(sep="")(float(f"{size:.3g}")))

"""Growth of the renderer's time with pixels, lenslets, primitives, lights, threads, samples; of memory with pixels."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from lippmann.display import Display, display_text, load_display
from lippmann.measure.render import separately, with_lenslets_across
from lippmann.rendering.placement import Placement
from lippmann.rendering.renderer import Settings, render_integral
from lippmann.rendering.scene import Scene, load_scene
from lippmann.report.figures import Figures, Measured, Row, in_turn
from lippmann.report.plan import Plan
from lippmann.report.plots import COLOURS, drawn, finish
from lippmann.report.section import Plot, Section, Shown, column
from lippmann.variant import current_device, mitsuba

#: Triangles of the scene whose lights grow in number, and lights of the one whose triangles do.
TRIANGLES, LIGHTS = 20_000, 2
#: What grows, as the plots call it.
AXES = {
    "pixels": "pixels",
    "lenslets": "lenslets",
    "triangles": "primitives (triangles)",
    "lights": "lights",
    "threads": "threads",
    "samples": "samples a pixel",
}


def resized(display: Display, across: int) -> Display:
    """Return the display with so many pixels across the same window."""
    panel = display.panel
    factor = across / panel.width_px
    height = round(panel.height_px * factor)
    return replace(
        display,
        panel=replace(panel, width_px=across, height_px=height, pixel_pitch_mm=panel.pixel_pitch_mm / factor),
    )


def waves(triangles: int, lights: int) -> Scene:
    """Return a scene of a wavy sheet behind the display, of about so many triangles, under some point lights.

    The sheet, 160 mm wide, fills what any eye sees; the lights stand on a circle and share the same power.
    """
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
    turn = 2.0 * np.pi * np.arange(lights) / lights
    lamps = {
        f"light{k}": {
            "type": "point",
            "position": [200.0 * np.cos(angle), 200.0 * np.sin(angle), 300.0],
            "intensity": {"type": "rgb", "value": 1e5 / lights},
        }
        for k, angle in enumerate(turn)
    }
    scene = mi.load_dict({"type": "scene", "mesh": mesh, **lamps})
    return Scene(Path("waves"), scene, Placement(near_mm=0.0, far_mm=-50.0))


def measure(scenes: Path, plan: Plan, seed: int, log: Callable[[str], None]) -> Figures:
    """Time renders of growing size, each row of sizes in turn."""
    fish = load_scene(scenes / "fish/fish.xml")
    display = load_display(scenes / "displays/paper-square.toml")
    small = resized(display, plan.growth_px)

    def timed(scene: Scene, display: Display, samples: int = 1) -> Callable[[], float]:
        settings = Settings(samples=samples, seed=seed)
        return lambda: render_integral(scene, display, "exact", settings).seconds

    def lenslets(across: int) -> int:
        array = with_lenslets_across(small, across).array
        return round(small.panel.width_mm * small.panel.height_mm / (array.pitch_mm * array.row_pitch_mm))

    works: dict[str, dict[int, Callable[[], float]]] = {
        "pixels": {
            other.panel.width_px * other.panel.height_px: timed(fish, other)
            for other in (resized(display, across) for across in plan.pixels_across)
        },
        "lenslets": {lenslets(n): timed(fish, with_lenslets_across(small, n)) for n in plan.lenslets_across},
        "triangles": {n: timed(waves(n, LIGHTS), small) for n in plan.triangles},
        "lights": {n: timed(waves(TRIANGLES, n), small) for n in plan.lights},
        "threads": {n: _with_threads(n, timed(fish, small, 4)) for n in _threads(current_device())},
        "samples": {n: timed(fish, small, n) for n in plan.samples},
    }
    rows: list[Row] = []
    for name, sizes in works.items():
        log(f"growth: {name} ...")
        times = in_turn(sizes, plan.rounds)
        memory = _memory(current_device(), scenes, display, plan) if name == "pixels" else {}
        first = next(iter(times.values()), [])
        rows += [
            {
                "with": name,
                "size": size,
                "seconds": Measured.of(seconds),
                "relative": Measured.of(a / b for a, b in zip(seconds, first, strict=True)),
                "memory_mb": memory.get(size),
            }
            for size, seconds in times.items()
        ]
    return Figures("report-growth", ("with", "size"), rows)


def _threads(device: str) -> Sequence[int]:
    """Return the numbers of threads to try, 1 to those of the machine in doublings; none on a GPU."""
    cores = len(os.sched_getaffinity(0))
    return sorted({min(2**k, cores) for k in range(cores.bit_length() + 1)}) if device == "llvm" else []


def _with_threads(count: int, work: Callable[[], float]) -> Callable[[], float]:
    """Return work that is done by so many threads."""
    import drjit as dr

    def limited() -> float:
        before = dr.thread_count()
        dr.set_thread_count(count)
        try:
            return work()
        finally:
            dr.set_thread_count(before)

    return limited


def _memory(device: str, scenes: Path, display: Display, plan: Plan) -> dict[int, Measured]:
    """Return the peak memory, MB, of renders by number of pixels, each in a process of its own."""
    found = {}
    with TemporaryDirectory() as folder:
        file = Path(folder) / "display.toml"
        for across in plan.pixels_across:
            other = resized(display, across)
            file.write_text(display_text(other))
            peaks = [
                separately(device, scenes / "fish/fish.xml", file, 1, "exact")["peak_memory_mb"]
                for _ in range(plan.memory_rounds)
            ]
            found[other.panel.width_px * other.panel.height_px] = Measured.of(peaks)
    return found


def exponent(sizes: Sequence[float], values: Sequence[float]) -> float | None:
    """Return the power of the size that values grow with, the slope of the line through their logarithms.

    None where there are not two sizes.
    """
    if len(sizes) < 2:
        return None
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def section(data: Figures, plan: Plan) -> Section:
    """Return the section."""
    names = list(dict.fromkeys(str(row["with"]) for row in data.rows))
    powers = {}
    for name in names:
        some = [row for row in data.rows if row["with"] == name]
        powers[name] = exponent(column(some, "size"), column(some, "relative"))
    rows = data.rows
    return Section(
        "Growth",
        (
            f"Renders of the fish on paper-square, {plan.growth_px} pixels across its window, one sample a pixel, save "
            "for what grows: pixels at the same window; lenslets of the same shape, smaller and more; triangles of a "
            f"wavy sheet under {LIGHTS} lights, and lights above one of {TRIANGLES} triangles; threads with 4 samples "
            "a pixel. `relative` is the ratio to the first of its kind within a round. Seconds are those of the "
            "render itself; memory is the peak of a process that renders and writes the picture.",
            "The power of the size that the time grows with, by a straight line through the logarithms: "
            + ", ".join(f"{name} {power:.2f}" for name, power in powers.items() if power is not None)
            + ". A power of 1 is growth in proportion; of threads it is below 0, at best -1.",
        ),
        (
            Shown(
                "Time and memory of renders by their size",
                {
                    "with": column(rows, "with"),
                    "size": column(rows, "size"),
                    "seconds": column(rows, "seconds"),
                    "relative": column(rows, "relative"),
                    "memory, MB": column(rows, "memory_mb"),
                },
            ),
        ),
        (_plot(data),),
        (data,),
    )


def _plot(data: Figures) -> Plot:
    picture, axes = drawn(2, 4, (3.2, 2.8))
    *timed, memory, spare = axes.ravel()
    for axis, (name, label) in zip(timed, AXES.items(), strict=True):
        rows = [row for row in data.rows if row["with"] == name]
        if not rows:  # threads, on a GPU
            axis.remove()
            continue
        sizes, times = column(rows, "size"), column(rows, "seconds")
        power = -1.0 if name == "threads" else 1.0
        axis.plot(sizes, times, "o-", color=COLOURS[0])
        axis.plot(sizes, [times[0] * (size / sizes[0]) ** power for size in sizes], "--", color="grey", linewidth=1)
        middle = float(np.exp(np.log(times).mean()))
        # A decade at least, so that noise does not look like growth.
        limits = (min(0.7 * min(times), middle / 3.2), max(1.4 * max(times), middle * 3.2))
        axis.set(xscale="log", yscale="log", ylabel="seconds", ylim=limits)
        _mark_sizes(axis, sizes, label)
    rows = [row for row in data.rows if row["memory_mb"] is not None]
    sizes = column(rows, "size")
    memory.plot(sizes, column(rows, "memory_mb"), "s-", color=COLOURS[1])
    memory.set(xscale="log", ylabel="peak memory, MB", ylim=(0.0, None))
    _mark_sizes(memory, sizes, "pixels")
    spare.remove()
    return Plot(
        "report-growth",
        finish(picture),
        "How time grows with what is rendered and with what it is rendered by, and memory with the pixels. Dashed: "
        "growth in proportion (of threads, time shared out in full).",
        "Line plots of seconds over pixels, lenslets, primitives, lights, threads and samples a pixel, each beside a "
        "line of growth in proportion, and of peak memory over pixels. The table below has the values.",
    )


def _mark_sizes(axis: Any, sizes: Sequence[int], label: str) -> None:
    """Mark the sizes that were measured, and no others."""
    axis.set_xlabel(label)
    axis.set_xticks(sizes, [size_label(size) for size in sizes], fontsize=8)
    axis.set_xticks([], minor=True)


def size_label(size: int) -> str:
    """Return a size in three digits and with a prefix, so that it stays clear of its neighbours."""
    from matplotlib.ticker import EngFormatter

    return str(EngFormatter(sep="")(float(f"{size:.3g}")))

"""Measures the rates of golden and fast (`tools.bench trace`), and of simulated RTL and twin (`tools.bench rtl`)."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from lippmann import load_layers
from lippmann.board.board import QUERY_S
from lippmann.board.drawn_scene import SceneBoard
from lippmann.board.virtual_loop import capturing
from lippmann.conformance.engine_report import Plan, measure_rays, rtl_rate, timed, words_of_chief_rays
from lippmann.display.description import Display, load_display
from lippmann.fixed.build import Build
from lippmann.fixed.drawn_frame import draw
from lippmann.fixed.scene_build import CURVE_SLOT, SceneBuild
from lippmann.fixed.scene_configuration import build_curve_table, slot_bytes
from lippmann.fixed.words import COMPACT, WIDEST
from lippmann.layers.stack import LayerStack
from lippmann.optics.rays import MODELS, Model
from lippmann.rendering.sampling import Aperture
from lippmann.simulation.harness import ray_harness, rtl_pipeline, rtl_scene
from lippmann.simulation.virtual_board import board_build

#: The plan of `tools.bench trace`, and its models and apertures.
TRACE_PLAN = Plan(displays=("paper-square", "paper-hex", "uhd-8k"), timed_rays=200_000, digits_rays=0)
TRACED: tuple[tuple[Model, Aperture], ...] = (*((model, "chief") for model in MODELS), ("exact", "full"))
#: Columns of fast's errors, each with its column of `measure_rays`.
ERRORS = {"max_direction_urad": "own_max_urad", "rms_direction_urad": "own_rms_urad", "max_origin_nm": "own_max_nm"}
#: `tools.bench rtl`: rays per run, runs per build (the fastest counts), frames that the board draws.
RAYS, RUNS, FRAMES = 1_000_000, 3, 10
#: Display of the board that draws; larger display for drawing without a board, where textures load quickly.
BOARD_DISPLAY, DISPLAY = "vga-square", "paper-square"


def measure_trace(scenes: Path, seed: int, plan: Plan = TRACE_PLAN) -> Iterator[dict[str, Any]]:
    """Yield rows with the rates of golden and fast on the plan's displays, and fast's errors over `compared` rays."""
    for display in plan.load_displays(scenes):
        for model, aperture in TRACED:
            golden, fast = measure_rays(display, aperture, (0.0, 0.0), [model], ["golden", "fast"], plan, seed)
            rates = {"golden_rays_per_second": golden["rays_per_second"].median}
            rates["fast_rays_per_second"] = fast["rays_per_second"].median
            errors = {name: fast[own].median for name, own in ERRORS.items()}
            keys = {"display": display.name, "grid": display.array.grid, "model": model, "aperture": aperture}
            others = int(fast["own_other_fates"].median)
            yield {**keys, **rates, **errors, "status_differs": others, "compared": plan.rays}


def measure_rtl(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the rates of exact builds (two word lengths, cross terms in logic or in multipliers), then of drawing."""
    for name in ("paper-square", "paper-hex"):
        display = load_display(scenes / f"displays/{name}.toml")
        for bits, cells in itertools.product((WIDEST, COMPACT), (False, True)):
            case = words_of_chief_rays(display, Build(bits, display.array.grid, cross_cells=cells), seed, RAYS)
            row = {"display": display.name, "build": f"F {bits}, cross terms in {'cells' if cells else 'logic'}"}
            rates = {"rtl_rays_per_second": max(rtl_rate(case)() for _ in range(RUNS))}
            rates["twin_rays_per_second"] = timed(RAYS, case.trace)()
            differ = case.count_differences(lambda *inputs: ray_harness(inputs[5]).trace(*inputs[:5]))
            yield {**row, **rates, "words_differ": differ, "rays": RAYS}
    stack, scene = load_layers(scenes / "layers/chart"), SceneBuild()
    yield board(load_display(scenes / f"displays/{BOARD_DISPLAY}.toml"), stack, scene, FRAMES)
    display = load_display(scenes / f"displays/{DISPLAY}.toml")
    for threads in sorted({1, len(os.sched_getaffinity(0))}):
        yield rendered(display, stack, scene, threads)


def board(display: Display, stack: LayerStack, build: SceneBuild, frames: int) -> dict[str, Any]:
    """Draw frames on a virtual board, compare the last frame with the twin's; return the row."""
    with capturing(display, build) as captured:
        scene = SceneBoard(captured.board)
        textures = {slot: slot_bytes(layer, build).tobytes() for slot, layer in enumerate(stack.layers)}
        scene.load(textures | {CURVE_SLOT: build_curve_table(display).tobytes()})
        scene.prepare(display, stack)
        scene.draw(True)
        first = scene.status().frames
        while scene.status().frames - first < frames:
            time.sleep(QUERY_S)
        captured.board.panel_crc()
    counts = captured.counts
    differ = (captured.frames[-1] != draw(display, board_build(display, build), stack, build)).any(axis=2)
    pixels, times = differ.size * counts["frames"], (counts["seconds"], counts["processor_seconds"])
    return _row(display, "drawing board", 1, pixels, times, counts["clocks"], differ)


def rendered(display: Display, stack: LayerStack, build: SceneBuild, threads: int) -> dict[str, Any]:
    """Draw a panel as `render --engine rtl` does, compare all pixels with the twin's; return the row."""
    optics = Build.of(display, "exact", COMPACT, aims=False)
    drawn = partial(draw, display, optics, stack, build, pipeline=rtl_pipeline, shade=rtl_scene, threads=threads)
    # The first run compiles, and loads the textures.
    drawn()
    started, used = time.perf_counter(), time.process_time()
    picture = drawn()
    times = (time.perf_counter() - started, time.process_time() - used)
    differ = (picture != draw(display, optics, stack, build)).any(axis=2)
    return _row(display, "render --engine rtl", threads, differ.size, times, None, differ)


def _row(
    display: Display, simulated: str, threads: int, pixels: int, times: Sequence[float], clocks: int | None, differ: Any
) -> dict[str, Any]:
    """Return the row of a simulation that drew `pixels` in `times` (wall-clock seconds, CPU seconds)."""
    names = ("pixels_per_second", "pixels_per_processor_second")
    rates = {name: pixels / seconds for name, seconds in zip(names, times, strict=True)}
    row = {"display": display.name, "simulated": simulated, "processors": threads, "pixels": pixels, **rates}
    return {**row, "clocks": clocks, "pixels_differ": int(differ.sum())}

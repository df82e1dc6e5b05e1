"""Pixels a second of the simulated drawing, all captured and compared with the twin (`tools.bench rtl`)."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from lippmann.board.board import QUERY_S
from lippmann.board.drawn_scene import SceneBoard
from lippmann.board.virtual_loop import capturing
from lippmann.display.description import Display, load_display
from lippmann.fixed.build import Build
from lippmann.fixed.drawn_frame import draw
from lippmann.fixed.scene_build import SceneBuild
from lippmann.fixed.words import COMPACT
from lippmann.layers.layers_folder import load_layers
from lippmann.layers.stack import LayerStack
from lippmann.simulation.harness import rtl_pipeline, rtl_scene
from lippmann.simulation.virtual_board import board_build

#: Frames that the board scans out after the scene is shown.
FRAMES = 10
#: The panels: a board's, and for the bare drawing one on which a load of the textures counts little.
BOARD_DISPLAY, DISPLAY = "vga-square", "paper-square"


def measure(scenes: Path) -> Iterator[dict[str, Any]]:
    """Measure the whole board and `render --engine rtl`, both with four layers and the optics of a board."""
    stack, build = load_layers(scenes / "layers/chart"), SceneBuild()
    yield board(load_display(scenes / f"displays/{BOARD_DISPLAY}.toml"), stack, build, FRAMES)
    whole = load_display(scenes / f"displays/{DISPLAY}.toml")
    threads = len(os.sched_getaffinity(0))
    for count in sorted({1, threads}):
        yield rendered(whole, stack, build, count)


def board(display: Display, stack: LayerStack, build: SceneBuild, frames: int) -> dict[str, Any]:
    """Draw on a virtual board until it has scanned out some frames, and compare the last one with the twin's.

    Pixels and clocks are all that the board has scanned out and simulated: from its start, with the loads.
    """
    with capturing(display, build) as captured:
        scene = SceneBoard(captured.board)
        scene.load_curve(display)
        scene.load_stack(stack)
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
    """Draw a panel as `render --engine rtl` does, by some threads, and compare every pixel with the twin's."""
    optics = Build.of(display, "exact", COMPACT, aims=False)
    drawn = partial(draw, display, optics, stack, build, pipeline=rtl_pipeline, shade=rtl_scene, threads=threads)
    drawn()  # compiled, and the textures are loaded
    started, used = time.perf_counter(), time.process_time()
    picture = drawn()
    times = (time.perf_counter() - started, time.process_time() - used)
    differ = (picture != draw(display, optics, stack, build)).any(axis=2)
    return _row(display, "render --engine rtl", threads, differ.size, times, None, differ)


def _row(
    display: Display, simulated: str, threads: int, pixels: int, times: Sequence[float], clocks: int | None, differ: Any
) -> dict[str, Any]:
    """Return the row of so many pixels, simulated in `times`: by the clock on the wall, and of the processors."""
    names = ("pixels_per_second", "pixels_per_processor_second")
    rates = {name: pixels / seconds for name, seconds in zip(names, times, strict=True)}
    row = {"display": display.name, "simulated": simulated, "processors": threads, "pixels": pixels, **rates}
    return {**row, "clocks": clocks, "pixels_differ": int(differ.sum())}

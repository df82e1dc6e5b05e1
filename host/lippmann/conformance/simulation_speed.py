"""Rates of the simulated RTL, with every word compared with the twin (`tools.bench rtl`)."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.conformance import drawing_speed
from lippmann.conformance.engine_errors import words_differ
from lippmann.display.description import Display, load_display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.conversion import words_of_pixels
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.words import COMPACT, WIDEST
from lippmann.optics.rays import Model
from lippmann.simulation.harness import ray_harness

#: Rays of one run, and runs of `bench rtl`, which takes the fastest: other programs only slow a run.
RAYS, RUNS = 1_000_000, 3


class Simulation:
    """Chief rays through random pixel centres, in the words of a build."""

    def __init__(self, display: Display, build: Build, seed: int, rays: int, model: Model = "exact") -> None:
        """Draw the pixels, and compile the build unless it is compiled already."""
        panel = display.panel
        pixels = np.random.default_rng(seed).integers((0, 0), (panel.width_px, panel.height_px), (rays, 2))
        u, v = words_of_pixels(display, pixels.astype(float) + 0.5)
        self.build, self.rays, self.engine = build, rays, ray_harness(build)
        self.inputs = (u, v, np.zeros_like(u), np.zeros_like(v), configuration(display, build, model))

    def rtl_rate(self) -> float:
        """Simulate the RTL; return the rays/s by the processor time of its one thread."""
        started = time.thread_time()
        self.engine.trace(*self.inputs)
        return self.rays / (time.thread_time() - started)

    def twin_rate(self) -> float:
        """Trace with the twin; return the rays/s by wall-clock time."""
        started = time.perf_counter()
        ray_pipeline(*self.inputs, self.build)
        return self.rays / (time.perf_counter() - started)

    def words_differ(self) -> int:
        """Count the words in which RTL and twin differ."""
        return words_differ(self.engine.trace(*self.inputs), ray_pipeline(*self.inputs, self.build))


def measure(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Measure exact builds on the founding paper's displays: two word lengths, cross terms in logic and in cells.

    The drawing follows (`simulated_drawing`).
    """
    for name in ("paper-square", "paper-hex"):
        display = load_display(scenes / f"displays/{name}.toml")
        for bits, cells in itertools.product((WIDEST, COMPACT), (False, True)):
            run = Simulation(display, Build(bits, display.array.grid, cross_cells=cells), seed, RAYS)
            yield {
                "display": display.name,
                "build": f"F {bits}, cross terms in {'cells' if cells else 'logic'}",
                "rtl_rays_per_second": max(run.rtl_rate() for _ in range(RUNS)),
                "twin_rays_per_second": run.twin_rate(),
                "words_differ": run.words_differ(),
                "rays": RAYS,
            }
    yield from drawing_speed.measure(scenes)

"""`lippmann bench rtl`: rays a second of the simulated RTL, every word compared with the twin."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from lippmann.display import Display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.trace import COMPACT, WIDEST, words_of_pixels
from lippmann.sim.harness import harness

#: Rays of one run, and runs, of which the fastest counts: other work on the machine only slows. The clock is the
#: processor time of the one thread that simulates.
RAYS = 1_000_000
RUNS = 3


@dataclass(frozen=True)
class SimulationRate:
    """One row: a display, a build; rays/s through the harness and through the twin, and words that differ.

    The harness's rays are counted by the processor time of its one thread, the twin's by the clock on the wall.
    """

    display: str
    build: str
    rtl_rays_per_second: float
    twin_rays_per_second: float
    words_differ: int
    rays: int


def bench_rtl(displays: list[Display], seed: int) -> list[SimulationRate]:
    """Measure exact builds, widest and compact, cross terms in logic and in cells, on some displays."""
    rows = []
    for display in displays:
        for fraction_bits in (WIDEST, COMPACT):
            for cells in (False, True):
                rows.append(_measure(display, Build(fraction_bits, display.array.grid, cross_cells=cells), seed))
    return rows


def _measure(display: Display, build: Build, seed: int) -> SimulationRate:
    config = configuration(display, build, "exact")
    panel = display.panel
    pixels = (
        np.random.default_rng(seed).integers((0, 0), (panel.width_px, panel.height_px), (RAYS, 2)).astype(np.float64)
        + 0.5
    )
    u, v = words_of_pixels(display, pixels)
    zero = np.zeros_like(u)
    engine = harness(build)  # compiled here, outside the clock
    seconds = []
    for _ in range(RUNS):
        started = time.thread_time()
        rtl = engine.trace(u, v, zero, zero, config)
        seconds.append(time.thread_time() - started)
    started = time.perf_counter()
    twin = ray_pipeline(u, v, zero, zero, config, build)
    twin_seconds = time.perf_counter() - started
    return SimulationRate(
        display=display.name,
        build=f"F {build.fraction_bits}, cross terms in {'cells' if build.cross_cells else 'logic'}",
        rtl_rays_per_second=RAYS / min(seconds),
        twin_rays_per_second=RAYS / twin_seconds,
        words_differ=sum(int((got != wanted).sum()) for got, wanted in zip(rtl, twin, strict=True)),
        rays=RAYS,
    )

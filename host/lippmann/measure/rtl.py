"""`lippmann bench rtl`: rays a second of the simulated RTL, every word compared with the twin."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from lippmann.display import Display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.conversion import words_of_pixels
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.fixed.words import COMPACT, WIDEST, Ints
from lippmann.optics.rays import Model
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


@dataclass(frozen=True)
class Simulation:
    """Chief rays of random pixels' centres, ready for a build: their words (N,), and its registers."""

    build: Build
    config: Configuration
    u: Ints
    v: Ints

    @classmethod
    def of(cls, display: Display, build: Build, seed: int, rays: int = RAYS, model: Model = "exact") -> Simulation:
        """Draw the pixels, and compile the build unless that is done."""
        panel = display.panel
        pixels = np.random.default_rng(seed).integers((0, 0), (panel.width_px, panel.height_px), (rays, 2))
        harness(build)
        return cls(build, configuration(display, build, model), *words_of_pixels(display, pixels.astype(float) + 0.5))

    def rtl(self) -> tuple[FixedRays, float]:
        """Simulate the RTL; returns its rays, and the seconds of its one thread's processor time."""
        zero, engine = np.zeros_like(self.u), harness(self.build)
        started = time.thread_time()
        rays = engine.trace(self.u, self.v, zero, zero, self.config)
        return rays, time.thread_time() - started

    def twin(self) -> tuple[FixedRays, float]:
        """Trace with the twin; returns its rays, and the seconds by the clock on the wall."""
        zero = np.zeros_like(self.u)
        started = time.perf_counter()
        rays = ray_pipeline(self.u, self.v, zero, zero, self.config, self.build)
        return rays, time.perf_counter() - started


def words_differ(one: FixedRays, other: FixedRays) -> int:
    """Count the words that differ."""
    return sum(int((got != wanted).sum()) for got, wanted in zip(one, other, strict=True))


def bench_rtl(displays: list[Display], seed: int) -> list[SimulationRate]:
    """Measure exact builds, widest and compact, cross terms in logic and in cells, on some displays."""
    rows = []
    for display in displays:
        for fraction_bits in (WIDEST, COMPACT):
            for cells in (False, True):
                rows.append(_measure(display, Build(fraction_bits, display.array.grid, cross_cells=cells), seed))
    return rows


def _measure(display: Display, build: Build, seed: int) -> SimulationRate:
    simulation = Simulation.of(display, build, seed)
    runs = [simulation.rtl() for _ in range(RUNS)]
    twin, twin_seconds = simulation.twin()
    return SimulationRate(
        display=display.name,
        build=f"F {build.fraction_bits}, cross terms in {'cells' if build.cross_cells else 'logic'}",
        rtl_rays_per_second=RAYS / min(seconds for _, seconds in runs),
        twin_rays_per_second=RAYS / twin_seconds,
        words_differ=words_differ(runs[-1][0], twin),
        rays=RAYS,
    )

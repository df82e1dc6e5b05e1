"""Rays a second of the simulated RTL, with every word compared with the twin (`lippmann bench rtl`)."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lippmann.conditioning.measure import words_differ
from lippmann.display import Display, load_display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.conversion import words_of_pixels
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.fixed.words import COMPACT, WIDEST, Ints
from lippmann.measure.figures import in_turn
from lippmann.optics.rays import Model
from lippmann.sim.harness import harness

#: Rays of one run, and runs of `bench rtl`, which takes the fastest: other programs only slow a run.
RAYS, RUNS = 1_000_000, 3


@dataclass(frozen=True)
class SimulationRate:
    """A display, a build, its rates (rays/s) in simulation and by the twin, and the words that differ between both.

    The simulation's rate is by processor time of its one thread, the twin's by wall-clock time.
    """

    display: str
    build: str
    rtl_rays_per_second: float
    twin_rays_per_second: float
    words_differ: int
    rays: int


@dataclass(frozen=True)
class Simulation:
    """Chief rays through random pixel centres for a build: their words (N,), and the build's registers."""

    build: Build
    config: Configuration
    u: Ints
    v: Ints

    @classmethod
    def of(cls, display: Display, build: Build, seed: int, rays: int, model: Model = "exact") -> Simulation:
        """Draw the pixels, and compile the build unless it is compiled already."""
        panel = display.panel
        pixels = np.random.default_rng(seed).integers((0, 0), (panel.width_px, panel.height_px), (rays, 2))
        harness(build)
        return cls(build, configuration(display, build, model), *words_of_pixels(display, pixels.astype(float) + 0.5))

    def rtl(self) -> tuple[FixedRays, float]:
        """Simulate the RTL; return its rays, and the processor time of its one thread, seconds."""
        zero, engine = np.zeros_like(self.u), harness(self.build)
        started = time.thread_time()
        rays = engine.trace(self.u, self.v, zero, zero, self.config)
        return rays, time.thread_time() - started

    def twin(self) -> tuple[FixedRays, float]:
        """Trace with the twin; return its rays, and the wall-clock time, seconds."""
        zero = np.zeros_like(self.u)
        started = time.perf_counter()
        rays = ray_pipeline(self.u, self.v, zero, zero, self.config, self.build)
        return rays, time.perf_counter() - started

    def rtl_rate(self) -> float:
        """Return the rays/s of one simulated run."""
        return len(self.u) / self.rtl()[1]

    def words_differ(self) -> int:
        """Count the words in which RTL and twin differ."""
        return words_differ(self.rtl()[0], self.twin()[0])


def rates_of(simulations: Mapping[str, Simulation], rounds: int) -> dict[str, list[float]]:
    """Return the simulated rays/s of some builds, in each round."""
    return in_turn({name: one.rtl_rate for name, one in simulations.items()}, rounds)


def measure(scenes: Path, seed: int) -> Iterator[SimulationRate]:
    """Measure exact builds on the founding paper's displays: two word lengths, cross terms in logic and in cells."""
    for name in ("paper-square", "paper-hex"):
        display = load_display(scenes / f"displays/{name}.toml")
        for bits in (WIDEST, COMPACT):
            for cells in (False, True):
                run = Simulation.of(display, Build(bits, display.array.grid, cross_cells=cells), seed, RAYS)
                rtl, twin = max(rates_of({"": run}, RUNS)[""]), RAYS / run.twin()[1]
                build = f"F {bits}, cross terms in {'cells' if cells else 'logic'}"
                yield SimulationRate(display.name, build, rtl, twin, run.words_differ(), RAYS)

"""`lippmann bench trace`: rays a second of each engine and model, and the fast engine's error against golden."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lippmann.display import Display
from lippmann.engines import trace
from lippmann.optics.backend import DrJitBackend, NumpyBackend
from lippmann.optics.pixel_rays import rays_from_pixels
from lippmann.optics.rays import MODELS, Model, gets_through
from lippmann.optics.sampling import points_in_square, square_to_cell
from lippmann.optics.system import System
from lippmann.variant import current_device, mitsuba

#: Rays of one timed launch of the fast engine, and launches, of which the median counts.
FAST_RAYS = 1 << 24
LAUNCHES = 5
GOLDEN_RAYS = 200_000
#: Rays compared between the engines.
COMPARED_RAYS = 400_000


@dataclass(frozen=True)
class TraceRate:
    """One row: a display, a model, chief rays or the full aperture.

    Rates in rays/s; errors of fast against golden, microradian and nm (lens-local), over rays with equal status 0 or 4;
    `status_differs` counts the others of `compared`.
    """

    display: str
    grid: str
    model: str
    aperture: str
    golden_rays_per_second: float
    fast_rays_per_second: float
    max_direction_urad: float
    rms_direction_urad: float
    max_origin_nm: float
    status_differs: int
    compared: int


def measure(display: Display, model: Model, aperture: str, seed: int) -> TraceRate:
    """Measure one row."""
    random = np.random.default_rng(seed)
    panel, array = display.panel, display.array
    pixels = random.uniform((0.0, 0.0), (panel.width_px, panel.height_px), (COMPARED_RAYS, 2))
    points = None
    if aperture == "full":
        s, t = random.uniform(0.0, 1.0, (2, COMPARED_RAYS))
        points = np.stack(square_to_cell(NumpyBackend(), s, t, array.grid, array.pitch_mm), axis=1)
    golden = trace(display, pixels, points, model)
    fast = trace(display, pixels, points, model, "fast", current_device())
    same = golden.status == fast.status
    alive = same & gets_through(golden.status)
    turn = np.linalg.norm(golden.direction - fast.direction, axis=1)[alive] * 1e6
    shift = np.linalg.norm(golden.local_mm - fast.local_mm, axis=1)[alive] * 1e6

    some = slice(0, GOLDEN_RAYS)
    started = time.perf_counter()
    trace(display, pixels[some], None if points is None else points[some], model)
    golden_seconds = time.perf_counter() - started
    return TraceRate(
        display=display.name,
        grid=array.grid,
        model=model,
        aperture=aperture,
        golden_rays_per_second=GOLDEN_RAYS / golden_seconds,
        fast_rays_per_second=FAST_RAYS / _median_seconds(fast_launch(display, model, aperture)),
        max_direction_urad=float(turn.max()),
        rms_direction_urad=float(np.sqrt((turn**2).mean())),
        max_origin_nm=float(shift.max()),
        status_differs=int((~same).sum()),
        compared=COMPARED_RAYS,
    )


def fast_launch(
    display: Display, model: Model, aperture: str = "chief", rays: int = FAST_RAYS
) -> Callable[[int], float]:
    """Return what traces rays, using every output as a renderer would, and tells the seconds that it took.

    It is given a number, another one each time. The outputs are summed in the same program: memory traffic for arrays
    that nobody reads is no part of the optics. The first launch, which compiles, is done already.
    """
    mi = mitsuba()
    import drjit as dr

    b = DrJitBackend(current_device())
    system = System.of(display)
    panel, array = display.panel, display.array

    def traced(number: int) -> Any:
        index = dr.arange(mi.UInt32, rays) + dr.opaque(mi.UInt32, number)
        row = index // panel.width_px
        u = b.double(index - row * panel.width_px) + 0.5
        v = b.double(row % panel.height_px) + 0.5
        points = None
        if aperture == "full":
            s, t = points_in_square(index, mi.UInt32(0), 0, stream=1)
            points = square_to_cell(b, s, t, array.grid, array.pitch_mm)
        out = rays_from_pixels(b, system, u, v, points, model)
        origin = mi.Float(out.centre_x + out.centre_y) + out.ray.x + out.ray.y + out.ray.z
        value = origin + out.ray.dx + out.ray.dy + out.ray.dz
        return dr.sum(dr.select(gets_through(out.status), mi.Float(value), 0.0))

    def launch(number: int) -> float:
        started = time.perf_counter()
        dr.eval(traced(number))
        dr.sync_thread()
        return time.perf_counter() - started

    launch(0)
    return launch


def _median_seconds(launch: Callable[[int], float]) -> float:
    return float(np.median([launch(number) for number in range(1, LAUNCHES + 1)]))


def bench_trace(displays: list[Display], seed: int) -> list[TraceRate]:
    """Measure all models on some displays, and `exact` over the full aperture too."""
    rows = []
    for display in displays:
        rows += [measure(display, model, "chief", seed) for model in MODELS]
        rows.append(measure(display, "exact", "full", seed))
    return rows

"""Renders an integral image, or a plain perspective view, chunk by chunk.

**One pass renders both sides of the display.** A viewer sees a panel pixel along the
pixel's refracted ray. The renderer traces each ray *towards* the display, from in front
of the nearest object. The first surface on a ray, in front of the display (real image)
or behind it (virtual image), hides all others.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lippmann.base import interrupts
from lippmann.base.images import HALF_MAX, Radiance, describe_wrong
from lippmann.base.progress_protocol import Progress
from lippmann.base.variant import Jit, current_device, dr, mi
from lippmann.display.description import Display, Point3
from lippmann.errors import InputError, warn_user
from lippmann.optics.rays import Engine, Model
from lippmann.rendering.irradiance_cache_choice import CacheTrial, is_worth_a_trial, max_points, why_not_cached
from lippmann.rendering.lights import register_lights
from lippmann.rendering.memory_estimate import CHUNK_SAMPLES, bands_of, check_memory, memory_mb
from lippmann.rendering.options import Settings, Shading
from lippmann.rendering.pixel_filter import PixelFilter, is_filtered
from lippmann.rendering.sampling import TILE_PX, Pose, RaySource, Seeds, Window, display_source, eye_source, pixel_of
from lippmann.rendering.shading import CachedProgram, IrradianceCache, Program, means_of
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Scene, without_places

logger = logging.getLogger("lippmann")
#: Maximum growth of a band's chunks, as a fraction, to avoid a small last chunk.
CHUNK_SLACK = 0.1
#: Divisor of the chunk size with the irradiance cache, which needs more memory.
CACHE_CHUNK_DIVISOR = 2


@dataclass(frozen=True)
class Rendered:
    """A rendered image and its cost."""

    #: Linear RGB radiance, (height, width, 3) float32.
    radiance: Radiance
    #: Wall time of rendering, excluding compilation, s.
    seconds: float
    #: Processor time of all rendering threads, excluding compilation, s.
    cpu_seconds: float
    prepare_seconds: float
    #: Number of rays, including those that did not reach the scene.
    samples_traced: int
    #: Percentages of lost rays, one for each mask in `Lines.lost`.
    lost_percent: tuple[float, ...] = ()
    shading: Shading = "each"

    @property
    def measured(self) -> dict[str, float]:
        """The time figures for reports, keyed by name."""
        rate = self.samples_traced / max(self.seconds, 1e-9)
        return {"seconds": self.seconds, "prepare_seconds": self.prepare_seconds, "samples_per_second": rate}


def make_integrator(scene: Scene, settings: Settings) -> Jit:
    """Return a render's integrator. Raises InputError if the integrator is unknown or cannot sample single rays."""
    if settings.integrator == "scene":
        integrator = scene.mitsuba.integrator()
    else:
        register_lights()
        try:
            integrator = mi.load_dict({"type": settings.integrator, "max_depth": settings.max_depth})
        except Exception as error:
            # Mitsuba's `direct` has no parameter max_depth.
            try:
                integrator = mi.load_dict({"type": settings.integrator})
            except Exception:
                reason = without_places(error)[:200]
                raise InputError(
                    f"integrator '{settings.integrator}' does not load ({reason}); choose lights, direct, path or scene"
                ) from None
    # Differentiable SamplingIntegrators (prb, ...) cannot sample a single ray.
    differentiable = ".ad." in type(integrator).__module__
    if differentiable or not isinstance(integrator, mi.SamplingIntegrator):
        raise InputError(
            f"integrator '{settings.integrator}' does not sample single rays; choose lights, direct or path"
        )
    return integrator


class Renderer:
    """Renders the bands of an image in any order, with one compiled program."""

    def __init__(
        self,
        scene: Scene,
        source: RaySource,
        settings: Settings,
        bands: Sequence[range] | None = None,
        in_memory: bool = True,
    ) -> None:
        """Choose the program. Raises errors of `make_integrator`.

        `bands` are the rows of each band, by default from `bands_of`. Bands start at
        multiples of `BAND_ROWS`. If `in_memory`, the memory must hold all bands.
        """
        self._samples, self._seed, self._pass = settings.samples, settings.seed, 0
        self._width, self._height = source.width_px, source.height_px
        self._across = -(-self._width // TILE_PX)
        integrator = make_integrator(scene, settings)
        self._program = Program(scene, source, settings.samples, integrator)
        self._pose = Pose.of(scene.placement)
        self._colours = source.colours
        self._source, self._filtered = source, is_filtered(source, settings.samples)
        #: Rays per pixel.
        self.rays = settings.samples * self._colours
        self.bands = bands or bands_of(self._width, self._height, self.rays)
        rows = self._height if in_memory else max(len(rows) for rows in self.bands)
        started = time.perf_counter()
        #: Settings with "auto" replaced, so that all processes cache the same shapes.
        self.settings = replace(settings, shading="each", light_points=None)
        self.cache_report: str | None = None
        if settings.shading != "each":
            self.cache_report = self._choose_cache(scene, settings, rows, integrator)
        #: Time of the choice of the cache and of all calls of `prepare`, s.
        self.prepare_seconds = time.perf_counter() - started
        self.shading = self.settings.shading
        #: The values chosen for "auto" options, as metadata.
        self.choices: dict[str, str] = {"shading": self.shading}

    @property
    def _tiles_per_chunk(self) -> int:
        samples = CHUNK_SAMPLES[current_device()] // (CACHE_CHUNK_DIVISOR if self.shading == "shared" else 1)
        return max(1, samples // (self.rays * TILE_PX * TILE_PX))

    def _choose_cache(self, scene: Scene, settings: Settings, rows: int, integrator: Jit) -> str | None:
        """Use the irradiance cache if requested, or chosen for "auto"; return a line for the log."""
        source, is_auto = self._source, settings.shading == "auto"
        why, is_reported = why_not_cached(scene, source, settings.integrator), not is_auto
        rays = self._width * self._height * self.rays
        if why is None and is_auto:
            if not is_worth_a_trial(scene, rays):
                return None
            needed = memory_mb(self._width, rows, "shared", self._samples, self._colours)
            # Only the user's memory limit counts: free memory must not change pictures.
            is_reported = settings.memory_mb is not None and needed > settings.memory_mb
            why = "the memory limit leaves no room for it" if is_reported else None
        if why is None:
            assert source.detail_mm is not None
            points = max_points(settings, rays)
            cache = IrradianceCache(scene, source.detail_mm / scene.placement.scale, points)
            if cache.points:
                program = CachedProgram(scene, source, settings.samples, integrator, settings.max_depth, cache)
                is_used, report = self._try_cache(program) if is_auto else (True, None)
                if is_used:
                    self._program = program
                    self.settings = replace(settings, shading="shared", light_points=points)
                return report
            why = "no mesh or sphere is diffuse, or all need too many points"
        return f"no irradiance cache: {why}" if is_reported else None

    def _try_cache(self, program: CachedProgram) -> tuple[bool, str]:
        """Render a trial with and without the cache; return whether to use it, and a line for the log."""
        trial = CacheTrial(self._source, self._samples)
        # The seeds are two variables: one for both would cause another recording.
        seeds = Seeds(*(dr.opaque(mi.UInt32, value) for value in (self._seed, self._pass)))
        return trial.judge([program.trial(*chunk, seeds, self._pose, trial.samples) for chunk in trial.chunks()])

    def move(self, placement: Placement, number: int = 0) -> None:
        """Move the scene. Later bands show the moved scene and belong to pass `number`."""
        self._pose, self._pass = Pose.of(placement), number

    def prepare(self) -> float:
        """Compile the program by rendering one tile; return the compilation time in seconds."""
        started = time.perf_counter()
        self.draw(range(TILE_PX), tiles=1)
        seconds = time.perf_counter() - started
        self.prepare_seconds += seconds
        return seconds

    def render(self, number: int, report_rows: Callable[[int], None] | None = None) -> tuple[Radiance, list[int]]:
        """Return a band's radiance and numbers of lost samples; see `BandRenderer`."""
        planes, lost = self.draw(self.bands[number], report_rows)
        return radiance_of(planes, self._width), lost

    def draw(
        self, rows: range, report_rows: Callable[[int], None] | None = None, tiles: int | None = None
    ) -> tuple[list[Jit], list[int]]:
        """Render rows, or only `tiles` tiles of them; return colour planes and numbers of lost samples."""
        planes = [dr.zeros(mi.Float, self._width * len(rows)) for _ in range(3)]
        if tiles is None:
            tiles = self._across * -(-len(rows) // TILE_PX)
        # The mean of several passes needs no pixel filter.
        filtered = self._filtered and self._pass == 0
        sums = PixelFilter(self._source, self._samples, rows) if filtered else None
        lost = []
        # Use few chunks of equal size: each has a fixed cost, because Dr.Jit visits all shapes.
        chunks = max(1, math.ceil(tiles / self._tiles_per_chunk - CHUNK_SLACK))
        size = -(-tiles // chunks)
        for first in range(0, tiles, size):
            interrupts.check()
            count = min(size, tiles - first)
            lost.append(self._run(rows, first, count, planes, sums))
            if self.shading != "shared":  # the cached program itself waits for Dr.Jit
                dr.sync_thread()
            if report_rows is not None:
                report_rows(len(rows) * (first + count) // tiles)
        if sums is not None:
            planes = sums.colours()
            dr.eval(planes)
        return planes, [sum(int(count[0]) for count in counts) for counts in zip(*lost, strict=True)]

    def _run(self, rows: range, first_tile: int, count: int, planes: list[Jit], sums: PixelFilter | None) -> list[Jit]:
        """Render tiles into `sums`, or into `planes` if `sums` is None; return numbers of lost samples."""
        pixels = count * TILE_PX * TILE_PX
        index = dr.arange(mi.UInt32, pixels * self.rays)
        # Values that change between chunks are opaque: a new literal needs a new program.
        first = dr.opaque(mi.UInt32, rows.start // TILE_PX * self._across + first_tile)
        seeds = Seeds(*(dr.opaque(mi.UInt32, value) for value in (self._seed, self._pass)))
        dr.make_opaque(index)
        colour, lost = self._program(index, first, seeds, self._pose)
        pixel, inside = pixel_of(first, dr.arange(mi.UInt32, pixels), self._width, self._height)
        if sums is not None:
            sums.add(colour, pixel, inside, seeds)
            return lost
        place = pixel - dr.opaque(mi.UInt32, rows.start * self._width)
        for plane, mean in zip(planes, means_of(colour, self._colours, self._samples), strict=True):
            dr.scatter(plane, mean, place, inside)
        dr.eval(planes)
        return lost


def radiance_of(planes: list[Jit], width: int) -> Radiance:
    """Return colour planes as an image (rows, width, 3), which may share Dr.Jit's memory."""
    # Other threads need a copy: a thread that frees Dr.Jit's memory may wait for ever.
    return np.asarray(dr.ravel(mi.Color3f(planes))).reshape(-1, width, 3)


def finite_radiance(radiance: Radiance, name: object) -> Radiance:
    """Replace NaN by black and infinity by the largest half float, and warn; return the radiance."""
    if what := describe_wrong(radiance):
        remedy = "check the scene's textures and lights for such numbers"
        warn_user(f"{name}: {what}; NaN becomes black, infinity {HALF_MAX:g}: {remedy}")
        return np.nan_to_num(radiance, nan=0.0, posinf=HALF_MAX, neginf=0.0)
    return radiance


def render_rays(scene: Scene, source: RaySource, settings: Settings, progress: Progress | None = None) -> Rendered:
    """Render an image; `progress` gets (rows done, all rows). Raises errors of `Renderer` and `check_memory`."""
    check_memory(source.width_px, source.height_px, settings, source.colours)
    renderer = Renderer(scene, source, settings)
    renderer.prepare()
    if renderer.cache_report is not None:
        logger.info("%s", renderer.cache_report)
    radiance, lost = np.empty((source.height_px, source.width_px, 3), np.float32), []
    started, cpu_before = time.perf_counter(), time.process_time()
    for number, rows in enumerate(renderer.bands):
        report = None if progress is None else lambda count, first=rows.start: progress(first + count, source.height_px)
        band, counts = renderer.render(number, report)
        radiance[rows.start : rows.stop] = finite_radiance(band, f"rows {rows.start} to {rows.stop - 1}")
        lost.append(counts)
    finished, cpu_after = time.perf_counter(), time.process_time()
    traced = source.width_px * source.height_px * renderer.rays
    return Rendered(
        radiance=radiance,
        seconds=finished - started,
        cpu_seconds=cpu_after - cpu_before,
        prepare_seconds=renderer.prepare_seconds,
        samples_traced=traced,
        lost_percent=tuple(100.0 * sum(counts) / traced for counts in zip(*lost, strict=True)),
        shading=renderer.shading,
    )


def render_integral(
    scene: Scene,
    display: Display,
    model: Model,
    settings: Settings,
    progress: Progress | None = None,
    engine: Engine = "fast",
    fraction_bits: int | None = None,
) -> Rendered:
    """Render an integral image with an engine's rays. Raises errors of `render_rays` and `engines.trace`."""
    source = display_source(display, model, settings.samples, settings.aperture, engine, fraction_bits)
    return render_rays(scene, source, settings, progress)


def render_view(
    scene: Scene,
    eye_mm: Point3,
    window: Window,
    settings: Settings,
    pupil_mm: float = 0.0,
    focus_z_mm: float = 0.0,
) -> Rendered:
    """Render an eye's view through a window. Raises errors of `render_rays`."""
    near = scene.placement.near_mm
    if near is not None and near > eye_mm[2]:
        scene = replace(scene, placement=replace(scene.placement, near_mm=eye_mm[2], far_mm=None))
    return render_rays(scene, eye_source(eye_mm, window, pupil_mm, focus_z_mm), settings)

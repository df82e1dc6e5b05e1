"""Renders an integral image, or a plain perspective view, chunk by chunk.

**One pass for both sides of the display.** A panel pixel's ray, refracted by its lenslet, is the line along which a
viewer sees that pixel. The renderer follows it *towards* the display, from in front of the nearest object: the first
surface it meets hides the others, whether it is before the display (real image) or behind it (virtual
image). So depth comes out right and occlusion is correct, without a second pass.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lippmann.base import interrupts
from lippmann.base.images import Radiance
from lippmann.base.progress import Progress
from lippmann.base.tones import psnr_db
from lippmann.base.variant import Jit, current_device, dr, mi
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.optics.rays import Engine, Model
from lippmann.rendering.bands import CHUNK_SAMPLES, bands_of, check_memory, memory_mb
from lippmann.rendering.lights import register_lights
from lippmann.rendering.options import Settings, Shading
from lippmann.rendering.pixel_filter import PixelFilter, is_filtered
from lippmann.rendering.sampling import TILE_PX, Pose, RaySource, Seeds, Window, display_source, eye_source, pixel_of
from lippmann.rendering.shading import Irradiance, Program, SharedProgram, means_of, why_not_shared
from lippmann.rendering.surface_lattice import MOST_POINTS
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Scene, without_places

logger = logging.getLogger("lippmann")
#: A band takes one chunk fewer where no more than this part of a chunk would be left for the last.
CHUNK_SLACK = 0.1
#: Shared light needs more memory for a sample: its chunks are so many times smaller.
SHARED_PARTS = 2
#: Light is shared where that changes the picture by less, and there are so many rays for each point that light is found
#: for at most.
SHARED_DB, RAYS_A_POINT = 45.0, 4
#: One lamp's shadow rays take little more time than the trial (docs/generated/measured/stages.csv, docs/generated/reports/shading.csv).
LEAST_LAMPS = 2
#: Parts of the image, each way, in each of which that is tried, rays of a colour in all of them, and samples of a pixel
#: at most: of more, fewer places would be seen. Not 2^18 rays: a texture with as many values is another recording.
TRIAL_PARTS, TRIAL_RAYS, TRIAL_SAMPLES = 4, 28 * 28 * 256, 4
#: The seed of their places: every render of a scene, of any seed, is tried in the same ones.
TRIAL_SEED = 1
#: Rays of a picture for which the trial pays, at least.
LEAST_RAYS = 1 << 21
#: Share of the samples that may meet surfaces without a lattice.
MOST_ALONE = 0.5


@dataclass(frozen=True)
class Rendered:
    """A rendered image and its cost."""

    #: (height, width, 3) float32, linear RGB.
    radiance: Radiance
    #: Wall time of the render, and processor time of all threads, without compilation.
    seconds: float
    cpu_seconds: float
    #: Compilation before the render.
    prepare_seconds: float
    #: Rays sent into the scene, and those lost before.
    samples_traced: int
    #: Rays that were lost, per cent, for each of the source's reasons (`Lines.lost`).
    lost_percent: tuple[float, ...] = ()
    #: Whether light was shared.
    shading: Shading = "each"

    @property
    def samples_per_second(self) -> float:
        """Rays a second, without compilation."""
        return self.samples_traced / max(self.seconds, 1e-9)

    @property
    def measured(self) -> dict[str, float]:
        """The times by name, for reports."""
        return {name: getattr(self, name) for name in ("seconds", "prepare_seconds", "samples_per_second")}


def make_integrator(scene: Scene, settings: Settings) -> Jit:
    """Return the integrator that the settings name; raise InputError when there is none, or a ray is not enough."""
    if settings.integrator == "scene":
        integrator = scene.mitsuba.integrator()
    else:
        register_lights()
        try:
            integrator = mi.load_dict({"type": settings.integrator, "max_depth": settings.max_depth})
        except Exception as error:
            # Mitsuba's `direct` has no max_depth.
            try:
                integrator = mi.load_dict({"type": settings.integrator})
            except Exception:
                reason = without_places(error)[:200]
                raise InputError(
                    f"integrator '{settings.integrator}' does not load ({reason}); choose lights, direct, path or scene"
                ) from None
    # Mitsuba's differentiable integrators (prb, ...) derive from SamplingIntegrator but need more than a ray.
    differentiable = ".ad." in type(integrator).__module__
    if differentiable or not isinstance(integrator, mi.SamplingIntegrator):
        raise InputError(
            f"integrator '{settings.integrator}' does not sample single rays; choose lights, direct or path"
        )
    return integrator


class Renderer:
    """Renders bands of the image of a source of rays, in any order, by one program."""

    def __init__(
        self,
        scene: Scene,
        source: RaySource,
        settings: Settings,
        bands: Sequence[range] | None = None,
        in_memory: bool = True,
    ) -> None:
        """Raise InputError when there is no such integrator.

        `bands` are the rows of each, from a multiple of `BAND_ROWS` on; None: `bands_of`. `in_memory`: the
        whole picture is kept in memory, not one band.
        """
        self._samples, self._seed, self._pass = settings.samples, settings.seed, 0
        self._width, self._height = source.width_px, source.height_px
        self._across = -(-self._width // TILE_PX)
        integrator = make_integrator(scene, settings)
        self._program = Program(scene, source, settings.samples, integrator)
        self._pose = Pose.of(scene.placement)
        self._colours = source.colours
        self._source, self._filtered = source, is_filtered(source, settings.samples)
        #: Rays for each pixel.
        self.rays = settings.samples * self._colours
        self.bands = bands or bands_of(self._width, self._height, self.rays)
        rows = self._height if in_memory else max(len(rows) for rows in self.bands)
        started = time.perf_counter()
        #: The settings with nothing open: by these any process shades as this one does, the same bodies share light.
        self.settings = replace(settings, shading="each", light_points=None)
        #: What is to be told of sharing light.
        self.remark: str | None = None
        if settings.shading != "each":
            self.remark = self._share(scene, settings, rows, integrator)
        #: Seconds of choosing how to shade, and of all calls of `prepare`.
        self.prepare_seconds = time.perf_counter() - started
        #: Whether light is shared; and how open choices were decided, as metadata.
        self.shading = self.settings.shading
        self.choices: dict[str, str] = {"shading": self.shading}

    @property
    def _chunk(self) -> int:
        """Tiles of a chunk."""
        most = CHUNK_SAMPLES[current_device()] // (SHARED_PARTS if self.shading == "shared" else 1)
        return max(1, most // (self.rays * TILE_PX * TILE_PX))

    def _share(self, scene: Scene, settings: Settings, rows: int, integrator: Jit) -> str | None:
        """Let the program share light, where it can and is asked to; return a remark. `rows` are kept in memory."""
        source, most, is_open = self._source, settings.light_points, settings.shading == "auto"
        why, is_told = why_not_shared(scene, source, settings.integrator), not is_open
        rays = self._width * self._height * self.rays
        if why is None and is_open:
            # A GPU traces a ray in less time than it needs to look for what is known.
            if len(scene.mitsuba.emitters()) < LEAST_LAMPS or current_device() == "cuda" or rays < LEAST_RAYS:
                return None
            needed = memory_mb(self._width, rows, "shared", self._samples, self._colours)
            # The user's limit alone: the free memory must not change a picture.
            is_told = settings.memory_mb is not None and needed > settings.memory_mb
            why = "--memory-mb leaves no room for it" if is_told else None
        if why is None:
            assert source.detail_mm is not None
            if most is None:
                most = min(MOST_POINTS, int(rays // RAYS_A_POINT)) if is_open else MOST_POINTS
            light = Irradiance(scene, source.detail_mm / scene.placement.scale, most)
            if light.points:
                self._shared = SharedProgram(scene, source, settings.samples, integrator, settings.max_depth, light)
                keeps, remark = self._judge_trial() if is_open else (True, None)
                if keeps:
                    self._program, self.settings = self._shared, replace(settings, shading="shared", light_points=most)
                return remark
            why = "no surface is diffuse, or it would have too many points a lenslet's pitch apart"
        return f"light is not shared: {why}" if is_told else None

    def _judge_trial(self) -> tuple[bool, str]:
        """Tell whether shared light changes no part of the image by more than `SHARED_DB`, and say so in words."""
        decibels = self._trial()
        if decibels is None:
            return False, "light is not shared: most rays meet surfaces that are not plain diffuse, or too large"
        keeps = decibels >= SHARED_DB
        likeness = f"PSNR {math.floor(10 * decibels) / 10} dB" if math.isfinite(decibels) else "no difference"
        part = min(1.0, len(self._trial_tiles()) / (self._across * -(-self._height // TILE_PX)))
        verdict = f"{SHARED_DB:.0f} dB are needed, so light is {'' if keeps else 'not '}shared"
        tried = f"shared light, tried beside each ray's own in {100 * part:.3g} % of the picture"
        return keeps, f"{tried}: {likeness}; {verdict}"

    def move(self, placement: Placement, number: int = 0) -> None:
        """Let the next bands be those of the scene in another place: a pass of this number, by the same program."""
        self._pose, self._pass = Pose.of(placement), number

    def prepare(self) -> float:
        """Compile the program by rendering one tile; return the seconds that it took."""
        started = time.perf_counter()
        self.draw(range(TILE_PX), tiles=1)
        seconds = time.perf_counter() - started
        self.prepare_seconds += seconds
        return seconds

    def _trial_tiles(self) -> npt.NDArray[np.int64]:
        """Return the tiles that are tried: one anywhere in each of equal parts, for a regular grid misses columns."""
        rays = TILE_PX * TILE_PX * min(self._samples, TRIAL_SAMPLES)
        side = max(1, math.isqrt(TRIAL_RAYS // rays) // TRIAL_PARTS) * TRIAL_PARTS
        within = np.random.default_rng(TRIAL_SEED).random((2, side, side))
        places = (np.mgrid[:side, :side] + within) / side
        down = -(-self._height // TILE_PX)
        rows, columns = (places * np.array([down, self._across])[:, None, None]).astype(np.int64).reshape(2, -1)
        tiles: npt.NDArray[np.int64] = rows * self._across + columns
        return tiles

    def _trial(self) -> float | None:
        """Return the likeness, dB, of tiles all over the image with shared light to those with each sample's own.

        It is that of the part of the image, of `TRIAL_PARTS` x `TRIAL_PARTS`, where they are least alike. None: most
        samples meet surfaces without a lattice.
        """
        tiles = self._trial_tiles()
        side, rays, samples = math.isqrt(len(tiles)), TILE_PX * TILE_PX * self.rays, min(self._samples, TRIAL_SAMPLES)
        # All at once, where the samples' numbers have 31 bits (programs take the 32nd for 0); they have not in large
        # pictures of many samples.
        together = (tiles.max() + 1) * rays < 1 << 31
        # Of their own, as in `_run`: one for two of them would be another recording.
        seeds = Seeds(*(dr.opaque(mi.UInt32, value) for value in (self._seed, self._pass)))
        found = []
        for first, ours in [(0, tiles)] if together else [(tile, np.zeros(1, np.int64)) for tile in tiles]:
            # Computed here: numpy's memory is aligned otherwise, which would be another recording.
            lane = dr.arange(mi.UInt32, len(ours) * TILE_PX * TILE_PX * self._colours * samples)
            # Of each colour of a pixel so many of its samples, far apart.
            group = lane // samples
            pixel = group // self._colours
            tile = dr.gather(mi.UInt32, mi.UInt32(ours.astype(np.uint32)), pixel // (TILE_PX * TILE_PX))
            sample = (lane - group * samples) * self._samples // samples
            own = (pixel % (TILE_PX * TILE_PX) * self._colours + group % self._colours) * self._samples + sample
            index = tile * rays + own
            dr.make_opaque(index)
            found.append(self._shared.trial(index, dr.opaque(mi.UInt32, int(first)), seeds, self._pose, samples))
        shared, own, alone = zip(*found, strict=True)
        if np.mean(alone) > MOST_ALONE:
            return None
        pair = np.concatenate(shared), np.concatenate(own)
        a, b = (one.reshape(TRIAL_PARTS, side // TRIAL_PARTS, TRIAL_PARTS, -1, 3) for one in pair)
        return min(psnr_db(a[i, :, k], b[i, :, k]) for i in range(TRIAL_PARTS) for k in range(TRIAL_PARTS))

    def render(self, number: int, report_rows: Callable[[int], None] | None = None) -> tuple[Radiance, list[int]]:
        """Return a band's radiance (rows, width, 3) and its lost samples by reason (`BandRenderer.render`)."""
        planes, lost = self.draw(self.bands[number], report_rows)
        return radiance_of(planes, self._width), lost

    def draw(
        self, rows: range, report_rows: Callable[[int], None] | None = None, tiles: int | None = None
    ) -> tuple[list[Jit], list[int]]:
        """Return planes of red, green and blue of some rows (Dr.Jit), and the numbers of lost samples by reason.

        Of so many tiles from the first on, or all; the others are black. `report_rows` is called as by `render`.
        """
        planes = [dr.zeros(mi.Float, self._width * len(rows)) for _ in range(3)]
        if tiles is None:
            tiles = self._across * -(-len(rows) // TILE_PX)
        # The mean of several passes is as good without.
        filtered = self._filtered and self._pass == 0
        sums = PixelFilter(self._source, self._samples, rows) if filtered else None
        lost = []
        # Of equal size: each has a fixed cost, because Dr.Jit visits all shapes, so a small last chunk is a waste.
        chunks = max(1, math.ceil(tiles / self._chunk - CHUNK_SLACK))
        size = -(-tiles // chunks)
        for first in range(0, tiles, size):
            interrupts.check()
            count = min(size, tiles - first)
            lost.append(self._run(rows, first, count, planes, sums))
            if self.shading != "shared":  # which waits for its points, and prepares a chunk beside the one before
                dr.sync_thread()
            if report_rows is not None:
                report_rows(len(rows) * (first + count) // tiles)
        if sums is not None:
            planes = sums.colours()
            dr.eval(planes)
        return planes, [sum(int(count[0]) for count in counts) for counts in zip(*lost, strict=True)]

    def _run(self, rows: range, first_tile: int, count: int, planes: list[Jit], sums: PixelFilter | None) -> list[Jit]:
        """Render tiles of some rows, numbered from their first; return the numbers of lost samples.

        If there are `sums`, the samples are added to them; if not, each pixel's mean is written into the planes.
        """
        pixels = count * TILE_PX * TILE_PX
        index = dr.arange(mi.UInt32, pixels * self.rays)
        # Opaque, like all values that change from chunk to chunk: a literal would be compiled into the program.
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
    """Return planes of red, green and blue as an image (rows, width, 3), which may be Dr.Jit's memory.

    Copy it for other threads: who lets go of it waits for Dr.Jit, which may wait for Python in the thread that renders.
    """
    return np.asarray(dr.ravel(mi.Color3f(planes))).reshape(-1, width, 3)


def render_rays(scene: Scene, source: RaySource, settings: Settings, progress: Progress | None = None) -> Rendered:
    """Render the image of a source of rays; `progress` is called with (rows done, rows in all).

    What a trial of shared light shows goes to the log. Raises InputError when the image exceeds the memory limit, or
    there is no such integrator.
    """
    check_memory(source.width_px, source.height_px, settings, source.colours)
    renderer = Renderer(scene, source, settings)
    renderer.prepare()
    if renderer.remark is not None:
        logger.info("%s", renderer.remark)
    radiance, lost = np.empty((source.height_px, source.width_px, 3), np.float32), []
    started, cpu_before = time.perf_counter(), time.process_time()
    for number, rows in enumerate(renderer.bands):
        report = None if progress is None else lambda done, first=rows.start: progress(first + done, source.height_px)
        radiance[rows.start : rows.stop], counts = renderer.render(number, report)
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
    """Render the integral image of a scene for a display (see `render_rays`), with the rays of an engine.

    Raises InputError as `render_rays` and `lippmann.engines.trace`; MissingLibraryError when an engine lacks a tool.
    """
    source = display_source(display, model, settings.samples, settings.aperture, engine, fraction_bits)
    return render_rays(scene, source, settings, progress)


def render_view(
    scene: Scene,
    eye_mm: tuple[float, float, float],
    window: Window,
    settings: Settings,
    pupil_mm: float = 0.0,
    focus_z_mm: float = 0.0,
) -> Rendered:
    """Render the scene as an eye sees it through a window, without a display (see `render_rays`, `eye_source`)."""
    near = scene.placement.near_mm
    if near is not None and near > eye_mm[2]:
        # Parts of the scene behind the eye are invisible.
        scene = replace(scene, placement=replace(scene.placement, near_mm=eye_mm[2], far_mm=None))
    return render_rays(scene, eye_source(eye_mm, window, pupil_mm, focus_z_mm), settings)

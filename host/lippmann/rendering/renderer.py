"""Renders an integral image, or a plain perspective view, chunk by chunk.

**One pass for both sides of the display.** A panel pixel's ray, refracted by its lenslet, is the line along which a
viewer sees that pixel. The renderer follows it *towards* the display, from in front of the nearest object: the first
surface it meets hides the others, whether it is before the display (real image) or behind it (virtual
image). So depth comes out right and occlusion is correct, without a second pass.
"""

from __future__ import annotations

import math
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lippmann import interrupts
from lippmann.display import Display
from lippmann.errors import InputError, whole_number
from lippmann.images import Radiance
from lippmann.limits import free_memory_mb, proc_mb
from lippmann.optics.backend import DrJitBackend
from lippmann.optics.rays import Engine, Model
from lippmann.optics.sampling import points_in_square
from lippmann.rendering.lights import register_lights
from lippmann.rendering.scene import Scene
from lippmann.rendering.sources import APERTURES, Aperture, Lines, RaySource, Window, display_source, eye_source
from lippmann.subpixels import COLOURS, Box
from lippmann.variant import current_device, mitsuba

#: Samples traced at once. Part of an image's definition, because random integrators draw their numbers by chunk.
CHUNK_SAMPLES = 1 << 22
#: Side of the square tiles of pixels, which are traced in Morton order, so that rays traced together stay close.
TILE_PX = 8
#: Memory of the libraries and one chunk, MB (measured; the output is added).
BASE_MEMORY_MB = 500.0
MAX_SAMPLES = 65536


@dataclass(frozen=True)
class Settings:
    """How to render."""

    #: Samples for each pixel (and for each of its colours, where it has sub-pixels). One goes through the centre;
    #: more are spread over the area (anti-aliasing).
    samples: int = 1
    #: "chief": rays through the lenslet's centre; "full": spread over its cell.
    aperture: Aperture = "chief"
    #: "lights" (ours), or the name of a Mitsuba integrator ("direct", "path", ...), or "scene": the file's own.
    integrator: str = "lights"
    #: Surfaces that a ray may meet.
    max_depth: int = 4
    #: The same seed gives the same pixels, bit for bit, on the same machine with the same versions.
    seed: int = 0
    #: Limit; None: four fifths of the free memory.
    memory_mb: float | None = None

    def __post_init__(self) -> None:
        """Refuse settings out of range."""
        for name, low, high in (("samples", 1, MAX_SAMPLES), ("max_depth", 1, 1000), ("seed", 0, 2**32 - 1)):
            object.__setattr__(self, name, whole_number(name.replace("_", " "), getattr(self, name), low, high))
        if self.aperture not in APERTURES:
            raise InputError(f"unknown aperture '{self.aperture}'; choose from {', '.join(APERTURES)}")


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

    @property
    def samples_per_second(self) -> float:
        """Rays a second, without compilation."""
        return self.samples_traced / max(self.seconds, 1e-9)

    @property
    def measured(self) -> dict[str, float]:
        """The times by name, for reports."""
        return {name: getattr(self, name) for name in ("seconds", "prepare_seconds", "samples_per_second")}


Progress = Callable[[int, int], None]


def make_integrator(scene: Scene, settings: Settings) -> Any:
    """Return the integrator that the settings name; raise InputError when there is none, or a ray is not enough."""
    mi = mitsuba()
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
                reason = " ".join(str(error).split())[:200]
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


def render_rays(scene: Scene, source: RaySource, settings: Settings, progress: Progress | None = None) -> Rendered:
    """Render the image of a source of rays; `progress` is called with (tiles done, tiles in all).

    Raises InputError when the image exceeds the memory limit, or there is no such integrator.
    """
    mi = mitsuba()
    import drjit as dr

    width, height = source.width_px, source.height_px
    check_memory(width, height, settings)
    integrator = make_integrator(scene, settings)
    samples = settings.samples
    tiles = -(-width // TILE_PX) * -(-height // TILE_PX)
    tile_pixels = TILE_PX * TILE_PX
    chunk_tiles = max(1, CHUNK_SAMPLES // (samples * tile_pixels))
    planes = [dr.zeros(mi.Float, width * height) for _ in range(3)]

    # Channels, and the part of a pixel that shows them, for each pixel of the layout.
    layout = source.layout
    passes: list[tuple[tuple[int, ...], list[Box]]] = (
        [((0, 1, 2), [Box(0.0, 0.0, 1.0, 1.0)])]
        if layout is None
        else [((k,), layout.boxes(colour)) for k, colour in enumerate(COLOURS[:3])]
    )

    def run(first_tile: int, count: int, number: int) -> list[int]:
        """Render tiles into the planes; return the numbers of lost samples."""
        # Opaque, like all values that change from chunk to chunk: a literal would be compiled into the program.
        seed = dr.opaque(mi.UInt32, (settings.seed * 0x9E3779B1 + number) & 0xFFFFFFFF)
        for channels, boxes in passes:
            first = dr.opaque(mi.UInt32, first_tile)
            index = dr.arange(mi.UInt32, count * tile_pixels * samples)
            place = index // samples
            pixel, inside = _pixel_of(first, place, width, height)
            lines = _lines(source, settings, pixel, index - place * samples, boxes)
            active = lines.active & inside
            lost = [mask & inside for mask in lines.lost]
            sampler = mi.load_dict({"type": "independent"})
            sampler.seed(seed, count * tile_pixels * samples)
            radiance, _, _ = integrator.sample(scene.mitsuba, sampler, scene_ray(scene, lines), None, active)
            colour = dr.select(active, mi.Color3f(radiance), 0.0)
            if samples > 1:
                # Evaluated before the sums, because each sum would trace the rays again.
                dr.eval(colour, lost)
                colour = mi.Color3f([dr.block_reduce(dr.ReduceOp.Add, c, samples) * (1.0 / samples) for c in colour])
                pixel, inside = _pixel_of(first, dr.arange(mi.UInt32, count * tile_pixels), width, height)
            for k in channels:
                dr.scatter(planes[k], colour[k], pixel, inside)
            dr.eval(planes, lost)
        return [int(mi.UInt32(dr.count(mask))[0]) for mask in lost]

    started = time.perf_counter()
    # Compiles the programs by running them on one tile.
    run(0, 1, 0)
    dr.sync_thread()
    prepared, cpu_before = time.perf_counter(), time.process_time()
    lost_samples = []
    for number, first in enumerate(range(0, tiles, chunk_tiles)):
        interrupts.check()
        count = min(chunk_tiles, tiles - first)
        lost_samples.append(run(first, count, number))
        dr.sync_thread()
        if progress is not None:
            progress(first + count, tiles)
    finished, cpu_after = time.perf_counter(), time.process_time()
    traced_samples = width * height * samples * len(passes)
    return Rendered(
        radiance=np.asarray(dr.ravel(mi.Color3f(planes))).reshape(height, width, 3),
        seconds=finished - prepared,
        cpu_seconds=cpu_after - cpu_before,
        prepare_seconds=prepared - started,
        samples_traced=traced_samples,
        lost_percent=tuple(100.0 * sum(counts) / traced_samples for counts in zip(*lost_samples, strict=True)),
    )


def _pixel_of(first_tile: Any, place: Any, width: int, height: int) -> tuple[Any, Any]:
    """Return the pixel number of a place in the order of tiles, and whether it lies inside the image."""
    mi = mitsuba()
    tiles_across = -(-width // TILE_PX)
    tile = first_tile + place // (TILE_PX * TILE_PX)
    bits = place & (TILE_PX * TILE_PX - 1)
    x = (bits & 1) | ((bits >> 1) & 2) | ((bits >> 2) & 4)
    y = ((bits >> 1) & 1) | ((bits >> 2) & 2) | ((bits >> 3) & 4)
    tile_row = tile // tiles_across
    column = (tile - tile_row * tiles_across) * TILE_PX + x
    row = tile_row * TILE_PX + y
    inside = (column < width) & (row < height)
    return mi.UInt32(row * width + column), inside


def _lines(source: RaySource, settings: Settings, pixel: Any, sample: Any, boxes: list[Box]) -> Lines:
    """Return the lines of sight of samples, by their pixels' numbers and theirs in the pixel (UInt32).

    `boxes` are the sampled parts of the pixels of the source's layout, row by row.
    """
    mi = mitsuba()
    import drjit as dr

    b = DrJitBackend(current_device())
    x, y = mi.Float(0.5), mi.Float(0.5)
    if settings.samples > 1:
        x, y = points_in_square(pixel, sample, settings.seed, stream=0)
    row = pixel // source.width_px
    column = pixel - row * source.width_px
    part: Any = boxes[0]._replace(u=dr.opaque(mi.Float, boxes[0].u))
    if source.layout is not None and len(boxes) > 1:
        number = row % source.layout.rows * source.layout.columns + column % source.layout.columns
        part = Box(*(dr.gather(mi.Float, mi.Float(values), number) for values in zip(*boxes, strict=True)))
    u = b.double(column) + b.double(0.5 + part.u + part.width * (x - 0.5))
    if any(box.v or box.height != 1.0 for box in boxes):
        y = 0.5 + part.v + part.height * (y - 0.5)
    return source.lines(b, u, b.double(row) + b.double(y), points_in_square(pixel, sample, settings.seed, stream=1))


def scene_ray(scene: Scene, lines: Lines) -> Any:
    """Return the scene's ray along a line of sight, from in front of the scene towards the display."""
    mi = mitsuba()
    import drjit as dr

    point, direction = lines.point, lines.direction
    # Opaque, so that a moved scene or another eye needs no compilation.
    near = dr.opaque(mi.Float, scene.placement.near_mm)
    t = (near - point[2]) / direction[2]
    start = mi.Point3f(point[0] + t * direction[0], point[1] + t * direction[1], near)
    back = mi.Vector3f(*(-c for c in direction))
    matrix = scene.placement.scene_from_display
    if not np.array_equal(matrix, np.eye(4)):
        m = [[dr.opaque(mi.Float, float(x)) for x in line] for line in matrix[:3]]
        start = mi.Point3f(*(line[0] * start.x + line[1] * start.y + line[2] * start.z + line[3] for line in m))
        back = dr.normalize(mi.Vector3f(*(line[0] * back.x + line[1] * back.y + line[2] * back.z for line in m)))
    ray = mi.RayDifferential3f(start, back)
    ray.wavelengths = []
    return ray


def check_memory(width_px: int, height_px: int, settings: Settings) -> None:
    """Raise InputError, with the need and the limit, for an image whose buffers exceed the memory limit."""
    # Radiance in float32 three times: as planes, as an image, and as the rotated image of a capture. Files take bands.
    needed = BASE_MEMORY_MB + 3.0 * width_px * height_px * 3 * 4 / 1e6
    what = f"an image of {width_px} x {height_px} pixels"
    check_memory_mb(needed, settings.memory_mb, what, "raise --memory-mb or take a smaller panel")


def check_memory_mb(needed: float, limit: float | None, what: str, remedy: str) -> None:
    """Raise InputError for work that needs more memory (MB) than a limit; None: four fifths of the free memory."""
    limit = 0.8 * free_memory_mb() if limit is None else limit
    if not limit > 0.0:
        raise InputError(f"--memory-mb {limit:g} is not a limit; give a number above 0")
    if not needed <= limit:
        raise InputError(f"{what}: needs {math.ceil(needed)} MB, the limit is {limit:.0f} MB; {remedy}")


def peak_memory_mb() -> float:
    """Return the peak memory of this process so far, MB."""
    # Unlike /proc, the resource usage is what a process inherits from its parent.
    return proc_mb("self/status", "VmHWM") or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


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
    progress: Progress | None = None,
) -> Rendered:
    """Render the scene as an eye sees it through a window, without a display (see `render_rays`)."""
    near = scene.placement.near_mm
    if near is not None and near > eye_mm[2]:
        # Parts of the scene behind the eye are invisible.
        scene = replace(scene, placement=replace(scene.placement, near_mm=eye_mm[2], far_mm=None))
    return render_rays(scene, eye_source(eye_mm, window), settings, progress)

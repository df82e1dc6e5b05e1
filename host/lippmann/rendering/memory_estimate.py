"""Computes the sizes and the memory of a render's bands and chunks."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lippmann.base.machine import free_memory_mb
from lippmann.base.tones import BAND_ROWS
from lippmann.base.variant import current_device
from lippmann.display.description import Display
from lippmann.errors import InputError, located
from lippmann.rendering.options import Settings, Shading
from lippmann.rendering.pixel_filter import BYTES_A_PIXEL, is_filter_allowed
from lippmann.rendering.sampling import TILE_PX, colours_of

#: Number of samples in a chunk, keyed by device.
CHUNK_SAMPLES = {"llvm": 1 << 22, "cuda": 1 << 25}
#: Approximate number of pixels in a band, keyed by device.
BAND_PIXELS = {"llvm": 1 << 20, "cuda": 1 << 25}
#: Approximate maximum rays in a band (10 s of rendering), keyed by device.
BAND_RAYS = {"llvm": 1 << 26, "cuda": 1 << 31}
#: Pixels above which `lippmann render` keeps bands in files.
KEPT_PIXELS = 1 << 25
#: Rays above which `lippmann render` keeps bands in files.
KEPT_RAYS = 1 << 27
#: Additional memory of a render with the irradiance cache, MB.
CACHE_MEMORY_MB = 250.0
#: Measured memory of the libraries and one chunk, excluding the image, MB.
BASE_MEMORY_MB = 500.0
#: Measured memory of each ray beyond `CHUNK_SAMPLES` in a chunk of one tile, bytes.
RAY_BYTES = 80.0


def bands_of(width_px: int, height_px: int, rays: int, device: str | None = None) -> list[range]:
    """Return the rows of an image's bands. Every band starts at a multiple of `BAND_ROWS`."""
    device = device or current_device()
    pixels = min(BAND_PIXELS[device], BAND_RAYS[device] / rays)
    rows = BAND_ROWS * max(1, round(pixels / (width_px * BAND_ROWS)))
    return [range(first, min(first + rows, height_px)) for first in range(0, height_px, rows)]


def memory_mb(width_px: int, height_px: int, shading: Shading, samples: int, colours: int) -> float:
    """Return the memory in MB to render an image or a band; `samples` is per pixel and colour."""
    # Radiance is in memory three times: planes, image, and a capture's rotated image.
    needed = BASE_MEMORY_MB + 3.0 * width_px * height_px * 3 * 4 / 1e6
    if is_filter_allowed(samples, colours):
        # Use a band for "llvm": for "cuda", the filter is in the GPU's memory.
        band = len(bands_of(width_px, height_px, samples, "llvm")[0])
        needed += BYTES_A_PIXEL * band * width_px / 1e6
    needed += max(0, TILE_PX * TILE_PX * samples * colours - CHUNK_SAMPLES["llvm"]) * RAY_BYTES / 1e6
    return needed + (CACHE_MEMORY_MB if shading == "shared" else 0.0)


def check_display_memory(display: Display, settings: Settings, where: str) -> None:
    """Raise InputError, which names `where`, if a display's image exceeds the memory limit."""
    panel = display.panel
    with located(f"{where}: panel.width_px, panel.height_px"):
        check_memory(*panel.size_px, settings, colours_of(panel))


def check_memory(width_px: int, height_px: int, settings: Settings, colours: int) -> None:
    """Raise InputError if rendering an image exceeds the memory limit."""
    needed = memory_mb(width_px, height_px, settings.shading, settings.samples, colours)
    what = f"an image of {width_px} x {height_px} pixels"
    check_memory_mb(needed, settings.memory_mb, what, "raise memory_mb or use a smaller panel")


def check_memory_mb(needed: float, limit: float | None, what: str, remedy: str) -> None:
    """Raise InputError if `needed` MB exceed `limit`, by default 80 % of the free memory."""
    limit = math.floor(0.8 * free_memory_mb()) if limit is None else limit
    if not needed <= limit:
        raise InputError(f"{what}: needs {math.ceil(needed)} MB, the limit is {limit:.9g} MB; {remedy}")


def check_band_memory(display: Display, bands: Sequence[range], settings: Settings, workers: int = 1) -> None:
    """Raise InputError if all workers' bands, one each, exceed the memory limit."""
    rows, panel = max(len(rows) for rows in bands), display.panel
    needed = memory_mb(panel.width_px, rows, settings.shading, settings.samples, colours_of(panel))
    what = f"a band of {rows} rows of {panel.width_px} pixels"
    remedy = "raise memory_mb"
    if workers > 1:
        each = " or shading 'each'" if settings.shading == "shared" else ""
        what = f"{what} for each of {workers} workers"
        remedy = f"{remedy}, or give fewer workers{each}"
    check_memory_mb(workers * needed, settings.memory_mb, what, remedy)


def is_long_render(settings: Settings, display: Display) -> bool:
    """Tell whether `lippmann render` keeps a picture's bands in files."""
    pixels = display.panel.width_px * display.panel.height_px
    return pixels > KEPT_PIXELS or pixels * settings.samples * colours_of(display.panel) > KEPT_RAYS

"""Decides whether a render uses the irradiance cache; "auto" needs a trial on parts of the image."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lippmann.base.images import Radiance
from lippmann.base.tones import psnr_db
from lippmann.base.variant import Jit, current_device, dr, mi
from lippmann.rendering.lights import has_splats
from lippmann.rendering.options import Settings
from lippmann.rendering.sampling import TILE_PX, RaySource
from lippmann.rendering.surface_lattice import MAX_POINTS
from lippmann.scenes.scene import Scene

#: Radiance (pixels, 3) with and without the cache, and fraction of uncached samples.
Trial = tuple[Radiance, Radiance, float]
#: Minimum PSNR of a trial, dB, with which shading "auto" uses the cache.
CACHE_DB = 45.0
#: Minimum rays per point of the cache for shading "auto".
RAYS_A_POINT = 4
#: Minimum lamps for the cache: for one lamp, a trial costs too much (reports/shading.md).
MIN_LAMPS = 2
#: Number of image parts per axis that a trial compares.
TRIAL_PARTS = 4
#: Rays per colour in a trial: not 2^18, because Dr.Jit records again if a texture
#: has as many values as rays.
TRIAL_RAYS = 28 * 28 * 256
#: Maximum samples per pixel in a trial.
TRIAL_SAMPLES = 4
#: Seed of a trial's tile positions, whatever the render's seed.
TRIAL_SEED = 1
#: Minimum rays in a picture for which a trial saves time.
MIN_RAYS = 1 << 21
#: Maximum fraction of uncached samples for which the cache is used.
MAX_UNCACHED = 0.5
#: Pattern of a spot light with an image: its texture is not a uniform spectrum.
SPOT_PICTURE = re.compile(r"texture = (?!UniformSpectrum)")
#: Maximum lamps: a cache point has 32 bits, one per lamp and `shading.COMPUTED`.
MAX_LAMPS = 31
#: Mitsuba's classes of lamps whose irradiance is almost linear between points.
LAMPS = ("PointLight", "SpotLight", "DirectionalEmitter")


def why_not_cached(scene: Scene, source: RaySource, integrator: str) -> str | None:
    """Return why a scene cannot use the irradiance cache; None if it can."""
    if integrator != "lights":
        return f"the integrator {integrator} uses random numbers"
    if has_splats(scene.mitsuba):
        return "splats emit their own light"
    lamps = scene.mitsuba.emitters()
    are_plain = all(lamp.class_name() in LAMPS and not SPOT_PICTURE.search(str(lamp)) for lamp in lamps)
    if not (are_plain and 0 < len(lamps) <= MAX_LAMPS):
        return f"the scene has other lamps than 1 to {MAX_LAMPS} point, spot and directional lights without pictures"
    return "there are no lenslets" if source.detail_mm is None else None


def is_worth_a_trial(scene: Scene, rays: int) -> bool:
    """Return whether the cache, with its trial, can make a render of `rays` rays faster."""
    # A GPU traces a ray faster than it reads the cache.
    return len(scene.mitsuba.emitters()) >= MIN_LAMPS and current_device() != "cuda" and rays >= MIN_RAYS


def max_points(settings: Settings, rays: int) -> int:
    """Return the maximum number of cache points in a render of `rays` rays."""
    if settings.light_points is not None:
        return settings.light_points
    return min(MAX_POINTS, int(rays // RAYS_A_POINT)) if settings.shading == "auto" else MAX_POINTS


@dataclass(frozen=True)
class CacheTrial:
    """Tiles spread over an image, rendered with and without the cache."""

    source: RaySource
    #: Samples per pixel of the complete render.
    all_samples: int

    @property
    def samples(self) -> int:
        """Number of samples per pixel in the trial: an even selection of the render's samples."""
        return min(self.all_samples, TRIAL_SAMPLES)

    @property
    def _tile_grid(self) -> tuple[int, int]:
        return -(-self.source.height_px // TILE_PX), -(-self.source.width_px // TILE_PX)

    def _tiles(self) -> npt.NDArray[np.int64]:
        """Return the indices of the trial's tiles, in the row order of a square image."""
        side = max(1, math.isqrt(TRIAL_RAYS // (TILE_PX * TILE_PX * self.samples)) // TRIAL_PARTS) * TRIAL_PARTS
        within = np.random.default_rng(TRIAL_SEED).random((2, side, side))
        places = (np.mgrid[:side, :side] + within) / side
        rows, columns = (places * np.array(self._tile_grid)[:, None, None]).astype(np.int64).reshape(2, -1)
        tiles: npt.NDArray[np.int64] = rows * self._tile_grid[1] + columns
        return tiles

    def chunks(self) -> Iterator[tuple[Jit, Jit]]:
        """Yield sample indices and the first tile, as `CachedProgram.trial` takes them."""
        tiles, samples, colours = self._tiles(), self.samples, self.source.colours
        rays = TILE_PX * TILE_PX * self.all_samples * colours
        # All tiles are rendered at once if the sample indices fit into 31 bits.
        together = (tiles.max() + 1) * rays < 1 << 31
        for first, chunk in [(0, tiles)] if together else [(tile, np.zeros(1, np.int64)) for tile in tiles]:
            # Create indices by Dr.Jit: numpy's alignment would cause a new recording.
            lane = dr.arange(mi.UInt32, len(chunk) * TILE_PX * TILE_PX * colours * samples)
            group = lane // samples
            pixel = group // colours
            tile = dr.gather(mi.UInt32, mi.UInt32(chunk.astype(np.uint32)), pixel // (TILE_PX * TILE_PX))
            sample = (lane - group * samples) * self.all_samples // samples
            place = (pixel % (TILE_PX * TILE_PX) * colours + group % colours) * self.all_samples + sample
            index = tile * rays + place
            dr.make_opaque(index)
            yield index, dr.opaque(mi.UInt32, int(first))

    def psnr(self, trials: Sequence[Trial]) -> float | None:
        """Return the image parts' minimum PSNR, dB; None if most samples are uncached."""
        cached, own, uncached = zip(*trials, strict=True)
        if np.mean(uncached) > MAX_UNCACHED:
            return None
        side = math.isqrt(len(self._tiles()))
        pair = np.concatenate(cached), np.concatenate(own)
        a, b = (one.reshape(TRIAL_PARTS, side // TRIAL_PARTS, TRIAL_PARTS, -1, 3) for one in pair)
        return min(psnr_db(a[i, :, k], b[i, :, k]) for i in range(TRIAL_PARTS) for k in range(TRIAL_PARTS))

    def judge(self, trials: Sequence[Trial]) -> tuple[bool, str]:
        """Return whether the cache reaches `CACHE_DB` in all image parts, and a line for the log."""
        decibels = self.psnr(trials)
        if decibels is None:
            return False, "no irradiance cache: most rays meet surfaces that are too large or not diffuse"
        is_used = decibels >= CACHE_DB
        likeness = f"PSNR {math.floor(10 * decibels) / 10} dB" if math.isfinite(decibels) else "no difference"
        part = min(1.0, len(self._tiles()) / math.prod(self._tile_grid))
        verdict = f"{CACHE_DB:.0f} dB are needed, so it is {'' if is_used else 'not '}used"
        trial = f"irradiance cache, compared with each ray's own light in {100 * part:.3g} % of the picture"
        return is_used, f"{trial}: {likeness}; {verdict}"

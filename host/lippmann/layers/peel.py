"""Renders slabs of a Mitsuba scene: what an eye sees of the part between two depths, without what is in front of it.

Rays start at the slab's front, so that a slab holds what other slabs hide: when the eye moves, it is there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lippmann.base import interrupts
from lippmann.base.variant import current_device, mitsuba
from lippmann.layers.stack import Floats
from lippmann.optics.sampling import points_in_pixel
from lippmann.rendering.renderer import CHUNK_SAMPLES, Settings, first_hit, make_integrator
from lippmann.rendering.sampler import sampler_of
from lippmann.rendering.samples import Seeds
from lippmann.rendering.sources import Lines
from lippmann.scenes.scene import Scene

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Area:
    """A rectangle, mm, in the plane z = `depth_mm`; at a depth of infinity, of slopes dx/dz and dy/dz."""

    depth_mm: float
    left: float
    bottom: float
    right: float
    top: float

    @property
    def size(self) -> tuple[float, float]:
        """Width and height."""
        return self.right - self.left, self.top - self.bottom

    def grown(self, margin: float) -> Area:
        """Return the area with a margin on each side."""
        low, high = (self.left - margin, self.bottom - margin), (self.right + margin, self.top + margin)
        return Area(self.depth_mm, *low, *high)

    def matrix(self, width: int, height: int) -> Floats:
        """Return the matrix (2, 3) from (x, y, 1) to the texels of a texture that covers the area."""
        a, d = width / self.size[0], -height / self.size[1]
        return np.array([[a, 0.0, -a * self.left], [0.0, d, -d * self.top]])

    def cells(self, width: int, height: int, mask: Any, margin: tuple[float, float]) -> Area:
        """Return the part that the true cells of a mask (height, width) cover, larger by margins, within this area."""
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        across, down = self.size[0] / width, self.size[1] / height
        return Area(
            self.depth_mm,
            max(self.left, self.left + columns[0] * across - margin[0]),
            max(self.bottom, self.top - (rows[-1] + 1) * down - margin[1]),
            min(self.right, self.left + (columns[-1] + 1) * across + margin[0]),
            min(self.top, self.top - rows[0] * down + margin[1]),
        )


@dataclass(frozen=True)
class Slice:
    """What an eye sees of a slab: light (height, width, 3) times coverage, and coverage (height, width); float64."""

    light: Floats
    coverage: Floats


def peel(
    scene: Scene,
    area: Area,
    eye_mm: Point,
    between_mm: tuple[float, float],
    size: tuple[int, int],
    settings: Settings,
) -> Slice:
    """Return what an eye sees in an area, of the surfaces between two depths (front, back); others are transparent.

    `size` is (width, height). With a back of -infinity the scene's surroundings are seen, too.
    """
    mi = mitsuba()
    import drjit as dr

    width, height = size
    (front, back), samples = between_mm, settings.samples
    integrator = make_integrator(scene, settings)
    surroundings = math.isinf(back) and scene.mitsuba.environment() is not None
    light, coverage = np.empty((width * height, 3)), np.empty(width * height)
    seeds = Seeds(dr.opaque(mi.UInt32, settings.seed), dr.opaque(mi.UInt32, 0))
    for first, count in _chunks(width * height, samples):
        index = dr.arange(mi.UInt32, count * samples)
        texel = dr.opaque(mi.UInt32, first) + index // samples
        lines = _lines(area, eye_mm, size, texel, index % samples, settings)
        ray, valid, z = first_hit(scene, lines, front)
        seen = valid & (z >= dr.opaque(mi.Float, back))
        if surroundings:
            seen |= ~valid
        sampler = sampler_of(seeds, texel, index % samples)
        radiance, _, _ = integrator.sample(scene.mitsuba, sampler, ray, None, seen)
        colour = dr.select(seen, mi.Color3f(radiance), 0.0)
        share = dr.select(seen, mi.Float(1.0), 0.0)
        dr.eval(colour, share)
        for k, values in enumerate((*colour, share)):
            mean = np.asarray(dr.block_reduce(dr.ReduceOp.Add, values, samples), np.float64) / samples
            (coverage if k == 3 else light[:, k])[first : first + count] = mean
    return Slice(light.reshape(height, width, 3), coverage.reshape(height, width))


def seen_depths(
    scene: Scene, area: Area, eye_mm: Point, size: tuple[int, int], settings: Settings
) -> tuple[Floats, Floats]:
    """Return the depths (N,) of the surfaces that an eye sees in an area, and how much detail each of them shows (N,).

    Detail is the squared difference of neighbouring texels, which is the nearer one's: a surface hides with its edge
    what is behind it. The surroundings are at -infinity.
    """
    mi = mitsuba()
    import drjit as dr

    assert scene.placement.near_mm is not None
    front = min(scene.placement.near_mm, eye_mm[2])
    index = dr.arange(mi.UInt32, size[0] * size[1])
    # A single sample is at the texel's centre.
    lines = _lines(area, eye_mm, size, index, dr.zeros(mi.UInt32, size[0] * size[1]), replace(settings, samples=1))
    _, valid, z = first_hit(scene, lines, front)
    shape = size[1], size[0]
    depths = np.where(np.asarray(valid), np.asarray(z, np.float64), -np.inf).reshape(shape)
    colour = np.sqrt(np.clip(peel(scene, area, eye_mm, (front, -math.inf), size, settings).light, 0.0, 1.0))
    detail = np.zeros(shape)
    for axis in (0, 1):
        square = (np.diff(colour, axis=axis) ** 2).sum(axis=-1)
        one = (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1))
        other = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
        nearer = depths[one] > depths[other]
        detail[one] += np.where(nearer, square, 0.0)
        detail[other] += np.where(nearer, 0.0, square)
    there = np.isfinite(depths) | (scene.mitsuba.environment() is not None)
    return depths[there], detail[there]


def _chunks(texels: int, samples: int) -> Iterator[tuple[int, int]]:
    step = max(1, CHUNK_SAMPLES[current_device()] // samples)
    for first in range(0, texels, step):
        interrupts.check()
        yield first, min(step, texels - first)


def _lines(area: Area, eye_mm: Point, size: tuple[int, int], texel: Any, sample: Any, settings: Settings) -> Lines:
    """Return the lines from samples of an area's texels to an eye; of an area of slopes, through the origin."""
    mi = mitsuba()
    import drjit as dr

    # Opaque, so that another area or eye needs no compilation.
    columns = dr.opaque(mi.UInt32, size[0])
    left, top, across, down = (
        dr.opaque(mi.Float, value) for value in (area.left, area.top, area.size[0] / size[0], area.size[1] / size[1])
    )
    row = texel // columns
    s, t = points_in_pixel(texel, sample, settings.samples, settings.seed)
    x = left + (mi.Float(texel - row * columns) + s) * across
    y = top - (mi.Float(row) + t) * down
    if math.isinf(area.depth_mm):
        ray = dr.normalize(mi.Vector3f(x, y, 1.0))
        return Lines((mi.Float(0.0), mi.Float(0.0), mi.Float(0.0)), (ray.x, ray.y, ray.z), mi.Bool(True))
    eye_x, eye_y, eye_z, depth = (dr.opaque(mi.Float, value) for value in (*eye_mm, area.depth_mm))
    ray = dr.normalize(mi.Vector3f(eye_x - x, eye_y - y, eye_z - depth))
    return Lines((x, y, depth), (ray.x, ray.y, ray.z), mi.Bool(True))

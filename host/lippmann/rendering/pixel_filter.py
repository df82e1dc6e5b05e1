"""Filters pixels: samples near an edge also count for the neighbour under the same lenslet.

A pixel is a weighted mean of its samples and its four neighbours' samples. A sample at
x, y from the pixel's centre has the weight f(x) f(y). f(d) = (1/2 + s - |d|) / 2s is
limited to 0..1: a box of one pixel, blurred by a box of 2 s pixels (s = `softness`).
"""

from __future__ import annotations

import math

from lippmann.base.tones import BAND_ROWS
from lippmann.base.variant import Jit, current_device, dr, mi
from lippmann.optics.backend import DrJitBackend
from lippmann.optics.sample_points import points_in_pixel
from lippmann.rendering.sampling import RaySource, Seeds

#: Maximum samples of a filtered pixel. More samples need no filter.
MAX_SAMPLES = 4
#: Distance from a pixel's edge where weights begin to fall, in sample spacings.
SOFTNESS = 0.5
#: Offsets of a pixel's four neighbours, columns to the right and rows down.
SIDES = ((-1, 0), (1, 0), (0, -1), (0, 1))
#: Bytes per pixel: four sums for the pixel and each neighbour, and a lenslet number.
BYTES_A_PIXEL = 4 * 4 * (1 + len(SIDES)) + 4


def softness(samples: int) -> float:
    """Return the distance s from a pixel's edge, px, where the weights begin to fall."""
    return SOFTNESS / math.sqrt(samples)


def is_filter_allowed(samples: int, colours: int) -> bool:
    """Tell whether pixels can be filtered; sub-pixels of a colour are too far apart."""
    return colours == 1 < samples <= MAX_SAMPLES


def noise_fraction(samples: int, colours: int) -> float:
    """Return the approximate fraction of the noise that the filter leaves."""
    # With s = `softness`, the weights' mean square is 1 - 2 s / 3 along each axis.
    return 1.0 - 2.0 * softness(samples) / 3.0 if is_filter_allowed(samples, colours) else 1.0


def weight(distance: Jit, soft: float) -> Jit:
    """Return the weight, 0 to 1, of a sample at `distance` pixels along one axis."""
    return dr.clip((0.5 + soft - dr.abs(distance)) / (2.0 * soft), 0.0, 1.0)


def is_filtered(source: RaySource, samples: int) -> bool:
    """Tell whether a renderer filters the pixels of a ray source."""
    return source.owner is not None and is_filter_allowed(samples, source.colours)


class PixelFilter:
    """Filters a band: sums weighted samples for each pixel and its neighbours."""

    def __init__(self, source: RaySource, samples: int, rows: range) -> None:
        assert source.owner is not None
        self._owner = source.owner
        self._samples = samples
        self._rows = rows
        self._width = source.width_px
        pixels = len(rows) * source.width_px
        #: Sums of red, green, blue and weight: one array for the pixels, one per neighbour.
        self._sums = [dr.empty(mi.Float, 4 * pixels) for _ in range(1 + len(SIDES))]
        self._owners = dr.empty(mi.UInt32, pixels)

    def add(self, colour: Jit, pixel: Jit, inside: Jit, seeds: Seeds) -> None:
        """Add the samples of pixels; `pixel` has the pixels' indices in the image."""
        soft = softness(self._samples)
        number = dr.arange(mi.UInt32, dr.width(pixel)) * self._samples
        sums = [mi.Vector4f(0.0)] * len(self._sums)
        for k in range(self._samples):
            places = points_in_pixel(pixel, mi.UInt32(k), self._samples, seeds.image, seeds.number)
            x, y = (place - 0.5 for place in places)
            own = mi.Vector4f(*(dr.gather(mi.Float, channel, number + k) for channel in colour), 1.0)
            along, up = weight(x, soft), weight(y, soft)
            weights = [along * up]
            weights += [weight(x - dx, soft) * up if dx else weight(y - dy, soft) * along for dx, dy in SIDES]
            # `select` avoids 0 times an infinite colour.
            sums = [sum_ + dr.select(w > 0.0, w * own, 0.0) for sum_, w in zip(sums, weights, strict=True)]
        b = DrJitBackend(current_device())
        row = pixel // self._width
        owner = self._owner(b, b.double(pixel - row * self._width) + 0.5, b.double(row) + 0.5)
        place = pixel - dr.opaque(mi.UInt32, self._rows.start * self._width)
        for plane, value in zip(self._sums, sums, strict=True):
            dr.scatter(plane, value, place, inside)
        dr.scatter(self._owners, owner, place, inside)
        dr.eval(self._sums, self._owners)

    def colours(self) -> list[Jit]:
        """Return the filtered band's red, green and blue planes, row by row."""
        pixel = dr.arange(mi.UInt32, self._width * len(self._rows))
        # With opaque values, bands of other heights need no compilation.
        height, width = (dr.opaque(mi.Int32, value) for value in (len(self._rows), self._width))
        row = mi.Int32(pixel) // width
        column = mi.Int32(pixel) - row * width
        total = dr.gather(mi.Vector4f, self._sums[0], pixel)
        for plane, (dx, dy) in zip(self._sums[1:], SIDES, strict=True):
            # Add a neighbour's sum for this pixel, unless a multiple of `BAND_ROWS` separates them.
            x, y = column - dx, row - dy
            there = (x >= 0) & (x < width) & (y >= 0) & (y < height) & (y // BAND_ROWS == row // BAND_ROWS)
            neighbour = mi.UInt32(y * width + x)
            there &= dr.gather(mi.UInt32, self._owners, neighbour, there) == dr.gather(mi.UInt32, self._owners, pixel)
            total += dr.gather(mi.Vector4f, plane, neighbour, there)
        return [channel / total.w for channel in (total.x, total.y, total.z)]

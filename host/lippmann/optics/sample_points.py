"""Computes low-discrepancy sample points in a pixel, a lenslet's cell and a pupil.

The points depend on pixel index, sample index and seed, not on a render's chunks.
"""

from __future__ import annotations

from lippmann.base.variant import dr, mi
from lippmann.optics.backend import Arr, Backend, Point
from lippmann.optics.lattice import Lattice

#: Steps 1/g and 1/g^2 of the R2 sequence, with g^3 = g + 1 (M. Roberts, "The
#: unreasonable effectiveness of quasirandom sequences", 2018).
R2_STEPS = (0.7548776662466927, 0.5698402909980532)
#: Fractional part of the golden ratio, in units of 2^-32.
GOLDEN_STEP = 0x9E3779B9
#: Rounds of the Tiny Encryption Algorithm. With four rounds, neighbouring pixels correlate.
HASH_ROUNDS = 6


def pixel_steps(samples: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the start and the step of a pixel's samples along each axis, in units of 2^-32, modulo 1.

    Sample k of N is at 1/2 + c (1/N, (sqrt(5) - 1) / 2) with c = k - (N - 1) / 2.
    Samples are Hammersley's points with golden-ratio steps, not van der Corput's.
    """
    across = (1 << 32) // samples & 0xFFFFFFFF
    return (across >> 1, across), ((1 << 31) - (samples - 1) * GOLDEN_STEP // 2 & 0xFFFFFFFF, GOLDEN_STEP)


def points_in_pixel(pixel: Arr, sample: Arr, samples: int, seed: Arr, number: Arr = 0) -> Point:
    """Return points in the unit square for pixel and sample indices (UInt32); see `pixel_steps`.

    A hash of pixel and seed mirrors a pixel's points or exchanges their axes, so that
    errors differ between pixels, and partly between seeds. Random shifts of the points
    would make the error at a straight edge 1.1 to 1.4 times as large. In pass `number`
    over a picture, points continue the golden steps along one axis, and shift by less
    than 1/N of the pixel's width along the other.
    """
    if samples == 1:
        return mi.Float(0.5), mi.Float(0.5)
    # The seed is opaque, so that another seed compiles no new program.
    own = dr.opaque(mi.UInt32, seed) if isinstance(seed, int) else seed
    flips, _ = mi.sample_tea_32(pixel, own, HASH_ROUNDS)

    number = mi.UInt32(number)
    moves = mi.UInt32(mi.Int32(number * GOLDEN_STEP) // samples), number * (samples * GOLDEN_STEP & 0xFFFFFFFF)

    def along(axis: int, mirrored: Arr) -> Arr:
        first, step = pixel_steps(samples)[axis]
        place = (first + sample * step + moves[axis]) ^ dr.select(mirrored, mi.UInt32(0xFFFFFFFF), 0)
        # A float32 holds 24 bits exactly, so no point is rounded up to 1.
        return mi.Float(place >> 8) * 2.0**-24

    x, y = along(0, (flips & 1) != 0), along(1, (flips & 2) != 0)
    exchanged = (flips & 4) != 0
    return dr.select(exchanged, y, x), dr.select(exchanged, x, y)


def points_in_square(pixel: Arr, sample: Arr, seed: Arr, stream: int = 1) -> Point:
    """Return points (s, t) in the unit square of a cell or pupil, for pixel and sample indices.

    The points are the R2 sequence, shifted modulo 1 by a hash of pixel and seed. Stream
    0 is independent of stream 1 and serves an eye's view, as in the viewer page's
    sampling.glsl.
    """
    # Rounding must not move a point to 1, which belongs to the next cell.
    below_one = 1.0 - 2.0**-24

    def coordinate(axis: int) -> Arr:
        own = dr.opaque(mi.UInt32, seed) if isinstance(seed, int) else seed
        key = own + mi.UInt32((2 * stream + axis) * GOLDEN_STEP & 0xFFFFFFFF)
        shift = mi.sample_tea_float32(pixel, key, HASH_ROUNDS)
        x = shift + mi.Float(sample) * R2_STEPS[axis]
        return dr.minimum(x - dr.floor(x), below_one)

    return coordinate(0), coordinate(1)


def square_to_cell(b: Backend, s: Arr, t: Arr, lattice: Lattice) -> Point:
    """Map points (s, t) of the unit square to a lenslet's cell, in lens-local mm; equal areas stay equal."""
    px, py = lattice.pitches_mm
    if lattice.grid == "square":
        return lattice.sheared((s - 0.5) * px, (t - 0.5) * py)
    # Three rhombi around the centre fill a hexagon, each between two corner vectors.
    corners = lattice.corners[::2]
    rhombus = b.minimum(b.floor(3.0 * s), 2.0)
    s = 3.0 * s - rhombus
    x = y = 0.0 * s
    for k, ((ax, ay), (bx, by)) in enumerate(zip(corners, corners[1:] + corners[:1], strict=True)):
        x = b.where(rhombus == k, s * ax + t * bx, x)
        y = b.where(rhombus == k, s * ay + t * by, y)
    return x, y

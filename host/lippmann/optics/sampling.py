"""Sample points in a pixel, a lenslet's cell and a pupil: low-discrepancy, the same for the same seed.

Sample s of pixel k is the s-th point of the R2 sequence (M. Roberts, "The unreasonable effectiveness of
quasirandom sequences", 2018: steps 1/g and 1/g^2, g the real root of g^3 = g + 1), shifted modulo 1 by a hash of pixel
and seed. Pictures therefore do not depend on how the work is cut into chunks.
"""

from __future__ import annotations

import math
from typing import Any

from lippmann.optics.backend import Arr, Backend
from lippmann.optics.lattice import HALF_SQRT3, Lattice
from lippmann.variant import mitsuba

R2_STEPS = (0.7548776662466927, 0.5698402909980532)


def points_in_square(pixel: Any, sample: Any, seed: Any, stream: int) -> tuple[Any, Any]:
    """Return points in the unit square for pixel and sample numbers (UInt32), and a seed; streams are independent."""
    mi = mitsuba()
    import drjit as dr

    # Rounding must not bring a point onto the square's far edge, which belongs to the next cell.
    below_one = 1.0 - 2.0**-24

    def coordinate(axis: int) -> Any:
        # Opaque, so that another seed needs no compilation.
        own = dr.opaque(mi.UInt32, seed) if isinstance(seed, int) else seed
        key = own + mi.UInt32((2 * stream + axis) * 0x9E3779B9 & 0xFFFFFFFF)
        shift = mi.sample_tea_float32(pixel, key)
        x = shift + mi.Float(sample) * R2_STEPS[axis]
        return dr.minimum(x - dr.floor(x), below_one)

    return coordinate(0), coordinate(1)


def square_to_cell(b: Backend, s: Arr, t: Arr, lattice: Lattice) -> tuple[Arr, Arr]:
    """Map points (s, t) of the unit square to a lenslet's cell, with equal areas for equal areas; lens-local mm."""
    px, py = lattice.pitches_mm
    if lattice.grid == "square":
        return lattice.sheared((s - 0.5) * px, (t - 0.5) * py)
    # A hexagon is three rhombi round its centre; each is spanned by two of its corner vectors.
    radius, tall = px / (2.0 * HALF_SQRT3), py / px
    corners = [
        lattice.sheared(radius * math.cos(a), radius * math.sin(a) * tall)
        for a in (math.pi / 6.0, 5.0 * math.pi / 6.0, 1.5 * math.pi)
    ]
    rhombus = b.minimum(b.floor(3.0 * s), 2.0)
    s = 3.0 * s - rhombus
    x = y = 0.0 * s
    for k, ((ax, ay), (bx, by)) in enumerate(zip(corners, corners[1:] + corners[:1], strict=True)):
        x = b.where(rhombus == k, s * ax + t * bx, x)
        y = b.where(rhombus == k, s * ay + t * by, y)
    return x, y

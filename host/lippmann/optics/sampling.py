"""Sample points inside a pixel, a lenslet's cell and a pupil: low-discrepancy, the same for the same seed.

Sample s of pixel k is the s-th point of the R2 sequence (M. Roberts, "The unreasonable effectiveness of
quasirandom sequences", 2018: steps 1/g and 1/g^2, g the real root of g^3 = g + 1), shifted modulo 1 by a hash of pixel
and seed. Pictures therefore do not depend on how the work is cut into chunks.
"""

from __future__ import annotations

import math
from typing import Any

from lippmann.optics.lattice import HALF_SQRT3
from lippmann.variant import mitsuba

R2_STEPS = (0.7548776662466927, 0.5698402909980532)


def points_in_square(pixel: Any, sample: Any, seed: int, stream: int) -> tuple[Any, Any]:
    """Return points in the unit square for pixel and sample numbers (UInt32); streams are independent."""
    mi = mitsuba()
    import drjit as dr

    shift_x = mi.sample_tea_float32(pixel, mi.UInt32((2 * stream * 0x9E3779B9 + seed) & 0xFFFFFFFF))
    shift_y = mi.sample_tea_float32(pixel, mi.UInt32(((2 * stream + 1) * 0x9E3779B9 + seed) & 0xFFFFFFFF))
    x = shift_x + mi.Float(sample) * R2_STEPS[0]
    y = shift_y + mi.Float(sample) * R2_STEPS[1]
    # Rounding must not bring a point onto the square's far edge, which is the next cell's.
    below_one = 1.0 - 2.0**-24
    return dr.minimum(x - dr.floor(x), below_one), dr.minimum(y - dr.floor(y), below_one)


def square_to_cell(s: Any, t: Any, grid: str, pitch_mm: float) -> tuple[Any, Any]:
    """Map the unit square to a lenslet's cell, area-true; lens-local mm."""
    mi = mitsuba()
    import drjit as dr

    if grid == "square":
        return (s - 0.5) * pitch_mm, (t - 0.5) * pitch_mm
    # A hexagon is three rhombi round its centre; each is spanned by two of its corner vectors.
    radius = pitch_mm / (2.0 * HALF_SQRT3)
    which = dr.minimum(dr.floor(3.0 * s), 2.0)
    s = 3.0 * s - which
    corners = [
        (radius * math.cos(a), radius * math.sin(a)) for a in (math.pi / 6.0, 5.0 * math.pi / 6.0, 1.5 * math.pi)
    ]
    x, y = mi.Float(0.0), mi.Float(0.0)
    for k in range(3):
        (ax, ay), (bx, by) = corners[k], corners[(k + 1) % 3]
        x = dr.select(which == k, s * ax + t * bx, x)
        y = dr.select(which == k, s * ay + t * by, y)
    return x, y

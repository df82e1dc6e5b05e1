"""unit_slope against its twin: along the axis, along each coordinate, up to 60 degrees, and beyond."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.ray_start import unit_slope
from lippmann.fixed.words import extra_bits
from steps import FRACTIONS, stream_step
from words import mixed, word


@pytest.mark.parametrize("extra", [0, 1])
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, extra, seed, rng, seen):
    extra = min(extra, extra_bits(f))  # no build of so few fraction bits has wider words
    b = f + extra
    most = int(np.sqrt(3.0) * (1 << b)) - 1
    mx, my = mixed(rng, 4000, (-most, most), (-most, most))
    angle, size = rng.random(1500) * 2 * np.pi, np.sqrt(3.0) * (1 - rng.random(1500) ** 4 * 0.5)
    mx = np.concatenate([mx, word(size * np.cos(angle), b)])
    my = np.concatenate([my, word(size * np.sin(angle), b)])
    square = mx * mx + my * my
    # 3 itself does not fit; the sum is rounded.
    within = square < (3 << (2 * b)) - (1 << (f + 2 * extra))
    steep_x, steep_y = mixed(rng, 1000, (-(2 << b), (2 << b) - 1), (-(2 << b), (2 << b) - 1))
    mx, my = np.concatenate([mx[within], steep_x]), np.concatenate([my[within], steep_y])
    square = (mx * mx + my * my).astype(np.float64) / 4**extra
    ex, ey, ez, beyond = unit_slope(mx, my, f, extra)
    out = {"ex_o": ex, "ey_o": ey, "ez_o": ez, "beyond_o": beyond.astype(np.int64)}
    stream_step(f"unit_slope-{extra}", f, [Segment({}, {"mx_i": mx, "my_i": my}, out)], seed)
    # The sum of squares is rounded to F + 1 fraction bits.
    assert (
        beyond[np.abs(square - (3 << 2 * f)) > 1 << f] == (square > 3 << 2 * f)[np.abs(square - (3 << 2 * f)) > 1 << f]
    ).all()

    seen.point("along the axis", (mx == 0) & (my == 0))
    seen.point("along x", (mx != 0) & (my == 0))
    seen.point("along y", (mx == 0) & (my != 0))
    seen.point("lower octave", square < 1 << (2 * f))
    seen.point("upper octave", square > 1 << (2 * f))
    seen.point("within 1 % of 60 degrees", (square > 2.94 * (1 << (2 * f))) & (square < 3 << (2 * f)))
    seen.point("steeper than 60 degrees", square > 3 << (2 * f))
    for name, e in (("x", ex), ("y", ey)):
        seen.point(f"{name} negative", e < 0)
        seen.point(f"{name} positive", e > 0)

"""shear against its twin, and against the formula in whole numbers: every end of every word."""

from fractions import Fraction

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.ray_start import shear
from steps import FRACTIONS, stream_step
from words import mixed, signed


@pytest.mark.parametrize("more", [0, 2], ids=["wide", "far"])
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, more, seed, rng, seen):
    near, far = signed(f + 2 + more), signed(f + 4)
    segments = []
    for g in [0, 1, -1, *far, *rng.integers(-(1 << f), 1 << f, 6).tolist(), *rng.integers(*far, 6).tolist()]:
        x, y = mixed(rng, 150, near, near)
        sheared, beyond = shear(x, y, g, f, f + 2 + more)
        segments.append(Segment({"g_i": g}, {"x_i": x, "y_i": y}, {"x_o": sheared, "beyond_o": beyond}))
        # The product is cut twice, each by less than an eighth, and drops one of two lower parts of up to 9 bits.
        whole = [Fraction(int(p)) + Fraction(int(q) * int(g), 1 << f) for p, q in zip(x, y, strict=True)]
        away = np.array([float(int(got) - value) for got, value in zip(sheared, whole, strict=True)])[~beyond]
        assert ((away > -0.5 - 0.25 - 2.0 ** (18 - f)) & (away <= 0.5)).all()
        assert g or (sheared == x).all()
        seen.point("beyond", beyond)
        seen.point("within", ~beyond)
        seen.point("moved", ~beyond & (sheared != x))
        seen.point("no shear", g == 0)
    stream_step("shear" + "-far" * (more > 0), f, segments, seed)

"""rsqrt against its twin; all of its inputs in tests/rtl/roots."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.words import rsqrt
from steps import FRACTIONS, stream_step
from words import around


@pytest.mark.parametrize("extra", range(4))
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, extra, seed, rng, seen):
    one = 1 << (f + 1)
    x = np.concatenate([
        around([one, 2 * one, 3 * one, 4 * one], 300, one, 4 * one - 1), rng.integers(one, 4 * one, 5000),
    ])  # fmt: skip
    y = rsqrt(x, f, extra)
    stream_step(f"rsqrt-{extra}", f, [Segment({}, {"x_i": x}, {"y_o": y})], seed)

    seen.point("lower octave", x < 2 * one)
    seen.point("upper octave", x >= 2 * one)
    seen.point("1, to the last place", np.abs(y - (one << extra)) <= 1)
    seen.point("1", x == one)
    seen.point("just below 2", x == 2 * one - 1)
    seen.point("largest input", x == 4 * one - 1)

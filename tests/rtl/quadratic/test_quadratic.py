"""quadratic against its twin: every segment of both octaves, at its ends and in its middle."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.words import quadratic
from steps import FRACTIONS, stream_step
from words import around


@pytest.mark.parametrize("root", ["reciprocal", "square"])
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, root, seed, rng, seen):
    one, a = 1 << (f + 1), f // 3
    ends = np.concatenate([octave + (octave >> a) * np.arange(1 << a) for octave in (one, 2 * one)])
    middles = ends + np.repeat([one, 2 * one], 1 << a) // (2 << a)
    x = np.concatenate([around(ends, 2, one, 4 * one - 1), around(middles, 2, one, 4 * one - 1), [4 * one - 1]])
    x = np.concatenate([x, rng.integers(one, 4 * one, 4000)])
    stream_step(f"quadratic-{root}", f, [Segment({}, {"x_i": x}, {"y_o": quadratic(x, root, f)})], seed)

    upper = x >= 2 * one
    segment = ((x - np.where(upper, 2, 1) * one) >> (f + 1 - a + upper)) + (upper << a)
    seen.point("lower octave", ~upper)
    seen.point("upper octave", upper)
    seen.point("every segment", len(np.unique(segment)) == 2 << a)
    seen.point("first of a segment", np.isin(x, ends))
    seen.point("last of a segment", np.isin(x + 1, ends))

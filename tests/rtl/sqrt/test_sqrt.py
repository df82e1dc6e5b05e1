"""sqrt against its twin: every shift that normalises, from one bit to all."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.words import sqrt
from steps import FRACTIONS, stream_step
from words import around, specials


@pytest.mark.parametrize("extra", range(4))
@pytest.mark.parametrize("f", FRACTIONS)
def test_normalised_equals_twin(f, extra, seed, rng, seen):
    bits = f + 3
    top = (1 << bits) - 1
    # As many words of every magnitude.
    magnitude = rng.integers(0, bits, 6000)
    x = np.concatenate([specials(0, top), around(4 ** np.arange(bits // 2 + 1), 20, 0, top),
                        (1 << magnitude) + (rng.random(6000) * (1 << magnitude)).astype(np.int64)])  # fmt: skip
    y = sqrt(x, f, extra=extra)
    stream_step(f"sqrt-1-{extra}", f, [Segment({}, {"x_i": x}, {"y_o": y})], seed)

    # The shift from the number of bits, not by the twin's steps.
    length = np.array([int(word).bit_length() for word in x])
    seen.values("shift by", np.where(x > 0, (bits - length) // 2, -1), range((bits - 1) // 2 + 1))
    seen.point("zero", x == 0)
    seen.point("smallest", x == 1)
    # With all places kept the root's own error may show.
    seen.point("largest, at the largest word", (x == top) & (y >= (1 << (f + 1 + extra)) - 1 - extra))


@pytest.mark.parametrize("extra", range(4))
@pytest.mark.parametrize("f", FRACTIONS)
def test_plain_equals_twin(f, extra, seed, rng, seen):
    quarter = 1 << (f + 1)
    x = np.concatenate([
        around([quarter, 2 * quarter, 3 * quarter, 4 * quarter], 300, quarter, 4 * quarter - 1),
        rng.integers(quarter, 4 * quarter, 5000),
    ])  # fmt: skip
    y = sqrt(x, f, normalise=False, extra=extra)
    stream_step(f"sqrt-0-{extra}", f, [Segment({}, {"x_i": x}, {"y_o": y})], seed)

    seen.point("lower octave", x < 2 * quarter)
    seen.point("upper octave", x >= 2 * quarter)

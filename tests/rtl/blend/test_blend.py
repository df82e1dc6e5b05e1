"""blend against its twin: every end of every word, one product and two."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.ray_start import blend
from lippmann.fixed.words import extra_bits
from steps import FRACTIONS, stream_step
from words import mixed, signed


@pytest.mark.parametrize(
    ("more", "aim", "second", "slope"),
    [(0, 0, 0, 0), (0, 0, 1, 0), (2, 0, 0, 0), (2, 0, 1, 0), (2, 2, 1, 0), (2, 2, 0, 1), (2, 2, 1, 1)],
    ids=["wide-0", "wide-1", "far-0", "far-1", "upright", "slope-0", "slope-1"],
)  # fmt: skip
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, more, aim, second, slope, seed, rng, seen):
    extra = slope * extra_bits(f)
    near = signed(f + 2 + extra)
    segments = []
    for k, m in zip(*(w.tolist()[:35] for w in mixed(rng, 10, near, near)), strict=True):
        x, a = mixed(rng, 100, signed(f + 2 + more), signed(f + 2 + aim))
        bits = f + 2 + (extra if slope else more > 0)
        y, beyond = blend(k, x, m, a if second else None, f, bits, f + 2 + more, f + 2 + aim, extra)
        whole = x.astype(object) * k + (a.astype(object) * m if second else 0)
        seen.point("rounded up", (y << f) > whole)
        seen.point("rounded down", (y << f) < whole)
        outside = np.abs(whole) >> f >= (1 << (bits - 1))
        # The sum is rounded to F fraction bits.
        sure = np.abs(np.abs(whole) - (1 << (bits - 1 + f))) > 2 << f
        assert (beyond == outside)[sure].all()
        seen.point("beyond the word", beyond)
        seen.point("not beyond the word", ~beyond)
        segments.append(Segment({"k_i": k, "l_i": m}, {"x_i": x, "a_i": a}, {"y_o": y, "beyond_o": beyond.astype(int)}))
    name = f"-slope-{extra}" if slope else "-upright" if aim else "-far" if more else ""
    stream_step(f"blend-{second}{name}", f, segments, seed)

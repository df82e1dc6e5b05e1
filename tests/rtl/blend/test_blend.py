"""blend against its twin: every end of every word, one product and two."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.blend import blend
from rtl_coverage import Coverage
from runner import seed
from steps import FRACTIONS, stream_step
from words import mixed, signed


@pytest.mark.parametrize("second", [0, 1])
@pytest.mark.parametrize("more", [0, 2], ids=["wide", "far"])
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, more, second):
    s = seed()
    rng = np.random.default_rng(s)
    near = signed(f + 2)
    seen = Coverage("blend", f"{second}-{more}-F{f}")
    segments = []
    for k, m in zip(*(w.tolist()[:35] for w in mixed(rng, 10, near, near)), strict=True):
        x, a = mixed(rng, 100, signed(f + 2 + more), near)
        y = blend(k, x, m, a if second else None, f, f + 2 + more)
        whole = x.astype(object) * k + (a.astype(object) * m if second else 0)
        seen.point("rounded up", (y << f) > whole)
        seen.point("rounded down", (y << f) < whole)
        seen.point("beyond the word", np.abs(whole) >> (2 * f) >= 4)
        segments.append(Segment({"k_i": k, "l_i": m}, {"x_i": x, "a_i": a}, {"y_o": y}))
    stream_step(f"blend-{second}" + "-far" * (more > 0), f, segments, s)
    seen.close()

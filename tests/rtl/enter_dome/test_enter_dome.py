"""enter_dome against its twin: along the normal, grazing, and words without any sense."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.lenslet_faces import Meeting, enter_dome
from steps import FRACTIONS, stream_step
from words import mixed, signed, word


@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, seed, rng, seen):
    near, one = signed(f + 2), 1 << (f + 3)
    segments = []
    indices = [(int(word(1 / n, f + 1)), int(word(1 / n**2, f))) for n in (1.16, 1.5, 2.2, *rng.uniform(1.16, 2.2, 3))]
    indices += [(1, square) for square in (1, -1, signed(f + 4)[1])]
    indices += [(near[1], square) for square in (-(1 << f), (1 << f) - 1, signed(f + 4)[1])]
    for inverse, square in indices:
        # nx, ny, cos, ex, ey, s: cosine and sine are never negative.
        words = mixed(rng, 500, near, near, (0, near[1]), near, near, (0, one - 1))
        cos = np.cos(rng.random(300) * np.pi / 2)
        cos[:3] = 1, 0, 1e-3
        real = mixed(rng, 300, near, near, (0, near[1]), near, near, (0, one - 1))
        real = [w[-300:] for w in real]
        real[2], real[5] = np.minimum(word(cos, f + 1), near[1]), np.clip(word(1 - cos**2, f + 3), 0, one - 1)
        nx, ny, c, ex, ey, s = (np.concatenate(pair) for pair in zip(words, real, strict=True))
        nothing = np.zeros(len(nx), np.int64)
        met = Meeting(nx, ny, nothing, c, s, nothing == 1, nothing == 1)
        dx, dy, beyond = enter_dome(met, ex, ey, inverse, square, f)
        inputs = {"nx_i": nx, "ny_i": ny, "cos_i": c, "s_i": s, "ex_i": ex, "ey_i": ey}
        config = {"index_inverse_i": inverse, "index_inverse_square_i": square}
        segments.append(Segment(config, inputs, {"dx_o": dx, "dy_o": dy, "beyond_o": beyond.astype(np.int64)}))
        behind = one - (s.astype(object) * square >> f)
        assert beyond[(behind < 0) | (behind > one + 1024)].all()
        seen.point("not beyond", ~beyond)
        seen.point("beyond, cosine behind between 0 and 1", beyond & (behind >= 0) & (behind <= one))
        seen.point("along the normal", s == 0)
        seen.point("grazing", (c == 0) & (s == one - 1))
        seen.point("no cosine behind: held at 0", behind < 0)
        seen.point("steep in the glass", (behind > 0) & (behind < one // 4))
        for name, out in (("dx", dx), ("dy", dy)):
            seen.point(f"{name} saturated above", out == near[1])
            seen.point(f"{name} saturated below", out == near[0])
            seen.point(f"{name} between", (out > near[0]) & (out < near[1]))
    stream_step("enter_dome", f, segments, seed)

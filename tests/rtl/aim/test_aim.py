"""aim against its twin: aims into every neighbour, points that leave the words."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.ray_start import aim
from steps import FRACTIONS, GRIDS, stream_step
from words import around, mixed, signed


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, grid, seed, rng, seen):
    near = signed(f + 2)
    i, j, x, y, a, b = mixed(rng, 3000, signed(12), signed(12), near, near, near, near)
    edge = around(np.arange(-3, 4) << (f - 1), 1, *near)
    some = slice(-1500, None)
    a[some], b[some] = rng.choice(edge, 1500), rng.choice(edge, 1500)
    half = (-(1 << (f - 1)), 1 << (f - 1))
    x[some], y[some] = rng.integers(*half, 1500), rng.integers(*half, 1500)
    out = aim(i, j, x, y, a, b, grid, f)
    words = {"i_i": i, "j_i": j, "x_i": x, "y_i": y, "a_i": a, "b_i": b}
    expected = {f"{name}_o": word for name, word in out._asdict().items()}
    stream_step(f"aim-{grid}", f, [Segment({}, words, expected)], seed)

    di, dj = ((out.i - i + 2048) & 4095) - 2048, ((out.j - j + 2048) & 4095) - 2048
    steps = ["0 0", "1 0", "0 1", "-1 0", "0 -1", "1 -1", "-1 1"]
    seen.values("step", [f"{p} {q}" for p, q in zip(di, dj, strict=True)], steps)
    seen.point("beyond", out.beyond)
    seen.point("not beyond, another lenslet", ~out.beyond & out.stray)
    seen.point("index wraps", np.abs(out.i - i) > 4)
    wraps = (np.abs(out.i - i) > 4) | (np.abs(out.j - j) > 4)
    assert out.beyond[wraps].all()

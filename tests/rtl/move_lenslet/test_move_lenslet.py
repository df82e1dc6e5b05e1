"""move_lenslet against its twin: every step, odd and even pitches."""

import pytest
from bench import Segment
from lippmann.fixed.lenslet_faces import move_lenslet
from steps import FRACTIONS, GRIDS, stream_step
from words import mixed, signed


@pytest.mark.parametrize("sheared", [False, True], ids=["upright", "sheared"])
@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, grid, sheared, seed, rng, seen):
    low, top = signed(f + 2)
    segments = []
    for cx, cy in [(1, 1), (2, 3), (top, top), (top - 1, top), *rng.integers(1, top, (4, 2)).tolist()]:
        hx, hy, di, dj = mixed(rng, 500, signed(f + 3), signed(f + 3), (-1, 1), (-1, 1))
        rx = int(rng.choice([low, top, 0, *rng.integers(low, top, 3)]))
        x, y, beyond = move_lenslet(hx, hy, di, dj, cx, cy, rx, grid, f, sheared)
        words = {"hx_i": hx, "hy_i": hy, "di_i": di, "dj_i": dj}
        out = {"hx_o": x, "hy_o": y, "beyond_o": beyond.astype(int)}
        segments.append(Segment({"cx_i": cx, "cy_i": cy, "rx_i": rx}, words, out))
        seen.point("beyond", beyond)
        seen.point("not beyond", ~beyond)
    stream_step(f"move_lenslet-{grid}" + "-sheared" * sheared, f, segments, seed)

"""lenslet_square against its twin: cell edges, both ends of the indices."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.ray_start import lenslet_square
from steps import FRACTIONS, stream_step
from words import around, mixed, signed


@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, seed, rng, seen):
    low, high = signed(12 + f)
    cells = np.array([-2048, -2047, -1, 0, 1, 2046, 2047])
    edge = around((cells << f) + (1 << (f - 1)), 1, low, high)
    x, y = mixed(rng, 2000, (low, high), (low, high))
    x = np.concatenate([x, np.repeat(edge, len(edge)), rng.choice(edge, 500)])
    y = np.concatenate([y, np.tile(edge, len(edge)), rng.integers(low, high, 500)])
    i, j, local_x, local_y, beyond = lenslet_square(x, y, f)
    out = {"i_o": i, "j_o": j, "x_o": local_x, "y_o": local_y, "beyond_o": beyond.astype(np.int64)}
    stream_step("lenslet_square", f, [Segment({}, {"x_i": x, "y_i": y}, out)], seed)

    last = (2047 << f) + (1 << (f - 1))
    assert (beyond == (x >= last) | (y >= last)).all()
    seen.point("an index wraps", beyond)
    for name, local, index in (("x", local_x, i), ("y", local_y, j)):
        seen.point(f"{name} on the lower edge", local == -(1 << (f - 1)))
        seen.point(f"{name} just below the upper edge", local == (1 << (f - 1)) - 1)
        seen.point(f"{name} in the middle", local == 0)
        seen.point(f"{name} in the first and last cell", (index == -2048) | (index == 2047))

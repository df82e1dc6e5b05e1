"""lenslet_hex against its twin: edges and vertices of the cells, both ends of the indices."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.ray_start import lenslet_hex
from steps import FRACTIONS, stream_step
from words import mixed, signed

#: Vertices of the cell, in sixths of a pitch and of a row.
VERTICES = np.array([(3, 2), (0, 4), (-3, 2), (-3, -2), (0, -4), (3, -2)])


def borders(rng, f):
    """Points on edges and vertices of cells, with their neighbours."""
    i, j = rng.integers(-1000, 1000, (2, 40))
    at, following = rng.integers(0, 6, 40), rng.choice([0.0, 1.0, 0.5, 0.3], 40)
    corner = VERTICES[at] * (1 - following[:, None]) + VERTICES[(at + 1) % 6] * following[:, None]
    x = np.floor((i + j / 2 + corner[:, 0] / 6) * (1 << f)).astype(np.int64)
    y = np.floor((j + corner[:, 1] / 6) * (1 << f)).astype(np.int64)
    dx, dy = np.meshgrid(np.arange(-2, 3), np.arange(-2, 3))
    return (x[:, None] + dx.ravel()).ravel(), (y[:, None] + dy.ravel()).ravel()


@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, seed, rng, seen):
    border_x, border_y = borders(rng, f)
    x, y = mixed(rng, 3000, signed(12 + f), signed(12 + f))
    x, y = np.concatenate([x, border_x]), np.concatenate([y, border_y])
    i, j, local_x, local_y, beyond = lenslet_hex(x, y, f)
    out = {"i_o": i, "j_o": j, "x_o": local_x, "y_o": local_y, "beyond_o": beyond.astype(np.int64)}
    stream_step("lenslet_hex", f, [Segment({}, {"x_i": x, "y_i": y}, out)], seed)

    # The indices are right where they do not wrap, and 4096 off where they do.
    off = np.stack([(x - local_x) / (1 << f) - (y - local_y) / (2 << f) - i, (y - local_y) / (1 << f) - j])
    assert (beyond == (np.abs(off) > 1).any(axis=0)).all()
    seen.point("an index wraps", beyond)
    di = (i - ((2 * x - y) >> (f + 1))) & 1
    dj = (j - (y >> f)) & 1
    seen.values("corner", 2 * di + dj, range(4))
    unit = 1 << f
    q0, q1 = 2 * local_x, local_x + 3 * local_y // 2
    seen.point("right and left edge", (q0 == -unit) | (q0 == unit - 2))
    seen.point("upper right edge", np.abs(q1 - unit) <= 2)
    seen.point("lower left edge", np.abs(q1 + unit) <= 2)
    for number, (vx, vy) in enumerate(VERTICES):
        near = (np.abs(6 * local_x - vx * unit) <= 24) & (np.abs(6 * local_y - vy * unit) <= 24)
        seen.point(f"vertex {number}", near)

"""gated_sum: sums of random and extreme words behind random gates, and of two rows of a product."""

from bench import Segment
from parts import GATED_SUMS, gated_sum, stream_parts
from words import mixed


def test_is_the_sum_of_what_the_gates_pass(seed, rng, seen):
    batch = []
    for w in GATED_SUMS:
        whole = (1 << w) - 1
        a, x, b, y = mixed(rng, 600, *[(0, whole)] * 4)
        x[::3], y[::4] = whole, whole
        total = ((a & x) + (b & y)) & whole
        batch.append((gated_sum(w), Segment({}, {"a_i": a, "x_i": x, "b_i": b, "y_i": y}, {"s_o": total})))
        seen.point("a carry through all bits", (a & x == whole) & (b & y == 1))
        seen.point("a carry out", (a & x) + (b & y) > whole)
    stream_parts(batch, seed)

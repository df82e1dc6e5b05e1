"""low_product: a signed word by a few unsigned bits, at its own latency and at a raised one."""

from bench import Segment
from parts import LOWS, low_product, stream_parts
from words import mixed, signed


def test_is_the_product_for_all_parameters(seed, rng, seen):
    batch = []
    for low, latency in LOWS:
        a, b = mixed(rng, 200, signed(18), (0, (1 << low) - 1))
        batch.append((low_product(low, latency), Segment({}, {"a_i": a, "low_i": b}, {"p_o": a * b})))
        seen.point("most negative by all ones", (a == -(1 << 17)) & (b == (1 << low) - 1))
        seen.point("by zero", b == 0)
        seen.point(f"{low} bits", len(a))
    stream_parts(batch, seed)

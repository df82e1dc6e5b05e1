"""small_product: products of extreme and random words with fractions, whole and rounded where they are cut."""

from bench import Segment
from parts import SMALL_PRODUCTS, small_product, stream_parts
from words import mixed


def test_is_exact(seed, rng, seen):
    batch = []
    for wa, drop in SMALL_PRODUCTS:
        a, b = mixed(rng, 600, (0, (1 << wa) - 1), (0, 511))
        b[::5] = 256
        p = (a * b + 128) >> 8 if drop else a * b
        batch.append((small_product(wa, drop), Segment({}, {"a_i": a, "b_i": b}, {"p_o": p})))
        seen.point(f"{wa} bits, {drop} cut", (a == (1 << wa) - 1) & (b == 511))
        seen.point("a half is rounded up", drop and ((a * b) & 255 == 128).sum())
    stream_parts(batch, seed)

"""row_product: a signed word by a few unsigned bits, of one to four digits."""

from bench import Segment
from parts import ROW_PRODUCTS, row_product, stream_parts
from words import mixed, signed


def test_is_exact(seed, rng, seen):
    batch = []
    for w, low in ROW_PRODUCTS:
        a, b = mixed(rng, 300, signed(w), (0, (1 << low) - 1))
        batch.append((row_product(w, low), Segment({}, {"a_i": a, "low_i": b}, {"p_o": a * b})))
        seen.point("most negative by all ones", (a == signed(w)[0]) & (b == (1 << low) - 1))
        seen.point("most positive by all ones", (a == signed(w)[1]) & (b == (1 << low) - 1))
        seen.point(f"{w} by {low} bits", len(a))
    stream_parts(batch, seed)

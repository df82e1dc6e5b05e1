"""digit_product: signed and unsigned words by every digit."""

from bench import Segment
from parts import DIGIT_PRODUCTS, digit_product, stream_parts
from words import mixed, signed


def test_is_exact(seed, rng):
    batch = []
    for w, digit, is_signed in DIGIT_PRODUCTS:
        low, high = signed(w) if is_signed else (0, (1 << w) - 1)
        a, d = mixed(rng, 200, (low, high), (0, (1 << digit) - 1))
        batch.append((digit_product(w, digit, is_signed), Segment({}, {"a_i": a, "d_i": d}, {"p_o": a * d})))
    stream_parts(batch, seed)

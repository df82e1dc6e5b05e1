"""mult18: the product of two words, three clocks later."""

import numpy as np
from bench import Segment
from parts import MULT18, stream_parts
from words import mixed, signed


def test_is_the_product(seed, rng, seen):
    a, b = mixed(rng, 3000, signed(18), signed(18))
    stream_parts([(MULT18, Segment({}, {"a_i": a, "b_i": b}, {"p_o": a * b}))], seed)
    seen.point("two most negative", (a == -(1 << 17)) & (b == -(1 << 17)))
    seen.values("sign of the product", np.sign(a * b), [-1, 0, 1])

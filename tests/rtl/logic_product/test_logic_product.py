"""logic_product: products of extreme and random words."""

import numpy as np
from bench import Segment
from parts import LOGIC_PRODUCTS, logic_product, stream_parts
from rtl_coverage import Coverage
from runner import seed
from words import mixed


def test_is_exact():
    s = seed()
    rng = np.random.default_rng(s)
    seen = Coverage("logic_product", "all")
    batch = []
    for wa in LOGIC_PRODUCTS:
        a, b = mixed(rng, 600, (0, (1 << wa) - 1), (0, (1 << 16) - 1))
        batch.append((logic_product(wa), Segment({}, {"a_i": a, "b_i": b}, {"p_o": a * b})))
        seen.point(f"{wa} bits", (a == (1 << wa) - 1) & (b == (1 << 16) - 1))
    stream_parts(batch, s)
    seen.close()

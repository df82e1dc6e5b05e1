"""small_product: exact products of extreme and random words, of all widths that its latency depends on."""

import numpy as np
from bench import Segment
from parts import SMALL_PRODUCTS, small_product, stream_parts
from rtl_coverage import Coverage
from runner import seed
from words import mixed


def test_is_exact():
    s = seed()
    rng = np.random.default_rng(s)
    seen = Coverage("small_product", "all")
    batch = []
    for wa, wb in SMALL_PRODUCTS:
        a, b = mixed(rng, 300, (0, (1 << wa) - 1), (0, (1 << wb) - 1))
        batch.append((small_product(wa, wb), Segment({}, {"a_i": a, "b_i": b}, {"p_o": a * b})))
        seen.point(f"{wa} x {wb}", (a == (1 << wa) - 1) & (b == (1 << wb) - 1))
    stream_parts(batch, s)
    seen.close()

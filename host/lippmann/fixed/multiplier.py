"""Product of two signed words, cut below a place.

rtl/math/lipp_multiplier.sv with mult18.sv and low_product.sv, or with wide_product.sv.
"""

from __future__ import annotations

import numpy as np

from lippmann.fixed.words import MUL_BITS, Ints


def multiplier(a: Ints, b: Ints | int, a_bits: int, b_bits: int, drop: int) -> Ints:
    """Return the product of two words less its last `drop` places, without the product of their lower parts.

    With a = ah 2^la + al, la the bits beyond 18: floor(ah bh 2^(la + lb) / 2^drop) plus
    floor((ah bl 2^la + al bh 2^lb) / 2^drop).
    """
    b = np.asarray(b, np.int64)
    la, lb = max(a_bits - MUL_BITS, 0), max(b_bits - MUL_BITS, 0)
    ah, bh = a >> la, b >> lb
    al, bl = a - (ah << la), b - (bh << lb)
    upper: Ints = (ah * bh) >> (drop - la - lb)
    cross: Ints = (ah * bl << la) + (al * bh << lb)
    product: Ints = upper + (cross >> drop)
    return product

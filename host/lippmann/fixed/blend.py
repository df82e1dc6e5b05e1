"""Sum of two products, k x + l a (rtl/optics/blend.sv)."""

from __future__ import annotations

from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.words import GUARD, Ints, guarded, wrapped


def blend(k: int, x: Ints, l: int, a: Ints | None, f: int, x_bits: int = 0, a_bits: int = 0) -> Ints:  # noqa: E741
    """Return k x + l a, without `a` the first product alone; F fraction bits.

    All words are wide; x has `x_bits` bits where that is given, and a `a_bits`. Words as integers, a b >> k the product
    that `multiplier` cuts by k places:

        y    = ((k x >> F-3) + (l a >> F-3) + 4) >> 3
    """
    word = f + 2
    total = multiplier(x, k, x_bits or word, word, f - GUARD)
    if a is not None:
        total = total + multiplier(a, l, a_bits or word, word, f - GUARD)
    return wrapped(guarded(total), word + 1)

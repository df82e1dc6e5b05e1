"""Sum of two products, k x + l a (rtl/optics/lipp_blend.sv)."""

from __future__ import annotations

from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.words import GUARD, Bools, Ints, fits, guarded, wrapped


def blend(
    k: int,
    x: Ints,
    l: int,  # noqa: E741
    a: Ints | None,
    f: int,
    y_bits: int,
    x_bits: int = 0,
    a_bits: int = 0,
    extra: int = 0,
) -> tuple[Ints, Bools]:
    """Return k x + l a, without `a` the first product alone, and where its `y_bits` do not hold it.

    Factors are wide words, with `extra` more fraction bits, as y then has; x has `x_bits` bits where that is given, and
    a `a_bits`, both F fraction bits. Words as integers, a b >> k the
    product that `multiplier` cuts by k places:

        y    = ((k x >> F-3) + (l a >> F-3) + 4) >> 3
    """
    word = f + 2
    total = multiplier(x, k, x_bits or word, word + extra, f - GUARD)
    if a is not None:
        total = total + multiplier(a, l, a_bits or word, word + extra, f - GUARD)
    y = guarded(total)
    return wrapped(y, y_bits), ~fits(y, y_bits)

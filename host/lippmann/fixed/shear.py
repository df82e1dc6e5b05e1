"""Step 3, sheared lattices: a point's x along the rows, from its lattice coordinates (rtl/optics/lipp_shear.sv)."""

from __future__ import annotations

from typing import NamedTuple

from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.words import GUARD, Bools, Ints, fits, guarded, wrapped


class Sheared(NamedTuple):
    """The point's x, F + 4 bits; `beyond` where they do not hold it."""

    x: Ints
    beyond: Bools


def shear(x: Ints, y: Ints, g: int, f: int, bits: int) -> Sheared:
    """Return x + g y; x and y of `bits` bits, in pitches and rows, g a far word.

    Words as integers, y g >> k the product that `multiplier` cuts by k places:

        x'   = ((x << 3) + (y g >> F-3) + 4) >> 3
    """
    word = f + 4
    total = guarded((x << GUARD) + multiplier(y, g, bits, word, f - GUARD))
    return Sheared(wrapped(total, word), ~fits(total, word))

"""Step 4, plano side to the panel: refraction into the glass (rtl/optics/lipp_enter_flat.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.sqrt import sqrt
from lippmann.fixed.words import GUARD, Bools, Ints, extra_bits, guarded


def enter_flat(ex: Ints, ey: Ints, index_inverse: int, f: int) -> tuple[Ints, Ints, Ints, Bools]:
    """Return the direction in the glass from the direction (e_x, e_y) in the air, near words and E = `extra_bits` bits.

    dz has 3 E bits more. The mask tells where it is steeper than 60 degrees: M - g < 1/4, which `sqrt` does not take.

    Words as integers, a b >> k the product that `multiplier` cuts by k places, M = 2^(F+3) - 1:

        t_x  = ((e_x i >> F-2) + 4) >> 3,  t_y likewise
        g    = max((t_x t_x >> F-3+2E) + (t_y t_y >> F-3+2E), 0) >> 2
        dz   = sqrt(M - g)

    i is 1/n, g has F + 3 fraction bits.
    """
    word, extra = f + 2, extra_bits(f)
    tx = guarded(multiplier(ex, index_inverse, word + extra, word, f + 1 - GUARD))
    ty = guarded(multiplier(ey, index_inverse, word + extra, word, f + 1 - GUARD))
    rest, _ = left_of_unit(tx, ty, f, extra)
    return tx, ty, sqrt(rest, f, normalise=False, extra=3 * extra), below_quarter(rest, f)


def left_of_unit(dx: Ints, dy: Ints, f: int, extra: int = 0) -> tuple[Ints, Bools]:
    """Return M - g, M and g as in `enter_flat` and `leave_flat`, F + 3 fraction bits, and where g is 1 or more."""
    word, drop = f + 2 + extra, f - 3 + 2 * extra
    total = multiplier(dx, dx, word, word, drop) + multiplier(dy, dy, word, word, drop)
    g = np.maximum(total, 0) >> 2
    most = (1 << (f + 3)) - 1
    return (most - g) & most, g > most


def below_quarter(rest: Ints, f: int) -> Bools:
    """Tell which squares, F + 3 fraction bits, are below 1/4."""
    return rest < 1 << (f + 1)

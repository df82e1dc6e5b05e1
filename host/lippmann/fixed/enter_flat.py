"""Step 4, plano side to the panel: refraction into the glass (rtl/optics/enter_flat.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.sqrt import sqrt
from lippmann.fixed.words import GUARD, Ints, guarded


def enter_flat(ex: Ints, ey: Ints, index_inverse: int, f: int) -> tuple[Ints, Ints, Ints]:
    """Return the direction in the glass of one in the air, near words.

    t = round(e / n); dz = sqrt(left_of_unit(t)).
    """
    word = f + 2
    tx = guarded(multiplier(ex, index_inverse, word, word, f + 1 - GUARD))
    ty = guarded(multiplier(ey, index_inverse, word, word, f + 1 - GUARD))
    return tx, ty, sqrt(left_of_unit(tx, ty, f), f, normalise=False)


def left_of_unit(dx: Ints, dy: Ints, f: int) -> Ints:
    """Return 1 - 2^-(F+3) - floor(max(0, floor(dx^2) + floor(dy^2)) / 4), F + 3 fraction bits, squares with F + 5."""
    word = f + 2
    total = multiplier(dx, dx, word, word, f - 3) + multiplier(dy, dy, word, word, f - 3)
    most = (1 << (f + 3)) - 1
    rest: Ints = (most - (np.maximum(total, 0) >> 2)) & most
    return rest

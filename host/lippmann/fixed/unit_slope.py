"""Step 3: the unit direction of a slope (rtl/optics/lipp_unit_slope.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.rsqrt import rsqrt
from lippmann.fixed.words import GUARD, Bools, Ints, guarded, wrapped


def unit_slope(mx: Ints, my: Ints, f: int, extra: int = 0) -> tuple[Ints, Ints, Ints, Bools]:
    """Return (m_x, m_y, 1) / sqrt(1 + m^2), near words, of a slope in wide words, and where m^2 >= 3.

    All have E = `extra` more fraction bits than such words. Words as integers, a b >> k the product that `multiplier`
    cuts by k places:

        x    = ((m_x m_x >> F-4+2E) + (m_y m_y >> F-4+2E) + 2^(F+4) + 4) >> 3
        e_z  = min(rsqrt(x), 2^(F+1+E) - 1)
        e_x  = ((m_x e_z >> F-3+E) + 4) >> 3,  e_y likewise

    Those slopes, 60 degrees and more, overflow: x and e_x keep their lowest bits, as the registers do.
    """
    word, drop = f + 2 + extra, f - 4 + 2 * extra
    square = multiplier(mx, mx, word, word, drop) + multiplier(my, my, word, word, drop)
    x = guarded(square) + (1 << (f + 1))
    beyond = x >= 1 << (f + 3)
    ez = np.minimum(rsqrt(x & ((1 << (f + 3)) - 1), f, extra), (1 << (f + 1 + extra)) - 1)  # 1 does not fit a near word
    ex = wrapped(guarded(multiplier(mx, ez, word, word, f - GUARD + extra)), word)
    ey = wrapped(guarded(multiplier(my, ez, word, word, f - GUARD + extra)), word)
    return ex, ey, ez, beyond

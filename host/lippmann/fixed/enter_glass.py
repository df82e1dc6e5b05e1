"""Step 4: refraction into the glass, at the flat face or at a dome (rtl/optics)."""

from __future__ import annotations

import numpy as np

from lippmann.fixed.meet_dome import Meeting
from lippmann.fixed.roots import sqrt
from lippmann.fixed.words import (
    GUARD,
    Bools,
    Ints,
    above_one,
    beyond,
    extra_bits,
    guarded,
    multiplier,
    saturate,
    wrapped,
)


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
    square, _ = left_of_unit(tx, ty, f, extra)
    return tx, ty, sqrt(square, f, normalise=False, extra=3 * extra), below_quarter(square, f)


def left_of_unit(dx: Ints, dy: Ints, f: int, extra: int = 0) -> tuple[Ints, Bools]:
    """Return M - g, M and g as in `enter_flat` and `leave_flat`, F + 3 fraction bits, and where g is 1 or more."""
    word, drop = f + 2 + extra, f - 3 + 2 * extra
    total = multiplier(dx, dx, word, word, drop) + multiplier(dy, dy, word, word, drop)
    g = np.maximum(total, 0) >> 2
    top = (1 << (f + 3)) - 1
    return (top - g) & top, g > top


def below_quarter(square: Ints, f: int) -> Bools:
    """Tell which squares, F + 3 fraction bits, are below 1/4."""
    return square < 1 << (f + 1)


def cosine_behind(s: Ints, ratio_square: int, f: int) -> tuple[Ints, Ints]:
    """Return C' = 2^(F+3) - (s r2 >> F) of a squared sine s, and sqrt(min(max(C', 0), M)), the cosine behind a face."""
    far = f + 4
    c = (1 << (f + 3)) - multiplier(s, ratio_square, far, far, f)
    return c, sqrt(np.clip(c, 0, (1 << (f + 3)) - 1), f)


def enter_dome(
    met: Meeting, ex: Ints, ey: Ints, index_inverse: int, index_inverse_square: int, f: int
) -> tuple[Ints, Ints, Bools]:
    """Return the lateral direction in the glass, near words, and a mask of overflow.

    Words as integers, a b >> k the product that `multiplier` cuts by k places, M = 2^(F+3) - 1:

        C'   = 2^(F+3) - (s i2 >> F)
        cos' = sqrt(min(max(C', 0), M))
        k    = (4 cos' - (cos i >> F-1) + 4) >> 3
        d'_x = saturate(((e_x i >> F-2) - (k N_x >> F-3) + 4) >> 3),  d'_y likewise

    s = 1 - cos^2 and C' have F + 3 fraction bits, k is a wide word, i is 1/n and i2 is 1/n^2. Overflow: C'
    below 0 or above 1, or the direction outside [-1, 1], by more than roundings.
    """
    near = f + 2
    c, cos_glass = cosine_behind(met.s, index_inverse_square, f)
    bend = wrapped(guarded((cos_glass << 2) - multiplier(met.cos, index_inverse, near, near, f - 1)), near)

    def lateral(e: Ints, n: Ints) -> Ints:
        t = multiplier(e, index_inverse, near, near, f + 1 - GUARD)
        return guarded(t - multiplier(bend, n, near, near, f - GUARD))

    dx, dy = lateral(ex, met.nx), lateral(ey, met.ny)
    over = (c < 0) | above_one(c, f) | beyond(dx, near) | beyond(dy, near)
    return saturate(dx, near), saturate(dy, near), over

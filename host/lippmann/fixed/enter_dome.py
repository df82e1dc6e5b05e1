"""Step 4, plano side to the viewer: refraction into the glass at the dome (rtl/optics/lipp_enter_dome.sv)."""

from __future__ import annotations

from lippmann.fixed.leave_dome import cosine_behind
from lippmann.fixed.meet_dome import Meeting
from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.saturate import beyond, saturate
from lippmann.fixed.words import GUARD, Bools, Ints, above_one, guarded, wrapped


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

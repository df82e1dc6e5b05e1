"""Step 6, plano side to the panel: refraction out of the glass (rtl/optics/lipp_leave_dome.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.fixed.meet_dome import Meeting
from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.saturate import beyond, saturate
from lippmann.fixed.sqrt import sqrt
from lippmann.fixed.words import GUARD, Bools, Ints, above_one, extra_bits, fits, guarded, wrapped


def leave_dome(
    met: Meeting, ex: Ints, ey: Ints, dz: Ints, index: int, index_square: int, f: int
) -> tuple[Ints, Ints, Ints, Bools, Bools]:
    """Return the direction in the air (near words), and masks of the rays that are totally reflected, and of overflow.

    Words as integers, a b >> k the product that `multiplier` cuts by k places, M = 2^(F+3) - 1:

        C'   = 2^(F+3) - (s n2 >> F)
        cos' = sqrt(min(max(C', 0), M))
        k    = (4 cos' - (cos n >> F-2) + 4) >> 3
        d'_x = saturate(((e_x << 3-E) + (k N_x >> F-3) + 4) >> 3),  d'_y likewise
        d'_z = saturate(((dz n >> F-3+3E) + (k N_z >> F-3) + 4) >> 3)

    e_x and e_y have E = `extra_bits` more fraction bits than near words, dz has 3 E more. s = 1 - cos^2 and C' have
    F + 3 fraction bits, k is a wide word, n2 is n^2. Totally reflected: C' <= 0. Overflow: C' above 1, or, unless
    reflected, k outside its word or the direction outside [-1, 1], by more than roundings.
    """
    near = f + 2
    c, cos_air = cosine_behind(met.s, index_square, f)
    glass = multiplier(met.cos, index, near, near + 1, f - 2)
    bend = guarded((cos_air << 2) - glass)
    over = ~fits(bend, near)
    bend = wrapped(bend, near)
    drop, extra = f - GUARD, extra_bits(f)
    kx, ky, kz = (multiplier(bend, n, near, near, drop) for n in (met.nx, met.ny, met.nz))
    axial = multiplier(dz, index, near + 3 * extra, near + 1, drop + 3 * extra)
    out = [guarded(d) for d in ((ex << (GUARD - extra)) + kx, (ey << (GUARD - extra)) + ky, axial + kz)]
    reflected = c <= 0
    over = above_one(c, f) | (~reflected & (over | np.any([beyond(d, near) for d in out], axis=0)))
    dx, dy, dz = (saturate(d, near) for d in out)
    return dx, dy, dz, reflected, over


def cosine_behind(s: Ints, ratio_square: int, f: int) -> tuple[Ints, Ints]:
    """Return C' = 2^(F+3) - (s r2 >> F) of a squared sine s, and sqrt(min(max(C', 0), M)), the cosine behind a face."""
    far = f + 4
    c = (1 << (f + 3)) - multiplier(s, ratio_square, far, far, f)
    return c, sqrt(np.clip(c, 0, (1 << (f + 3)) - 1), f)

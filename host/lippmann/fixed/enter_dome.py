"""Step 4, plano side to the viewer: refraction into the glass at the dome (rtl/optics/enter_dome.sv)."""

from __future__ import annotations

from lippmann.fixed.leave_dome import cosine_behind
from lippmann.fixed.meet_dome import Meeting
from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.saturate import saturate
from lippmann.fixed.words import GUARD, Ints, guarded, wrapped


def enter_dome(
    met: Meeting, ex: Ints, ey: Ints, index_inverse: int, index_inverse_square: int, f: int
) -> tuple[Ints, Ints]:
    """Return the lateral direction in the glass, near words.

    k = round(sqrt(1 - s / n^2) - cos / n), d = saturate(round(e / n - k N)).
    """
    near = f + 2
    _, cos_glass = cosine_behind(met.s, index_inverse_square, f)
    bend = wrapped(guarded((cos_glass << 2) - multiplier(met.cos, index_inverse, near, near, f - 1)), near)

    def lateral(e: Ints, n: Ints) -> Ints:
        t = multiplier(e, index_inverse, near, near, f + 1 - GUARD)
        return saturate(guarded(t - multiplier(bend, n, near, near, f - GUARD)), near)

    return lateral(ex, met.nx), lateral(ey, met.ny)

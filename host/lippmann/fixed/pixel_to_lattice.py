"""Step 1: pixel coordinates to lattice coordinates (rtl/optics/lipp_pixel_to_lattice.sv)."""

from __future__ import annotations

from lippmann.fixed.words import INDEX_BITS, MUL_BITS, OFFSET_BITS, SLOPE_BITS, Bools, Ints, fits, wrapped

LOW_BITS = SLOPE_BITS - MUL_BITS


def pixel_to_lattice(u: Ints, v: Ints, from_u: int, from_v: int, offset: int, f: int) -> tuple[Ints, Bools]:
    """Return one lattice coordinate, F fraction bits, of pixels u, v with 4 fraction bits from the panel's centre.

    The mask tells where the sum is outside [-2048, 2048), and wraps.

    hi = (u ah_u + v ah_v) + oh and lo = (u al_u + v al_v) + ol, each coefficient 2^17 ah + al;
    floor((hi + floor(lo / 2^17)) / 2^(23 - F)).
    """
    mask = (1 << LOW_BITS) - 1
    hi = u * (from_u >> LOW_BITS) + v * (from_v >> LOW_BITS) + (offset >> LOW_BITS)
    lo = u * (from_u & mask) + v * (from_v & mask) + (offset & mask)
    total = hi + (lo >> LOW_BITS)
    return wrapped(total >> (23 - f), INDEX_BITS + f), ~fits(total, OFFSET_BITS - LOW_BITS)

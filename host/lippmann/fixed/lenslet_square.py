"""Step 2, square grid: the lenslet whose cell a point is in (rtl/optics/lipp_lenslet_square.sv)."""

from __future__ import annotations

from lippmann.fixed.words import INDEX_BITS, Bools, Ints, fits, wrapped


def lenslet_square(x: Ints, y: Ints, f: int) -> tuple[Ints, Ints, Ints, Ints, Bools]:
    """Return indices i = floor(x + 1/2), j, and the point from that centre; lattice coordinates, F fraction bits.

    The mask tells where an index wraps.
    """
    half = 1 << (f - 1)
    i, j = (x + half) >> f, (y + half) >> f
    beyond = ~fits(i, INDEX_BITS) | ~fits(j, INDEX_BITS)
    return wrapped(i, INDEX_BITS), wrapped(j, INDEX_BITS), x - (i << f), y - (j << f), beyond

"""Step 2, hexagonal grid: the lenslet whose cell a point is in (rtl/optics/lipp_lenslet_hex.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.fixed.words import INDEX_BITS, Bools, Ints, fits, wrapped


def lenslet_hex(x: Ints, y: Ints, f: int) -> tuple[Ints, Ints, Ints, Ints, Bools]:
    """Return indices i, j, and the point from that centre; x in pitches, y in rows, F fraction bits.

    With s = x - y/2 and t = y, fs and ft their fractions, (i, j) is the nearest corner of the lattice's parallelogram.
    q0 = fs + ft/2 and q1 = fs/2 + ft select it, as in the table of the RTL module.
    The mask tells where an index wraps.
    """
    s = 2 * x - y  # F + 1 fraction bits
    i, j = s >> (f + 1), y >> f
    fs, ft = s - (i << (f + 1)), y - (j << f)
    q0, q1 = fs + ft, fs + 4 * ft  # units of 2^-(F + 1) and 2^-(F + 2)
    near = (q0 < 1 << f) & (q1 < 1 << (f + 1))
    far = (q0 >= 1 << (f + 1)) & (q1 >= 1 << (f + 2))
    right = 2 * ft < fs
    di = (~near & (far | right)).astype(np.int64)
    dj = (~near & (far | ~right)).astype(np.int64)
    local_x = (q0 >> 1) - (di << f) - (dj << (f - 1))
    i, j = i + di, j + dj
    beyond = ~fits(i, INDEX_BITS) | ~fits(j, INDEX_BITS)
    return wrapped(i, INDEX_BITS), wrapped(j, INDEX_BITS), local_x, ft - (dj << f), beyond

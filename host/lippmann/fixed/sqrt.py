"""Square root, faithfully rounded (rtl/math/lipp_sqrt.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.fixed.quadratic import quadratic
from lippmann.fixed.words import Ints, guarded


def sqrt(x: Ints, f: int, normalise: bool = True, extra: int = 0) -> Ints:
    """Return sqrt(x), a near word, of x in [0, 1) with F + 3 fraction bits; [1/4, 1) unless `normalise`.

    The root has K = `extra` more bits, up to 3. 4^k x is brought up to [1/4, 1), k at most 15, and its root q
    (`quadratic`) shifted back by k; 0 gives 0. Words as integers:

        y    = min(((q >> k) + (4 >> K)) >> (3 - K), 2^(F+1+K) - 1)
    """
    k = np.zeros_like(x)
    if normalise:
        for step in (8, 4, 2, 1):
            clear = (x >> (f + 3 - 2 * step)) == 0
            x = np.where(clear, (x << 2 * step) & ((1 << (f + 3)) - 1), x)
            k = k + np.where(clear, step, 0)
    root = quadratic(x, "square", f) >> k
    if normalise:
        root = np.where(x == 0, 0, root)
    return np.minimum(guarded(root, extra), (1 << (f + 1 + extra)) - 1)

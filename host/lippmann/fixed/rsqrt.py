"""Reciprocal root, faithfully rounded (rtl/optics/rsqrt.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.fixed.quadratic import quadratic
from lippmann.fixed.words import Ints, guarded


def rsqrt(x: Ints, f: int) -> Ints:
    """Return 1 / sqrt(x), a near word, of x in [1, 4) with F + 1 fraction bits."""
    return np.minimum(guarded(quadratic(x, "reciprocal", f)), (1 << (f + 1)) - 1)

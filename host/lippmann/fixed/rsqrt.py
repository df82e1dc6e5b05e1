"""Reciprocal root, faithfully rounded (rtl/math/lipp_rsqrt.sv)."""

from __future__ import annotations

from lippmann.fixed.quadratic import quadratic
from lippmann.fixed.words import Ints, guarded


def rsqrt(x: Ints, f: int, extra: int = 0) -> Ints:
    """Return 1 / sqrt(x), F + 1 + K fraction bits and in [1/2, 1], of x in [1, 4) with F + 1 fraction bits.

    K is `extra`, up to 3. With q from `quadratic`, words as integers:

        y    = (q + (4 >> K)) >> (3 - K)
    """
    return guarded(quadratic(x, "reciprocal", f), extra)

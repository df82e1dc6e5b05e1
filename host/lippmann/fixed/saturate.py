"""Saturation of a signed word (rtl/math/lipp_saturate.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.fixed.words import SLACK, Bools, Ints


def saturate(x: Ints, bits: int) -> Ints:
    """Return the number nearest to `x` that a signed word of `bits` bits can hold."""
    return np.clip(x, -(1 << (bits - 1)), (1 << (bits - 1)) - 1)


def beyond(x: Ints, bits: int, slack: int = SLACK) -> Bools:
    """Tell which numbers are outside a signed word's range by more than `slack` units."""
    top = 1 << (bits - 1)
    return (x < -top - slack) | (x >= top + slack)

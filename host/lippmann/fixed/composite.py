"""Composites layers from front to back in linear light (rtl/scene/lipp_composite.sv)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lippmann.fixed.texel_fetch import WHOLE
from lippmann.fixed.words import Bools, Ints

#: Bits of the light so far.
_SUM_BITS = 17


def composite(
    light: Sequence[Ints], opacity: Sequence[Ints], draws: Bools, brightness: Sequence[int], background: Ints
) -> Ints:
    """Return the light (N, 3) of rays through layers, and of the background (3,) behind them.

    Of each layer: P is its premultiplied light (N, 3), A its opacity (N,), B its brightness, 256 at most. From C_0 = 0,
    T_0 = 65536:

        G_k     = (T_k B_k + 2^7) >> 8
        C_(k+1) = C_k + ((P_k G_k + 2^15) >> 16)        for each of red, green and blue
        T_(k+1) = T_k - ((T_k A_k + 2^15) >> 16)
        light_o = min(C_n + ((background T_n + 2^15) >> 16), 65535), or 0 where draws_i is low
    """
    half, mask = 1 << 15, (1 << _SUM_BITS) - 1
    so_far = np.zeros((len(draws), 3), np.int64)
    left = np.full(len(draws), WHOLE)
    for one, covered, bright in zip(light, opacity, brightness, strict=True):
        gain = (left * min(bright, 256) + 128) >> 8
        so_far = (so_far + ((one * gain[:, None] + half) >> 16)) & mask
        left = left - ((left * covered + half) >> 16)
    so_far = (so_far + ((left[:, None] * background + half) >> 16)) & mask
    return np.where(draws[:, None], np.minimum(so_far, 65535), 0)

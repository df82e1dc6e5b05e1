"""Blends a layer's texels by their weights (rtl/scene/lipp_texel_blend.sv)."""

from __future__ import annotations

from lippmann.fixed.words import Ints


def texel_blend(colours: Ints, weights: Ints) -> tuple[Ints, Ints]:
    """Return the premultiplied light (N, 3) and the opacity (N,), 16 fraction bits, of texels (N, taps, 4).

    With the opacity A = a + [a >= 128], the bytes r, g, b of texel n and its weight w_n (N, taps):

        share_n = (w_n A + 2^7) >> 8        16 fraction bits
        light_o = (sum over n of (share_n r^2 >> 8) + 2^7) >> 8,  g and b likewise
        opacity_o = sum over n of share_n
    """
    alpha = colours[..., 3]
    shares = (weights * (alpha + (alpha >> 7)) + 128) >> 8
    parts = (shares[..., None] * colours[..., :3] ** 2) >> 8
    return (parts.sum(axis=1) + 128) >> 8, shares.sum(axis=1)

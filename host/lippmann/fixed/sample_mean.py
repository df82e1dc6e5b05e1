"""The mean of a pixel's samples (rtl/scene/lipp_sample_mean.sv)."""

from __future__ import annotations

from lippmann.fixed.words import Ints


def sample_mean(light: Ints, samples_bits: int) -> Ints:
    """Return the light of pixels (N, 3), of 2^SamplesBits samples (2^SamplesBits N, 3) each.

    One sample is its own mean; otherwise

        light_o = (sum of light_i + 2^(SamplesBits-1)) >> SamplesBits        for each of red, green and blue
    """
    if not samples_bits:
        return light
    total: Ints = light.reshape(-1, 1 << samples_bits, 3).sum(axis=1)
    return (total + (1 << (samples_bits - 1))) >> samples_bits

"""The random numbers of integrators: those of a sample depend on its pixel and on nothing that is traced beside it."""

from __future__ import annotations

import functools
from typing import Any

from lippmann.base.variant import mitsuba
from lippmann.rendering.samples import Seeds


def sampler_of(seeds: Seeds, pixel: Any, sample: Any) -> Any:
    """Return a sampler for integrators, by the numbers of pixels and of samples in them (UInt32).

    However a picture is cut into chunks, bands and workers, it draws the same; so do the colours of a pixel.
    """
    mi = mitsuba()
    sampler = _sampler_class(mi.variant())(mi.Properties())
    first, second = mi.sample_tea_32(pixel, seeds.image + seeds.number)
    state, stream = mi.sample_tea_32(first ^ sample, second)
    sampler.numbers = mi.PCG32(initstate=mi.UInt64(state), initseq=mi.UInt64(stream))
    return sampler


@functools.cache
def _sampler_class(variant: str) -> Any:
    mi = mitsuba()
    base: Any = mi.Sampler

    class PixelSampler(base):  # type: ignore[misc]
        numbers: Any

        def next_1d(self, active: Any = True) -> Any:
            return self.numbers.next_float32(active)

        def next_2d(self, active: Any = True) -> Any:
            return mi.Point2f(self.next_1d(active), self.next_1d(active))

    return PixelSampler

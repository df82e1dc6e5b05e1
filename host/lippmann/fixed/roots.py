"""Roots and reciprocal roots by tables of quadratics (rtl/math/lipp_quadratic.sv, lipp_rsqrt.sv, lipp_sqrt.sv)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from lippmann.fixed.words import MUL_BITS, Ints, guarded, multiplier

Root = Literal["reciprocal", "square"]


@dataclass(frozen=True)
class RootTable:
    """Coefficients of a root's segments, both octaves, and the formats that go with them.

    c0 has F + 4 fraction bits, c1 `slope_fraction`, c2 two more; a segment's place has `place_bits`.
    """

    segment_bits: int
    place_bits: int
    slope_fraction: int
    c0: Ints
    c1: Ints
    c2: Ints


@cache
def root_table(root: Root, f: int) -> RootTable:
    """Return the table of a root for F fraction bits.

    The quadratic through the root at the Chebyshev nodes z = 0, +-sqrt(3)/4 of each segment, z in [-1/2, 1/2).
    """
    a = f // 3
    place_bits = min(f + 2 - a, MUL_BITS)
    slope_fraction = min(a + 18, f + 4)
    node = math.sqrt(3.0) / 4.0

    def at(segment: int, z: float) -> float:
        m = 1.0 + (segment % (1 << a) + 0.5 + z) / (1 << a)
        x = m if segment < 1 << a else 2.0 * m
        return 1.0 / math.sqrt(x) if root == "reciprocal" else 0.5 * math.sqrt(x)

    def words(values: list[float], fraction: int) -> Ints:
        scaled = np.array(values) * float(1 << fraction)
        return np.where(scaled < 0.0, -np.floor(0.5 - scaled), np.floor(scaled + 0.5)).astype(np.int64)

    segments = range(2 << a)
    return RootTable(
        a,
        place_bits,
        slope_fraction,
        words([at(k, 0.0) for k in segments], f + 4),
        words([(at(k, node) - at(k, -node)) / (2.0 * node) for k in segments], slope_fraction),
        words([(at(k, node) + at(k, -node) - 2.0 * at(k, 0.0)) * (8.0 / 3.0) for k in segments], slope_fraction + 2),
    )


def quadratic(x: Ints, root: Root, f: int) -> Ints:
    """Return the root with F + 4 fraction bits of x, F + 1 fraction bits, in [1, 4).

    slope = c1 + floor((floor(c2 z) + 1) / 2), one bit kept below c1's last; y = c0 + floor(slope z).
    """
    table = root_table(root, f)
    a, d, s1 = table.segment_bits, table.place_bits, table.slope_fraction
    upper = x >> (f + 2)
    fraction = np.where(upper == 1, x & ((1 << (f + 2)) - 1), (x & ((1 << (f + 1)) - 1)) << 1)
    segment = (upper << a) + (fraction >> (f + 2 - a))
    place = ((fraction >> (f + 2 - a - d)) & ((1 << d) - 1)) - (1 << (d - 1))
    turn = multiplier(table.c2[segment], place, s1 + 3 - 2 * a, d, d + 1)
    slope = table.c1[segment] + ((turn + 1) >> 1)
    return table.c0[segment] + multiplier(slope, place, s1 - a, d, s1 + d - (f + 4))


def rsqrt(x: Ints, f: int, extra: int = 0) -> Ints:
    """Return 1 / sqrt(x), F + 1 + K fraction bits and in [1/2, 1], of x in [1, 4) with F + 1 fraction bits.

    K is `extra`, up to 3. With q from `quadratic`, words as integers:

        y    = (q + (4 >> K)) >> (3 - K)
    """
    return guarded(quadratic(x, "reciprocal", f), extra)


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

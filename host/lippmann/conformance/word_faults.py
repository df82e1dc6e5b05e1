"""Faults of an RTL design's words: stuck bits, swapped words, signs, constants, rounding."""

from __future__ import annotations

import math

import numpy as np

from lippmann.conformance.comparison import Comparison
from lippmann.conformance.fault_search import EXPLAINED, MANY, Finding
from lippmann.conformance.ray_sets import Bools, widths
from lippmann.conformance.sequence_faults import directions_in_array, find_delay
from lippmann.fixed.build import Build
from lippmann.fixed.ray_pipeline import FixedRays

#: Maximum difference from the twin's words due to another rounding rule, in ulps.
ROUNDING_WORDS = 8
#: Names of words that encode real numbers.
REALS = ("x", "y", "z", "dx", "dy", "dz")
WORD_STAGES = dict(zip(FixedRays._fields, ["lenslet"] * 2 + ["dome"] * 3 + ["exit"] * 3 + ["status"], strict=True))
#: Words that a faulty design may swap.
SWAPS = ({"x": "y", "y": "x"}, {"dx": "dy", "dy": "dx"}, {"x": "y", "y": "x", "dx": "dy", "dy": "dx"})
#: Groups of words that may have the wrong sign.
SIGNS = (*((name,) for name in REALS), ("x", "dx"), ("y", "dy"), ("x", "y", "dx", "dy"))


def find_stuck_bit(compared: Comparison) -> Finding | None:
    """Find a bit of the directions that has the same value in all rays."""
    wrong = compared.wrong_by["direction"]
    if compared.wrong_arrays != ["direction"] or wrong.all() or wrong.sum() < MANY:
        return None
    directions, expected = directions_in_array(compared)
    off = (directions - expected)[wrong]
    for axis, name in enumerate("xyz"):
        step = float(np.median(off[:, axis]))
        place = math.log2(abs(step)) if step and math.isfinite(step) else 0.5
        if not abs(place - round(place)) < 0.01:
            continue
        other = off.copy()
        other[:, axis] -= math.copysign(2.0 ** round(place), step)
        share = float((np.linalg.norm(other, axis=1) <= compared.limits["direction"][wrong]).mean())
        if share >= EXPLAINED:
            fault = f"a bit of the direction's {name} is stuck at {int(step > 0)}: 2^{round(place)}"
            return Finding("exit", fault, share)
    return None


def find_word_fault(words: FixedRays, twin: FixedRays) -> Finding | None:
    """Find late or swapped words, a wrong sign, or an added constant."""

    def equal(lag: int, right: FixedRays = twin) -> Bools:
        rays = np.arange(max(0, -lag), len(twin.status) - max(0, lag))
        return np.asarray(np.all([a[rays + lag] == b[rays] for a, b in zip(words, right, strict=True)], axis=0))

    if late := find_delay(equal):
        return late
    faults = {
        f"sign of the words {', '.join(names)}": {name: -getattr(twin, name) for name in names} for names in SIGNS
    }
    for swap in SWAPS:
        faults[f"words swapped: {', '.join(swap)}"] = {name: getattr(twin, other) for name, other in swap.items()}
    for name, word, expected in zip(FixedRays._fields[:-1], words, twin, strict=False):
        if constant := int(np.median(word - expected)):
            faults[f"a constant added to the word {name}: {constant:+d}"] = {name: expected + constant}
    for fault, changed in faults.items():
        same = equal(0, twin._replace(**changed))
        if len(same) >= MANY and same.mean() >= EXPLAINED:
            return Finding(WORD_STAGES[next(iter(changed))], fault, 1.0)
    return None


def find_rounding(words: FixedRays, twin: FixedRays, build: Build) -> str | None:
    """Find words that wrapped, were truncated, or were rounded by another rule."""
    expected = np.stack([getattr(twin, name) for name in REALS])
    apart = np.stack([getattr(words, name) for name in REALS]) - expected

    def names(rows: Bools) -> str:
        return ", ".join(name for name, row in zip(REALS, rows, strict=True) if row.any())

    span = np.array([1 << bits for bits in widths(REALS, build.fraction_bits)])[:, None]
    wraps = np.abs(np.abs(apart) - span) <= ROUNDING_WORDS
    if wraps.any() and (np.abs(np.where(wraps, 0, apart)) <= ROUNDING_WORDS).all():
        return f"a word wrapped where it should saturate: {names(wraps)}"
    if (np.abs(apart) > ROUNDING_WORDS).any():
        return None
    off = apart != 0
    if float(apart[off].mean()) < -0.9:
        return f"truncation instead of rounding (downward): {names(off)}"
    if float((apart * -np.sign(expected))[off].mean()) > 0.9:
        return f"truncation instead of rounding (towards zero): {names(off)}"
    return f"another rounding, at most {int(np.abs(apart).max())} units of the last place: {names(off)}"

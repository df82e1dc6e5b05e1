"""The roots of the fixed-point engines against 50-digit arithmetic: tables entry by entry, results word by word.

A unit in the last place is that of a near word, 2^-(F + 1).
"""

import re

import mpmath
import numpy as np
import pytest
from lippmann.fixed.words import FRACTIONS, root_table, rsqrt, sqrt
from lippmann.simulation.toolchain import repository

mpmath.mp.dps = 50

CHUNK = 1 << 20


def true_root(root, segment, z, f):
    """The root at place z of a segment, 50 digits."""
    a = f // 3
    m = 1 + (mpmath.mpf(segment % (1 << a)) + mpmath.mpf(1) / 2 + z) / (1 << a)
    x = m if segment < 1 << a else 2 * m
    return 1 / mpmath.sqrt(x) if root == "reciprocal" else mpmath.sqrt(x) / 2


@pytest.mark.parametrize("root", ["reciprocal", "square"])
@pytest.mark.parametrize("f", FRACTIONS)
def test_every_table_entry_is_the_nearest_word(f, root):
    table = root_table(root, f)
    node = mpmath.sqrt(3) / 4
    worst = mpmath.mpf(0)
    assert len(table.c0) == len(table.c1) == len(table.c2) == 2 << (f // 3)
    for k in range(len(table.c0)):
        below, middle, above = (true_root(root, k, z, f) for z in (-node, mpmath.mpf(0), node))
        slope = (above - below) / (2 * node)
        bend = (above + below - 2 * middle) / (2 * node * node)
        for word, value, fraction in (
            (table.c0[k], middle, f + 4), (table.c1[k], slope, table.slope_fraction),
            (table.c2[k], bend, table.slope_fraction + 2),
        ):  # fmt: skip
            worst = max(worst, abs(int(word) - value * 2**fraction))
    print(f"F {f}, {root}: worst {mpmath.nstr(worst, 6)} of a unit")
    # The tables are computed in double precision: a tie may fall to either side of it.
    assert worst <= 0.5 + 1e-5


def largest_error(root, f, words):
    """The largest error in units of the last place, and where, over batches of input words."""
    largest, where = 0.0, 0
    for x in words:
        if root == "rsqrt":
            value, result = np.longdouble(1) / np.sqrt(np.ldexp(x.astype(np.longdouble), -(f + 1))), rsqrt(x, f)
        else:
            value = np.sqrt(np.ldexp(x.astype(np.longdouble), -(f + 3)))
            result = sqrt(x, f, normalise=root == "sqrt")
        error = np.abs(result - np.ldexp(value, f + 1))
        at = int(error.argmax())
        if error[at] > largest:
            largest, where = float(error[at]), int(x[at])
    return largest, where


def batches(low, high):
    """All words of a range, CHUNK at a time."""
    for start in range(low, high, CHUNK):
        yield np.arange(start, min(start + CHUNK, high), dtype=np.int64)


def sample(f, low, high, count, seed):
    """Words spread over a range, both its ends and the neighbourhood of every power of two."""
    rng = np.random.default_rng(seed)
    ends = np.concatenate([np.arange(low, low + 5000), np.arange(high - 5000, high)])
    powers = np.concatenate([(1 << k) + np.arange(-50, 50) for k in range(6, f + 4)])
    # As many words of every magnitude: small ones are normalised the furthest.
    spread = (2.0 ** (rng.random(count) * (f + 3))).astype(np.int64)
    found = np.concatenate([ends, powers, spread, rng.integers(low, high, count)])
    return [found[(found >= low) & (found < high)]]


def test_longdouble_is_a_fit_judge():
    """How far numpy's longdouble roots are from 50-digit ones, relative."""
    rng = np.random.default_rng(20_010_825)
    for x in rng.integers(1 << 24, 1 << 26, 2000).tolist():
        exact = 1 / mpmath.sqrt(mpmath.mpf(x) / (1 << 24))
        got = np.longdouble(1) / np.sqrt(np.longdouble(x) / (1 << 24))
        high, low = float(got), float(got - np.longdouble(float(got)))
        assert abs((mpmath.mpf(high) + mpmath.mpf(low)) / exact - 1) < 1e-18


@pytest.mark.parametrize("f", [16, *(pytest.param(f, marks=pytest.mark.full) for f in (18, 22, 23))])
@pytest.mark.parametrize("root", ["rsqrt", "sqrt"])
def test_all_words(root, f):
    low = 1 << (f + 1) if root == "rsqrt" else 0
    worst, where = largest_error(root, f, batches(low, 1 << (f + 3)))
    print(f"{root}, F {f}: worst {worst:.4f} units at word {where}, all {(1 << (f + 3)) - low} inputs")
    assert 0.5 < worst < 1.0


@pytest.mark.parametrize("f", FRACTIONS)
@pytest.mark.parametrize("root", ["rsqrt", "sqrt", "sqrt of a word that is not normalised"])
def test_sampled_words(root, f):
    low = 0 if root == "sqrt" else 1 << (f + 1)
    worst, where = largest_error(root, f, sample(f, low, 1 << (f + 3), 100_000, 7 * f))
    print(f"F {f}, seed {7 * f}, {root}: worst {worst:.4f} units at word {where}")
    assert 0.5 < worst < 1.0


def test_the_worst_word_that_the_reference_names():
    """Found among all words by the test marked full, above."""
    page = (repository() / "docs/reference/rtl.md").read_text()
    row = r"maximum error ([\d.]+) units in the last place, at word (\d+), over all ([\d,]+)"
    said, word, inputs = re.search(row, page).groups()
    error, _ = largest_error("rsqrt", 23, [np.array([int(word)])])
    assert f"{error:.4f}" == said
    assert inputs == f"{3 << 24:,}"

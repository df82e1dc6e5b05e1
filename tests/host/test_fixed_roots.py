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


def reference_error():
    """How far numpy's longdouble roots are from 50-digit ones, relative: the bound that the tests below add."""
    rng = np.random.default_rng(20_010_825)
    worst = 0.0
    for x in rng.integers(1 << 24, 1 << 26, 2000).tolist():
        exact = 1 / mpmath.sqrt(mpmath.mpf(x) / (1 << 24))
        got = np.longdouble(1) / np.sqrt(np.longdouble(x) / (1 << 24))
        high, low = float(got), float(got - np.longdouble(float(got)))
        worst = max(worst, abs(float((mpmath.mpf(high) + mpmath.mpf(low)) / exact - 1)))
    return worst


def worst_rsqrt(f, words):
    """The largest error in units of the last place, and where, over batches of input words."""
    worst, where = 0.0, 0
    for x in words:
        value = np.longdouble(1) / np.sqrt(np.ldexp(x.astype(np.longdouble), -(f + 1)))
        error = np.abs(rsqrt(x, f) - np.ldexp(value, f + 1))
        at = int(error.argmax())
        if error[at] > worst:
            worst, where = float(error[at]), int(x[at])
    return worst, where


def worst_sqrt(f, words, normalise=True):
    """The same for sqrt."""
    worst, where = 0.0, 0
    for x in words:
        value = np.sqrt(np.ldexp(x.astype(np.longdouble), -(f + 3)))
        error = np.abs(sqrt(x, f, normalise=normalise) - np.ldexp(value, f + 1))
        at = int(error.argmax())
        if error[at] > worst:
            worst, where = float(error[at]), int(x[at])
    return worst, where


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
    assert reference_error() < 1e-18


def test_rsqrt_all_words_of_the_compact_configuration():
    f = 16
    worst, where = worst_rsqrt(f, batches(1 << (f + 1), 1 << (f + 3)))
    print(f"rsqrt, F {f}: worst {worst:.4f} units at word {where}, all {3 << (f + 1)} inputs")
    assert 0.5 < worst < 1.0


def test_the_worst_word_that_the_reference_names():
    """Found among all words by the test marked full, below."""
    page = (repository() / "docs/reference/rtl.md").read_text()
    row = r"([\d.]+) units of the last place at most, at word (\d+), over all ([\d,]+)"
    said, word, inputs = re.search(row, page).groups()
    assert f"{worst_rsqrt(23, [np.array([int(word)])])[0]:.4f}" == said
    assert inputs == f"{3 << 24:,}"


def test_sqrt_all_words_of_the_compact_configuration():
    f = 16
    worst, where = worst_sqrt(f, batches(0, 1 << (f + 3)))
    print(f"sqrt, F {f}: worst {worst:.4f} units at word {where}, all {1 << (f + 3)} inputs")
    assert 0.5 < worst < 1.0


@pytest.mark.parametrize("f", FRACTIONS)
def test_roots_of_sampled_words(f):
    seed = 7 * f
    inverse = worst_rsqrt(f, sample(f, 1 << (f + 1), 1 << (f + 3), 100_000, seed))
    square = worst_sqrt(f, sample(f, 0, 1 << (f + 3), 100_000, seed))
    plain = worst_sqrt(f, sample(f, 1 << (f + 1), 1 << (f + 3), 100_000, seed), normalise=False)
    print(f"F {f}, seed {seed}: rsqrt {inverse}, sqrt {square}, not normalised {plain}: worst units, at word")
    for worst, _ in (inverse, square, plain):
        assert 0.5 < worst < 1.0


@pytest.mark.full
@pytest.mark.parametrize("f", [18, 22, 23])
def test_rsqrt_all_words(f):
    worst, where = worst_rsqrt(f, batches(1 << (f + 1), 1 << (f + 3)))
    print(f"rsqrt, F {f}: worst {worst:.4f} units at word {where}, all {3 << (f + 1)} inputs")
    assert 0.5 < worst < 1.0


@pytest.mark.full
@pytest.mark.parametrize("f", [18, 22, 23])
def test_sqrt_all_words(f):
    worst, where = worst_sqrt(f, batches(0, 1 << (f + 3)))
    print(f"sqrt, F {f}: worst {worst:.4f} units at word {where}, all {1 << (f + 3)} inputs")
    assert 0.5 < worst < 1.0

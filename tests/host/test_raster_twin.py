"""The raster's twin, against plain loops and a shift register of single bits; its registers."""

import numpy as np
import pytest
from lippmann.errors import InputError
from lippmann.fixed.raster import TABLE_ENTRIES, Raster, lfsr, raster

NO_TABLE = np.zeros(TABLE_ENTRIES, np.int64)


def test_pixel_centres_row_by_row():
    frame = Raster(5, 4, (1, 3), (2, 3), samples=2)
    rays = raster(frame, NO_TABLE, 16)
    expected = []
    for row in (2, 3):
        for column in (1, 2, 3):
            # Pixel centres from the panel's centre, columns to the right and rows upward.
            place = ((column + 0.5 - 2.5) * 16, (2.0 - row - 0.5) * 16)
            expected += [place, place]
    np.testing.assert_array_equal(np.stack([rays.u, rays.v], axis=1), expected)
    assert not rays.a.any()
    assert not rays.b.any()
    assert rays.first.tolist() == [True] + [False] * 11
    assert rays.last.tolist() == [False] * 11 + [True]


def entries(du, dv, ja, jb):
    """Table entries by their format: bits 3:0, 7:4, 19:8 and 31:20."""
    return du & 0xF | (dv & 0xF) << 4 | (ja & 0xFFF) << 8 | (jb & 0xFFF) << 20


def test_table_moves_each_sample():
    offset = np.array([[0.25, -0.5], [0.4375, 0.0], [-0.125, 0.0625]])
    aim = np.array([[0.5, -0.25], [-2.0, 1.5], [1 / 1024, -1 / 1024]])
    table = NO_TABLE.copy()
    table[[62, 63, 0]] = entries(*(16 * offset.T).astype(int), *(1024 * aim.T).astype(int))
    f = 20
    frame = Raster(2, 2, (0, 1), (0, 0), samples=3, jitter="table", table_first=62)
    rays = raster(frame, table, f)
    for pixel, (u, v) in enumerate([(-0.5, 0.5), (0.5, 0.5)]):
        part = slice(3 * pixel, 3 * pixel + 3)
        np.testing.assert_array_equal(rays.u[part] / 16, u + offset[:, 0])
        np.testing.assert_array_equal(rays.v[part] / 16, v + offset[:, 1])
        np.testing.assert_array_equal(np.stack([rays.a[part], rays.b[part]], axis=1) / (1 << f), aim)


def serial(seed, count):
    """The same words from single steps: x^32 = x^22 + x^2 + x + 1, 32 steps a word."""
    bits = [seed >> k & 1 for k in range(32)]
    words = []
    for _ in range(count):
        words.append(sum(bit << k for k, bit in enumerate(bits)))
        for _ in range(32):
            top = bits[31]
            bits = [top, *bits[:31]]
            for tap in (1, 2, 22):
                bits[tap] ^= top
    return words


@pytest.mark.parametrize("seed", [0, 1, 0x80000000, 0xFFFFFFFF, 0x12345678])
def test_random_words_are_those_of_a_serial_register(seed):
    # Seed 0 counts as 1.
    assert lfsr(seed, 300).tolist() == serial(seed or 1, 300)
    assert lfsr(seed, 1).tolist() == [seed or 1]


def test_the_polynomial_is_primitive():
    """x has the order 2^32 - 1: the register runs through every state but 0, also 32 steps at a time."""
    polynomial = 1 << 32 | 1 << 22 | 1 << 2 | 1 << 1 | 1

    def power(n):  # x^n, from the highest bit of n: squares spread the bits
        state = 1
        for bit in f"{n:b}":
            state = sum(1 << 2 * k for k in range(32) if state >> k & 1) << int(bit)
            for k in reversed(range(32, 65)):
                state ^= polynomial << (k - 32) if state >> k & 1 else 0
        return state

    primes = (3, 5, 17, 257, 65537)  # those of 2^32 - 1; none divides 32
    assert np.prod(primes, dtype=object) == (1 << 32) - 1
    assert power((1 << 32) - 1) == 1
    assert all(power(((1 << 32) - 1) // prime) != 1 for prime in primes)


def test_random_jitter_fills_pixel_and_cell():
    f, count = 18, 1 << 16
    rays = raster(Raster(1, 1, (0, 0), (0, 0), samples=count, jitter="lfsr", seed=77), NO_TABLE, f)
    for word, half, step in ((rays.u, 8, 1), (rays.v, 8, 1), (rays.a, 512, 1 << 8), (rays.b, 512, 1 << 8)):
        scaled, low, high = word / step, -half, half - 1
        assert set(np.unique(scaled)) == set(range(low, high + 1))
        # A uniform variable's mean, within 6 of its standard deviations.
        spread = (high - low + 1) / 12**0.5 / count**0.5
        assert abs(scaled.mean() - (low + high) / 2) < 6 * spread
    pairs = np.corrcoef(np.stack([rays.u, rays.v, rays.a, rays.b, np.roll(rays.u, 1), np.roll(rays.a, 1)]))
    assert np.abs(pairs - np.eye(6)).max() < 6 / count**0.5


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"width": 16384}, "width: 16384 is not valid; give a whole number from 1 to 16383"),
        ({"height": 0}, "height: 0"),
        ({"columns": (5, 4)}, "columns 5 to 4"),
        ({"columns": (0, 10)}, "columns 0 to 10"),
        ({"rows": (-1, 3)}, "rows -1 to 3"),
        ({"samples": 0}, "samples: 0"),
        ({"samples": 65537}, "samples: 65537"),
        ({"jitter": "dice"}, "dice"),
        ({"table_first": 64}, "table_first"),
        ({"seed": 1 << 32}, "seed"),
    ],
)
def test_illegal_frames_are_refused(change, says):
    legal = {"width": 10, "height": 8, "columns": (0, 9), "rows": (0, 7)}
    assert Raster(**legal).rays == 80
    with pytest.raises(InputError, match=says):
        Raster(**{**legal, **change})

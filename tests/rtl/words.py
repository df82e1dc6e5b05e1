"""Words to stream: random ones, and those that break things."""

import itertools

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]


def signed(bits: int) -> tuple[int, int]:
    """The range of a signed word."""
    return -(1 << (bits - 1)), (1 << (bits - 1)) - 1


def specials(low: int, high: int) -> list[int]:
    """Ends of a range, zero, powers of two, and their neighbours."""
    found = {low, low + 1, high - 1, high, 0, 1, -1, 2, -2}
    for k in range(2, max(abs(low), abs(high)).bit_length()):
        found |= {sign * (1 << k) + d for sign in (1, -1) for d in (-1, 0, 1)}
    return sorted(w for w in found if low <= w <= high)


def mixed(rng: np.random.Generator, count: int, *ranges: tuple[int, int]) -> list[Ints]:
    """Words for several ports, each from its range: the cross of all ends, then random and special words mixed."""
    ends = 3 if len(ranges) > 4 else 5
    near_ends = [[low, high, max(low, 0), low + 1, high - 1][:ends] for low, high in ranges]
    crossed = np.array(list(itertools.product(*near_ends)), np.int64).T
    columns = []
    for k, (low, high) in enumerate(ranges):
        uniform = rng.integers(low, high, count, endpoint=True)
        special = rng.choice(specials(low, high), count)
        columns.append(np.concatenate([crossed[k], np.where(rng.random(count) < 0.4, special, uniform)]))
    return columns


def around(values: npt.ArrayLike, reach: int, low: int, high: int) -> Ints:
    """Every value with its neighbours, inside a range."""
    steps = np.arange(-reach, reach + 1)
    found = (np.asarray(values, np.int64).reshape(-1, 1) + steps).ravel()
    return np.unique(found[(found >= low) & (found <= high)])


def word(value: npt.ArrayLike, fraction: int) -> Ints:
    """The nearest words of values."""
    return np.floor(np.ldexp(np.asarray(value, np.float64), fraction) + 0.5).astype(np.int64)

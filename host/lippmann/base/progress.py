"""Progress of a long computation: the callback that learns of it, and the estimate of the remaining time."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from typing import Protocol, TypeVar

Item = TypeVar("Item")
#: Seconds of work from which a rate is taken: the estimate of fewer would be far off.
MIN_RATE_S = 5.0


class Progress(Protocol):
    """A callback that a long computation calls after each step, with the steps done and the steps in all.

    The first call may come before any work, and with the steps that an earlier run did.
    """

    def __call__(self, done: int, total: int, /) -> None:
        """Report that `done` of `total` steps are done."""


class RemainingTime:
    """Estimate of the remaining time of a work whose progress is reported.

    The rate is measured from the first report on: what an earlier run did took this one no time, and what comes before
    the first report, such as a compilation, is not repeated.
    """

    def __init__(self) -> None:
        self._first: tuple[float, int] | None = None

    def estimate_s(self, done: int, total: int) -> float | None:
        """Return the remaining time, s, when `done` of `total` steps are done; None while there is no rate."""
        now = time.monotonic()
        if self._first is None:
            self._first = now, done
        elapsed_s, new_steps = now - self._first[0], done - self._first[1]
        if new_steps <= 0 or elapsed_s < MIN_RATE_S:
            return None
        return elapsed_s * (total - done) / new_steps


def report_each(items: Collection[Item], progress: Progress | None) -> Iterator[Item]:
    """Yield the items; after each, report how many are done."""
    for done, item in enumerate(items, 1):
        yield item
        if progress is not None:
            progress(done, len(items))

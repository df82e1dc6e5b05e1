"""Progress of a long computation: the callback that learns of it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Protocol, TypeVar

from lippmann.errors import InputError

Item = TypeVar("Item")


class Progress(Protocol):
    """A callback that a long computation calls after each step, with the steps done and the steps in all.

    The first call may come before any work, and with the steps that an earlier run did.
    """

    def __call__(self, done: int, total: int, /) -> None:
        """Report that `done` of `total` steps are done."""


def check_progress(progress: Progress | None) -> None:
    """Refuse a callback that cannot be called."""
    if not (progress is None or callable(progress)):
        raise InputError(f"progress {progress!r} is not a function; give one that takes (steps done, steps in all)")


def report_each(items: Collection[Item], progress: Progress | None) -> Iterator[Item]:
    """Yield the items; after each, report how many are done."""
    for done, item in enumerate(items, 1):
        yield item
        if progress is not None:
            progress(done, len(items))


class RowProgress:
    """Reports the rows of a picture that are done, also those of the band that is being rendered."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self.done, self._total, self._progress = 0, total, progress

    def __call__(self, band_rows: int) -> None:
        """Report that so many rows of the next band are done."""
        if self._progress is not None:
            self._progress(self.done + band_rows, self._total)

    def add(self, rows: int) -> None:
        """Count rows that are finished, and report."""
        self.done += rows
        self(0)

"""Reports the progress of a long computation."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Protocol, TypeVar

from lippmann.errors import InputError

Item = TypeVar("Item")


class Progress(Protocol):
    """A progress function; its first call may report steps that an earlier run finished."""

    def __call__(self, steps: int, total: int, /) -> None:
        """Report that `steps` of `total` steps are done."""


def check_progress(progress: Progress | None) -> None:
    """Raise InputError if `progress` is not callable."""
    if not (progress is None or callable(progress)):
        raise InputError(f"progress {progress!r} is not a function; give one that takes (steps done, total steps)")


def report_each(items: Collection[Item], progress: Progress | None) -> Iterator[Item]:
    """Yield the items; report the number of finished items after each item."""
    for steps, item in enumerate(items, 1):
        yield item
        if progress is not None:
            progress(steps, len(items))


class RowProgress:
    """Reports the finished rows of a picture, including rows of the unfinished band."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        check_progress(progress)
        self.done, self._total, self._progress = 0, total, progress

    def __call__(self, band_rows: int) -> None:
        """Report the finished rows, including `band_rows` of the unfinished band."""
        if self._progress is not None:
            self._progress(self.done + band_rows, self._total)

    def add(self, rows: int) -> None:
        """Add a finished band's rows, and report the progress."""
        self.done += rows
        self(0)

"""Show progress on the terminal: a bar with the remaining time, or log lines."""

from __future__ import annotations

import sys
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager

from lippmann.base.progress_protocol import Item, Progress, report_each
from lippmann.cli.output import as_json, log

#: Time between two log lines of progress, s.
LOGGED_S = 30.0
#: Minimum elapsed time for an estimate of the remaining time, s.
MIN_RATE_S = 5.0


@contextmanager
def progress_bar(label: str) -> Iterator[Progress]:
    """Provide a callback that draws a progress bar, or logs lines (--json, or no terminal)."""
    if as_json() or not sys.stderr.isatty():
        yield _progress_lines(label)
        return
    from rich import progress as rich_progress
    from rich.console import Console

    columns = (
        "{task.description}",
        rich_progress.BarColumn(),
        "{task.percentage:>3.0f}%",
        rich_progress.TimeElapsedColumn(),
        "ETA",
        rich_progress.TimeRemainingColumn(),
    )
    with rich_progress.Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(label, total=None)
        yield lambda steps, total: bar.update(task, completed=steps, total=total)


def with_progress(label: str, items: Collection[Item]) -> Iterator[Item]:
    """Yield the items while a progress bar counts them."""
    with progress_bar(label) as progress:
        yield from report_each(items, progress)


def _progress_lines(label: str) -> Progress:
    # The rate counts from the first report, to exclude compilation and earlier runs.
    started = logged = time.monotonic()
    first: tuple[float, int] | None = None

    def log_line(steps: int, total: int) -> None:
        nonlocal logged, first
        now = time.monotonic()
        first = first or (now, steps)
        elapsed_s, new_steps = now - first[0], steps - first[1]
        if now - logged < LOGGED_S or new_steps <= 0:
            return
        logged = now
        estimate = ""
        if elapsed_s >= MIN_RATE_S:
            estimate = f", about {elapsed_s * (total - steps) / new_steps:.0f} s left"
        log(f"{label}: {100 * steps // total} % after {now - started:.0f} s{estimate}")

    return log_line

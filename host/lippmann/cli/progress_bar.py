"""Progress on the terminal: a bar with the remaining time, or a line now and then."""

from __future__ import annotations

import sys
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager

from lippmann.base.progress import Item, Progress, report_each
from lippmann.cli.output import as_json, log

#: Seconds between two lines about a long work's progress.
LOGGED_S = 30.0
#: Seconds of work from which a rate is taken: the estimate of fewer would be far off.
MIN_RATE_S = 5.0


@contextmanager
def progress_bar(label: str) -> Iterator[Progress]:
    """Provide a callback that draws a bar with the remaining time.

    With --json, or where stderr is no terminal, it logs a line now and then.
    """
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
        yield lambda done, total: bar.update(task, completed=done, total=total)


def with_progress(label: str, items: Collection[Item]) -> Iterator[Item]:
    """Yield the items, with a bar that counts those that are done."""
    with progress_bar(label) as progress:
        yield from report_each(items, progress)


def _progress_lines(label: str) -> Progress:
    """Return a callback that logs a line every `LOGGED_S` seconds in which something was done.

    The rate is measured from the first report on: what an earlier run did took this one no time, and what comes before
    the first report, such as a compilation, is not repeated.
    """
    started = logged = time.monotonic()
    first: tuple[float, int] | None = None

    def log_line(done: int, total: int) -> None:
        nonlocal logged, first
        now = time.monotonic()
        first = first or (now, done)
        elapsed_s, new_steps = now - first[0], done - first[1]
        if now - logged < LOGGED_S or new_steps <= 0:
            return
        logged = now
        estimate = ""
        if elapsed_s >= MIN_RATE_S:
            estimate = f", about {elapsed_s * (total - done) / new_steps:.0f} s left"
        log(f"{label}: {100 * done // total} % after {now - started:.0f} s{estimate}")

    return log_line

"""Output of the commands: logs and progress on stderr, the result on stdout as text or as one JSON object."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

import click

from lippmann.errors import printable

Item = TypeVar("Item")
#: Seconds between two lines about a long work's progress.
LOGGED_S = 30.0


def log(message: str) -> None:
    """Write one line to stderr."""
    click.echo(printable(message), err=True)


def as_json() -> bool:
    """Tell whether the command that runs has --json."""
    return bool(click.get_current_context().params["as_json"])


def emit(result: Mapping[str, Any], text: str | Iterable[str]) -> None:
    """Print a result: with --json as one object, else as its text (one string or lines)."""
    if as_json():
        # JSON has no infinities and no NaN: they become null.
        finite = json.loads(json.dumps(result), parse_constant=lambda _: None)
        click.echo(json.dumps(finite))
    else:
        click.echo(printable(text if isinstance(text, str) else "\n".join(text)))


@contextmanager
def progress_bar(label: str) -> Iterator[Callable[[int, int], None]]:
    """Provide a callback (done, total) that draws a bar with the remaining time.

    With --json, or where stderr is no terminal, it logs a line now and then.
    """
    if as_json() or not sys.stderr.isatty():
        yield _logged(label)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

    percent = "{task.percentage:>3.0f}%"
    columns = "{task.description}", BarColumn(), percent, TimeElapsedColumn(), "ETA", TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _logged(label: str) -> Callable[[int, int], None]:
    """Return a callback (done, total) that logs a line every `LOGGED_S` seconds."""
    started = told = time.monotonic()
    done_before: int | None = None  # what an earlier run did: it took this one no time

    def line(done: int, total: int) -> None:
        nonlocal told, done_before
        now = time.monotonic()
        if done_before is None:
            done_before = done
        if now - told < LOGGED_S or done <= done_before:
            return
        told = now
        left = (now - started) * (total - done) / (done - done_before)
        log(f"{label}: {100 * done // total} % after {now - started:.0f} s, about {left:.0f} s left")

    return line


def counted(items: Collection[Item], progress: Callable[[int, int], None]) -> Iterator[Item]:
    """Yield the items, and tell how many are done."""
    for done, item in enumerate(items, 1):
        yield item
        progress(done, len(items))

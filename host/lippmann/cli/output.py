"""Output of the commands: logs, warnings and progress on stderr, the result on stdout as text or as one JSON object."""

from __future__ import annotations

import json
import logging
import sys
import time
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

import click

from lippmann.base.progress import Item, Progress, report_each
from lippmann.errors import LippmannWarning, printable

if TYPE_CHECKING:
    from lippmann.display.description import Display

logger = logging.getLogger("lippmann")
#: Seconds between two lines about a long work's progress.
LOGGED_S = 30.0
#: Seconds of work from which a rate is taken: the estimate of fewer would be far off.
MIN_RATE_S = 5.0


def log(message: str) -> None:
    """Write one line to stderr."""
    click.echo(printable(message), err=True)


def as_json() -> bool:
    """Tell whether the command that runs has --json."""
    return bool(click.get_current_context().params["as_json"])


def emit(result: Mapping[str, Any], text: str | Iterable[str], display: Display | None = None) -> None:
    """Print a result, and the display that it is for: with --json as one object, paths as texts; else only `text`."""
    if display is not None:
        result = {"display": display.name, "identity": display.identity, **result}
    if as_json():
        # JSON has no infinities and no NaN: they become null.
        finite = json.loads(json.dumps(result, default=str), parse_constant=lambda _: None)
        click.echo(json.dumps(finite))
    else:
        click.echo(printable(text if isinstance(text, str) else "\n".join(text)))


class _StderrLines(logging.Handler):
    """Writes each record as one line to stderr; a warning begins with "note:"."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record."""
        prefix = "note: " if record.levelno >= logging.WARNING else ""
        log(prefix + record.getMessage())


@contextmanager
def logs_on_stderr() -> Iterator[None]:
    """Write what the package logs from level INFO on, and its warnings, to stderr while a command runs."""
    handler, level = _StderrLines(), logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    with warnings.catch_warnings():
        warnings.simplefilter("always", LippmannWarning)
        show_others = warnings.showwarning

        def show(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if issubclass(category, LippmannWarning):
                logger.warning("%s", message)
            else:
                show_others(message, category, filename, lineno, file, line)

        warnings.showwarning = show
        try:
            yield
        finally:
            logger.removeHandler(handler)
            logger.setLevel(level)


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

"""Output of the commands: logs and progress on stderr, the result on stdout as text or as one JSON object."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import click

EXIT_INTERRUPTED = 130


def log(message: str) -> None:
    """Write one line to stderr."""
    click.echo(message, err=True)


def emit(result: Mapping[str, Any], as_json: bool, text: str | Iterable[str] | Callable[[], None]) -> None:
    """Print a result: one JSON object, or its text (one string, lines, or a function that prints it)."""
    if as_json:
        click.echo(json.dumps(_finite(result)))
    elif callable(text):
        text()
    else:
        click.echo(text if isinstance(text, str) else "\n".join(text))


def _finite(value: Any) -> Any:
    """Replace infinities and NaN, which JSON lacks, by null."""
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


@contextmanager
def progress_bar(label: str, quiet: bool) -> Iterator[Callable[[int, int], None] | None]:
    """Provide a callback (done, total) that draws a bar with the remaining time on stderr.

    None if quiet, or if nobody watches.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

    percent = "{task.percentage:>3.0f}%"
    columns = "{task.description}", BarColumn(), percent, TimeElapsedColumn(), "ETA", TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)

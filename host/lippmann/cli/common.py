"""What the commands share: parameter types, JSON output, progress, and how failures become exit codes."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import click

EXIT_INTERRUPTED = 130


class Vector(click.ParamType[tuple[float, ...]]):
    """Comma-separated finite numbers, such as 0,0,600."""

    name = "vector"

    def __init__(self, size: int, form: str | None = None) -> None:
        self.size = size
        self.form = form or ",".join("XYZ"[:size])

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Parse the numbers."""
        if isinstance(value, tuple):
            return value
        parts = str(value).split(",")
        try:
            numbers = tuple(float(part) for part in parts)
        except ValueError:
            self.fail(f"'{value}' is not {self.form}; give {self.size} numbers with commas", param, ctx)
        if len(numbers) != self.size or not all(math.isfinite(x) for x in numbers):
            self.fail(f"'{value}' is not {self.form}; give {self.size} finite numbers with commas", param, ctx)
        return numbers

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Name the form in help texts."""
        return self.form


class Finite(click.ParamType[float]):
    """A finite number, perhaps not below another."""

    name = "float"

    def __init__(self, least: float = -math.inf) -> None:
        self.least = least

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Parse a number and refuse nan and inf."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            self.fail(f"'{value}' is not a finite number", param, ctx)
        if number < self.least:
            self.fail(f"{value} is less than {self.least:g}", param, ctx)
        return number


json_option = click.option("--json", "as_json", is_flag=True, help="One JSON object on stdout.")
display_option = click.option(
    "--display",
    "display_path",
    required=True,
    metavar="FILE",
    help="Display file (.toml).",
)
device_option = click.option(
    "--device",
    default="auto",
    show_default=True,
    type=click.Choice(["auto", "llvm", "cuda"]),
    help="Where the fast engine and Mitsuba run.",
)
seed_option = click.option(
    "--seed", default=0, show_default=True, type=click.IntRange(0, 2**32 - 1), help="Random seed."
)


def log(message: str) -> None:
    """Write one line to stderr, where logs belong."""
    click.echo(message, err=True)


def emit(result: Mapping[str, Any], as_json: bool, text: Callable[[], None]) -> None:
    """Print a result: one JSON object, or the text that `text` prints."""
    if as_json:
        click.echo(json.dumps(_finite(result), indent=None))
    else:
        text()


def _finite(value: Any) -> Any:
    """Replace infinities, which JSON lacks, by null."""
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


@contextmanager
def progress_bar(label: str, quiet: bool) -> Iterator[Callable[[int, int], None] | None]:
    """Give a callback (done, total) that draws a bar with the remaining time on stderr."""
    if quiet:
        yield None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(),
        TextColumn("ETA"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(label, total=None)

        def show(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        yield show

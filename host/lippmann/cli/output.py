"""Output of the commands: logs and warnings on stderr, the result on stdout as text or as one JSON object."""

from __future__ import annotations

import json
import logging
import os
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

import click

from lippmann.errors import LippmannWarning, printable

if TYPE_CHECKING:
    from lippmann.display.description import Display

logger = logging.getLogger("lippmann")


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
        finite = json.loads(json.dumps(result, default=os.fspath), parse_constant=lambda _: None)
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

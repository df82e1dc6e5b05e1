"""Print the output of commands: logs and warnings on stderr, the result on stdout."""

from __future__ import annotations

import json
import logging
import os
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from lippmann.errors import LippmannWarning, printable

if TYPE_CHECKING:
    from lippmann.display.description import Display

logger = logging.getLogger("lippmann")
#: Exit code of a command that ran and found errors in its input.
FOUND_WRONG = 4


def log(message: str) -> None:
    """Write a line to stderr."""
    click.echo(printable(message), err=True)


def as_json() -> bool:
    """Return whether the running command has --json."""
    return bool(click.get_current_context().params["as_json"])


def emit(result: Mapping[str, Any], text: str | Iterable[str], display: Display | None = None) -> None:
    """Print `text`, or with --json print the result and its display as a JSON object."""
    if display is not None:
        result = {"display": display.name, "identity": display.identity, **result}
    if as_json():
        # JSON has no infinities and no NaN, so null replaces them.
        finite = json.loads(json.dumps(result, default=os.fspath), parse_constant=lambda _: None)
        click.echo(json.dumps(finite))
    else:
        click.echo(printable(text if isinstance(text, str) else "\n".join(text)))


class _StderrLines(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        prefix = "note: " if record.levelno >= logging.WARNING else ""
        log(prefix + record.getMessage())


@contextmanager
def logs_on_stderr() -> Iterator[None]:
    """Write the package's warnings and logs (INFO and above) to stderr while the block runs."""
    handler, level = _StderrLines(), logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    with warnings.catch_warnings():
        warnings.simplefilter("always", LippmannWarning)
        show_others = warnings.showwarning

        def show_warning(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if issubclass(category, LippmannWarning):
                logger.warning("%s", message)
            else:
                show_others(message, category, *place, **more)

        warnings.showwarning = show_warning
        try:
            yield
        finally:
            logger.removeHandler(handler)
            logger.setLevel(level)

"""Print the output of commands: logs, warnings and errors on stderr, the result on stdout."""

from __future__ import annotations

import json
import logging
import os
import re
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from lippmann.base import interrupts
from lippmann.base.files import is_full, no_space
from lippmann.errors import InputError, LippmannError, LippmannWarning, NoSpaceError, missing_library, printable

if TYPE_CHECKING:
    from lippmann.display.description import Display

logger = logging.getLogger("lippmann")
#: Exit code of a command that ran successfully and found errors in its input.
FOUND_WRONG = 4
#: Message about a full disk if the file is unknown.
FULL_DISK = "cannot write: no space left on the device; free space or choose another place"
#: Names of Python parameters in messages; commands print flags instead.
PARAMETERS = re.compile(r"(?<![\w/.-])(memory_mb|fraction_bits|device(?= cuda))(?![\w/.])")
MAX_LETTERS = 1000  # maximum length of an error line, characters
#: Exit code of an unexpected error (EX_SOFTWARE of sysexits.h).
FAULT_CODE = 70
#: Remedies for files that cannot be opened, keyed by error type.
CANNOT_OPEN: dict[type[OSError], str] = {
    PermissionError: "no permission to open it; change its permissions, or name another file",
    IsADirectoryError: "is a folder; name a file",
    NotADirectoryError: "a part of the path is a file; correct the path",
}


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


def _explain(error: BaseException) -> tuple[str, int]:
    if was_interrupted(error):
        return "interrupted; nothing half-written is left", interrupts.exit_code()
    if isinstance(error, click.exceptions.NoSuchOption | click.exceptions.NoSuchCommand) and error.possibilities:
        del error.possibilities[1:]  # suggest the likeliest name
    if isinstance(error, click.ClickException):
        return error.format_message() + _usage(error), InputError.exit_code
    if is_full(error):
        name = getattr(error, "filename", None)
        error = no_space(str(name)) if name else NoSpaceError(FULL_DISK)
    if isinstance(error, MemoryError):
        error = InputError("out of memory; use a smaller panel or fewer samples")
    elif isinstance(error, ImportError) and not (error.name or "").startswith("lippmann"):
        error = missing_library(error)
    elif isinstance(error, OSError) and error.filename and error.strerror:
        remedies = [remedy for kind, remedy in CANNOT_OPEN.items() if isinstance(error, kind)]
        remedy = (*remedies, f"{error.strerror}; name another file")[0]
        error = InputError(f"{error.filename}: {remedy}")
    if isinstance(error, LippmannError):
        return str(error), error.exit_code
    if os.environ.get("LIPPMANN_TRACEBACK"):
        raise error
    return _fault(error), FAULT_CODE


def _fault(error: BaseException) -> str:
    what = f"a fault of Lippmann's ({type(error).__name__}: {error})"
    trace = "".join(traceback.format_exception(error))
    try:
        handle, path = tempfile.mkstemp(".txt", "lippmann-fault-")
        with open(handle, "w", encoding="utf-8", errors="replace") as file:
            file.write(trace)
    except OSError as unwritable:
        click.echo(trace, err=True)
        return f"{what}; please report it with the traceback above (file not written: {unwritable.strerror})"
    return f"{what}; please report it with the traceback in {path}"


def _usage(error: click.ClickException) -> str:
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        return ""
    if isinstance(error, click.exceptions.NoSuchOption) and not error.possibilities and error.ctx is not None:
        return f" {error.ctx.get_usage()} (see --help)"
    return " (see --help)"


def was_interrupted(error: BaseException | None) -> bool:
    """Return whether Ctrl-C or SIGTERM caused an error, even through a library."""
    if interrupts.received:
        return True
    while error is not None:
        if isinstance(error, KeyboardInterrupt | click.Abort):
            return True
        error = error.__cause__ or error.__context__
    return False


def report_error(error: BaseException, with_json: bool) -> int:
    """Print the line of an error on stderr, with `with_json` also as a JSON object; return the exit code."""
    message, code = _explain(error)
    if message.startswith("Usage:"):
        click.echo(message, err=True)
        return code
    line = printable(" ".join(message.split()))
    line = PARAMETERS.sub(lambda match: "--" + match[0].replace("_", "-"), line)
    if len(line) > MAX_LETTERS:  # a message may quote a file
        line = f"{line[: MAX_LETTERS // 2]} ... {line[-MAX_LETTERS // 2 :]}"
    click.echo(f"lippmann: {line}", err=True)
    try:
        if with_json:
            click.echo(json.dumps({"error": line, "exit_code": code}))
        sys.stdout.flush()
    except OSError:  # stderr shows the message
        drop_output()
    return code


def drop_output() -> None:
    """Discard buffered output, because Python's flush at exit would fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

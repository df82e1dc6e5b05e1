"""Report the error that ends a command: a line on stderr, a JSON object, the exit code, or a traceback file."""

from __future__ import annotations

import json
import os
import re
import sys
import tempfile
import traceback

import click

from lippmann.base import interrupts
from lippmann.base.files import is_full, no_space
from lippmann.errors import InputError, LippmannError, NoSpaceError, missing_library, printable

#: Message about a full disk if the file is unknown.
FULL_DISK = "cannot write: no space left on the device; free space or choose another place"
#: Names of Python parameters in messages; commands print flags instead.
PARAMETERS = re.compile(r"(?<![\w/.-])(memory_mb|fraction_bits|device(?= cuda))(?![\w/.])")
MAX_LETTERS = 1000  # maximum length of an error line, characters
#: Exit code of an unexpected error (EX_SOFTWARE in sysexits.h).
FAULT_CODE = 70
#: Remedies for files that cannot be opened, keyed by error type.
CANNOT_OPEN: dict[type[OSError], str] = {
    PermissionError: "no permission to open it; change its permissions, or name another file",
    IsADirectoryError: "is a folder; name a file",
    NotADirectoryError: "a part of the path is a file; correct the path",
}


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
        remedy = CANNOT_OPEN.get(type(error), f"{error.strerror}; name another file")
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
    """Return whether Ctrl-C or SIGTERM caused an error, even one from a library."""
    if interrupts.received:
        return True
    while error is not None:
        if isinstance(error, KeyboardInterrupt | click.Abort):
            return True
        error = error.__cause__ or error.__context__
    return False


def report_error(error: BaseException, with_json: bool) -> int:
    """Print an error's line on stderr, with `with_json` also as JSON; return the exit code."""
    message, code = _explain(error)
    if message.startswith("Usage:"):
        click.echo(message, err=True)
        return code
    line = printable(" ".join(message.split()))
    line = PARAMETERS.sub(lambda match: "--" + match[0].replace("_", "-"), line)
    if len(line) > MAX_LETTERS:  # a quoted file may be long
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

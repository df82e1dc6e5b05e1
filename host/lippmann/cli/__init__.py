"""Command `lippmann`; each subcommand has a module."""

from __future__ import annotations

import json
import os
import re
import sys
import tempfile
import traceback
from importlib import import_module
from pathlib import Path

import click
from click.shell_completion import CompletionItem

from lippmann import __version__
from lippmann.base import interrupts
from lippmann.base.files import is_full, new_folders, no_space, remove_empty
from lippmann.cli.output import logs_on_stderr
from lippmann.errors import InputError, LippmannError, MissingLibraryError, NoSpaceError, missing_library, printable

#: Commands in the order of typical work; the module of the same name defines `command`.
COMMANDS = (
    *("inspect", "fit", "trace", "vectors", "regress", "render", "layers", "animate", "capture", "observe", "view"),
    *("pattern", "calibrate", "export", "board", "stream", "play", "display", "live", "demo", "report", "doctor"),
)
#: Extras to install, keyed by command, for commands that need several libraries.
COMMAND_EXTRAS = {"calibrate": "calibrate", "live": "live", "display": "live", "demo": "board,live,simulate"}
#: Messages for removed commands of earlier versions.
OLD_COMMANDS = {"bench": "removed; to measure Lippmann itself, run python -m tools.bench in a checkout"}


def summary_of(command: str) -> str:
    """Read a command's summary from its source file, because imports are slow."""
    source = Path(__file__).with_name(f"{command}.py").read_text(encoding="utf-8")
    body = source.partition("\ndef command(")[2]
    return body.partition('"""')[2].partition("\n")[0].strip('"')


class _Commands(click.Group):
    """Group that loads a module only when its command is called, so help is fast."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            # Shell completion passes incomplete names.
            if ctx.resilient_parsing:
                return None
            if cmd_name in OLD_COMMANDS:
                raise InputError(f"lippmann {cmd_name}: {OLD_COMMANDS[cmd_name]}")
            raise click.exceptions.NoSuchCommand(cmd_name, possibilities=list(COMMANDS), ctx=ctx)
        try:
            command: click.Command = import_module(f"lippmann.cli.{cmd_name}").command
        except ModuleNotFoundError as error:
            raise missing_library(error, COMMAND_EXTRAS.get(cmd_name, "")) from None
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, summary_of(name)) for name in COMMANDS])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        commands = [CompletionItem(name, help=summary_of(name)) for name in COMMANDS if name.startswith(incomplete)]
        # Let click complete the options of the group.
        return commands + click.Command.shell_complete(self, ctx, incomplete)


@click.group(
    cls=_Commands,
    commands=dict.fromkeys(COMMANDS),
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)
@click.version_option(__version__, prog_name="lippmann")
def cli() -> None:
    """Integral photography: describe a display, trace its rays, render images, observe views.

    Exit codes: 0 success; 1 device failed; 2 invalid usage or input; 3 library or disk
    space missing; 4 wrong rays or display; 70 fault in Lippmann, please report it; 130,
    143, 129 ended by Ctrl-C, SIGTERM, loss of the terminal.

    Example: lippmann inspect scenes/displays/paper-square.toml
    """


def run(arguments: list[str], command: click.Command = cli, name: str | None = "lippmann") -> int:
    """Run a command under a program name (None: the command's); return the exit code."""
    if sys.stdout is None:
        print("lippmann: stdout is closed; open it, or redirect it to /dev/null", file=sys.stderr)
        return MissingLibraryError.exit_code
    new_folders.clear()
    stdout = sys.stdout
    try:
        with logs_on_stderr():
            code = command.main(args=arguments, prog_name=name, standalone_mode=False, obj=arguments)
    except (SystemExit, BrokenPipeError) as end:
        # A closed output pipe is not a failure: click then replaces stdout and exits.
        if isinstance(end, SystemExit) and sys.stdout is stdout:
            raise
        _drop_output()
        return 0
    except BaseException as error:
        message, failure = _explain(error)
        remove_empty()
        return _fail(message, failure, "--json" in arguments)
    return code if isinstance(code, int) else 0


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


def _fail(message: str, code: int, as_json: bool) -> int:
    if message.startswith("Usage:"):
        click.echo(message, err=True)
        return code
    line = printable(" ".join(message.split()))
    line = PARAMETERS.sub(lambda match: "--" + match[0].replace("_", "-"), line)
    if len(line) > MAX_LETTERS:  # a message may quote a file
        line = f"{line[: MAX_LETTERS // 2]} ... {line[-MAX_LETTERS // 2 :]}"
    click.echo(f"lippmann: {line}", err=True)
    try:
        if as_json:
            click.echo(json.dumps({"error": line, "exit_code": code}))
        sys.stdout.flush()
    except OSError:  # stderr shows the message
        _drop_output()
    return code


def _drop_output() -> None:
    """Discard buffered output, because Python's flush at exit would fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

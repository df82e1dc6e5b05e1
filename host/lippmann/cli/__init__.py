"""The command `lippmann`: one file a command."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import traceback
from importlib import import_module

import click
from click.shell_completion import CompletionItem

from lippmann import __version__
from lippmann.base import interrupts
from lippmann.base.files import is_full, made, no_space, remove_empty
from lippmann.cli.output import logs_on_stderr
from lippmann.errors import InputError, LippmannError, MissingLibraryError, NoSpaceError, missing_library, printable

#: Commands in the order of the work, with the first sentence of their help, which is so told without loading them. Each
#: is a function `command` in a module of the command's name.
COMMANDS = {
    "inspect": "Print the properties of a display file, with units and warnings, and what eyes will see.",
    "fit": "Choose the cheapest lens model, samples and RTL build; of a scene also the layers and the build that draws "
    "them.",
    "trace": "Trace rays from pixels through the lenslets.",
    "vectors": "Write test vectors: rays that are hard to compute.",
    "regress": "Check the rays of another ray tracer or RTL design.",
    "render": "Render the integral image of a scene, or of a folder of layers, for a display.",
    "layers": "Cut a scene into layers that a board draws by itself.",
    "animate": "Render a film, frame by frame, for a display.",
    "capture": "Capture a scene through an imaging lens and a microlens array.",
    "observe": "Compute what an eye sees through the lenslets.",
    "view": "Make a browser page that shows an integral image.",
    "pattern": "Draw a test pattern for a display's panel.",
    "calibrate": "Calibrate a display from photographs of its mounted array.",
    "export": "Write scenes and pictures in the forms of other tools.",
    "board": "Start a virtual board, or use a real or virtual one.",
    "stream": "Stream images to the panel of a board.",
    "play": "Play a film of layers, or show a folder of layers, on a board that draws.",
    "display": "Show an image on a monitor, full-screen and unscaled.",
    "live": "Show a scene on a display, and move it by hand.",
    "demo": "Run the main steps once: render, stream, draw, observe.",
    "report": "Measure speed and error of each engine and lens model on displays, and write a report.",
    "doctor": "Check libraries, rendering, the RTL's tools and serial ports.",
}
#: Commands of earlier versions, and the answer to each.
OLD_COMMANDS = {
    "bench": "measurements of Lippmann itself are made in a checkout: python -m tools.bench",
}


class _Commands(click.Group):
    """Loads a command's module when it is called, so that `--help` and the shell's completion are quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            # Shell completion, which is resilient, asks for the start of a name.
            if ctx.resilient_parsing:
                return None
            if cmd_name in OLD_COMMANDS:
                raise InputError(f"lippmann {cmd_name}: {OLD_COMMANDS[cmd_name]}")
            raise click.exceptions.NoSuchCommand(cmd_name, possibilities=list(COMMANDS), ctx=ctx)
        command: click.Command = import_module(f"lippmann.cli.{cmd_name}").command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        commands = [CompletionItem(name, help=text) for name, text in COMMANDS.items() if name.startswith(incomplete)]
        # Of the group itself, click completes the options.
        return commands + click.Command.shell_complete(self, ctx, incomplete)


@click.group(
    cls=_Commands,
    commands=dict.fromkeys(COMMANDS),
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)
@click.version_option(__version__, prog_name="lippmann")
def cli() -> None:
    """Integral photography: describe a display, trace its lenslets, render for it, look at it.

    Exit codes: 0 done; 1 board, line or monitor failed; 2 wrong usage or bad input; 3 library missing, or no
    space; 4 regress found wrong rays, calibrate a wrong display; 70 a fault of Lippmann's, to be reported; 130, 143 and
    129 ended by Ctrl-C, by SIGTERM and by the loss of the terminal.

    Example: lippmann inspect scenes/displays/paper-square.toml
    """


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with the code of its outcome."""
    interrupts.install()
    code = run(sys.argv[1:] if arguments is None else arguments)
    if interrupts.received:
        # Libraries that were interrupted while they loaded may crash when Python takes them down.
        interrupts.leave(code)
    interrupts.ignore()  # the work is done
    sys.exit(code)


def run(arguments: list[str], command: click.Command = cli, name: str | None = "lippmann") -> int:
    """Run the command line, or another command (None: named as it was called), and return the exit code."""
    if sys.stdout is None:
        print("lippmann: stdout is closed; open it, or send it to /dev/null", file=sys.stderr)
        return MissingLibraryError.exit_code
    made.clear()
    try:
        with logs_on_stderr():
            code = command.main(args=arguments, prog_name=name, standalone_mode=False)
    except SystemExit:
        raise
    except BrokenPipeError:
        # Whoever read our output has enough of it: no failure.
        _drop_output()
        return 0
    except BaseException as error:
        message, failure = _explain(error)
        remove_empty()
        return _fail(message, failure, "--json" in arguments)
    return code if isinstance(code, int) else 0


#: What is said of a full disk when the system does not name the file.
FULL_DISK = "cannot write: no space left on the device; free space or choose another place"
#: Longest line of an error.
MOST_LETTERS = 1000
#: Exit code of an error that no input should cause (EX_SOFTWARE of sysexits.h).
FAULT_CODE = 70
#: What is said of a file that cannot be opened, where its reader does not say it.
CANNOT_OPEN: dict[type[OSError], str] = {
    PermissionError: "you may not open it; change its permissions, or name another file",
    IsADirectoryError: "is a folder; name a file",
    NotADirectoryError: "a part of the path is a file; name a folder there",
}


def _explain(error: BaseException) -> tuple[str, int]:
    """Return the line and the exit code for an error."""
    if was_interrupted(error):
        return "interrupted; nothing half-written is left", interrupts.exit_code()
    if isinstance(error, click.exceptions.NoSuchOption | click.exceptions.NoSuchCommand) and error.possibilities:
        del error.possibilities[1:]  # the likeliest only
    if isinstance(error, click.ClickException):
        return error.format_message() + _usage(error), InputError.exit_code
    if is_full(error):
        named = getattr(error, "filename", None)
        error = no_space(str(named)) if named else NoSpaceError(FULL_DISK)
    if isinstance(error, MemoryError):
        error = InputError("out of memory; take a smaller panel or fewer samples")
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
    """Keep the traceback of an error that no input should cause in a file; return the line that says so."""
    what = f"a fault of Lippmann's ({type(error).__name__}: {error})"
    trace = "".join(traceback.format_exception(error))
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", errors="replace", prefix="lippmann-fault-", suffix=".txt", delete=False
        ) as file:
            file.write(trace)
    except OSError as unwritable:
        click.echo(trace, err=True)
        return f"{what}; please report it with the traceback above (no file holds it: {unwritable.strerror})"
    return f"{what}; please report it with the traceback in {file.name}"


def _usage(error: click.ClickException) -> str:
    """Return where to read how to call the command; how, where an option is unlike all that it has."""
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        return ""
    if isinstance(error, click.exceptions.NoSuchOption) and not error.possibilities and error.ctx is not None:
        return f" {error.ctx.get_usage()} (see --help)"
    return " (see --help)"


def was_interrupted(error: BaseException | None) -> bool:
    """Tell whether Ctrl-C, or SIGTERM, is behind an error: libraries may wrap it, or fail to load because of it."""
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
    if len(line) > MOST_LETTERS:  # of a file's own words
        line = f"{line[: MOST_LETTERS // 2]} ... {line[-MOST_LETTERS // 2 :]}"
    click.echo(f"lippmann: {line}", err=True)
    try:
        if as_json:
            click.echo(json.dumps({"error": line, "exit_code": code}))
        sys.stdout.flush()
    except OSError:  # said on stderr
        _drop_output()
    return code


def _drop_output() -> None:
    """Send what stdout holds nowhere: Python must not flush it at exit into a pipe or disk that takes nothing."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

"""Command `lippmann`; each subcommand has a module."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import click
from click.shell_completion import CompletionItem

from lippmann import __version__
from lippmann.base.files import new_folders, remove_empty
from lippmann.cli.error_reports import drop_output, report_error
from lippmann.cli.output import logs_on_stderr
from lippmann.errors import InputError, MissingLibraryError, missing_library

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
    """Run a command under a program name (None: the command's own); return the exit code."""
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
        drop_output()
        return 0
    except BaseException as error:
        remove_empty()
        return report_error(error, "--json" in arguments)
    return code if isinstance(code, int) else 0

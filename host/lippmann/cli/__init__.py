"""The command `lippmann`: one file a command."""

from __future__ import annotations

import json
import sys
from importlib import import_module

import click

from lippmann import __version__
from lippmann.cli.common import EXIT_INTERRUPTED
from lippmann.errors import InputError, LippmannError

#: Commands in the order of the work; each is a function of its own name in a module of its own name.
COMMANDS = ("inspect", "trace", "render", "observe", "demo", "bench", "doctor")


class _Commands(click.Group):
    """Loads a command's module when it is called, so that `--help` is quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(f"lippmann.cli.{cmd_name}").command
        return command


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="lippmann")
def cli() -> None:
    """Integral photography: describe a display, trace its lenslets, render for it, look at it.

    Exit codes: 0 ok, 1 device, 2 usage or bad input, 3 environment, 130 interrupted.

    Example: lippmann inspect scenes/displays/paper-square.toml
    """


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with the code of its outcome."""
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: list[str]) -> int:
    """Run the command line and return the exit code."""
    as_json = "--json" in arguments
    try:
        code = cli.main(args=arguments, prog_name="lippmann", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help(), err=True)
        return InputError.exit_code
    except click.ClickException as error:
        return _fail(f"{error.format_message()} (see --help)", InputError.exit_code, as_json)
    except (click.Abort, KeyboardInterrupt):
        return _fail("interrupted; nothing half-written is left", EXIT_INTERRUPTED, as_json)
    except LippmannError as error:
        return _fail(str(error), error.exit_code, as_json)
    except MemoryError:
        return _fail("out of memory; take a smaller panel or fewer samples", InputError.exit_code, as_json)
    return code if isinstance(code, int) else 0


def _fail(message: str, code: int, as_json: bool) -> int:
    line = " ".join(message.split())
    click.echo(f"lippmann: {line}", err=True)
    if as_json:
        click.echo(json.dumps({"error": line, "exit_code": code}))
    return code

"""Makes the commands of the programs that `python -m tools.NAME` runs."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import click
from lippmann.cli import run
from lippmann.cli.frame import JSON, make_command, option

#: Option --report of programs that write documentation pages; the same option for pages for maintainers.
REPORT: Any = option("Folder for the page.", "docs/generated/reports")
MAINTAINERS_REPORT: Any = option("Folder for the page.", "build/reports")


def program(main: Callable[..., Any]) -> click.Command:
    """Make a command without --json from a module's last function, and run it if the module is `__main__`."""
    command = make_command(main.__name__)(main)
    command.params.remove(JSON)
    if main.__module__ == "__main__":
        sys.exit(run(sys.argv[1:], command, None))
    return command

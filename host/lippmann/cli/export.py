"""`lippmann export`: scenes and pictures in the forms of other tools, a sub-command for each."""

from __future__ import annotations

import click

from lippmann.cli.export_povray import povray
from lippmann.cli.export_views import depth, focal_stack, quilt, views


@click.group("export")
def command() -> None:
    """Write scenes and pictures in the forms of other tools.

    Example: lippmann export quilt scenes/fish/fish.xml --display scenes/displays/vga-square.toml -o fish.png
    """


for _one in (povray, quilt, views, focal_stack, depth):
    command.add_command(_one)

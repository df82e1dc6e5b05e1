"""Command `lippmann display`."""

from __future__ import annotations

import click

from lippmann.base.fullscreen import full_screen
from lippmann.base.images import check_input
from lippmann.board.panel_frames import Target, load_frame
from lippmann.cli.frame import Name, argument, make_command, option
from lippmann.cli.options import FORCE, finite
from lippmann.cli.options_port import BAUD, opened_board
from lippmann.cli.output import emit
from lippmann.display.description import Display
from lippmann.errors import InputError


@make_command("display")
def command(
    image: Name = argument("IMAGE"),
    display: Display | None = option("Display file whose panel is the monitor."),
    port: str | None = option("Port of a board that reports the monitor's display.", metavar="URL"),
    baud: int | None = BAUD,
    monitor: int = option("Number of the monitor; the first is 0.", 0, click.IntRange(0)),
    seconds: float | None = option("Duration in seconds.  [default: until Escape or q]", kind=finite(0.0)),
    force: bool = FORCE,
) -> None:
    """Show an image full-screen and unscaled on the monitor behind a microlens array.

    Example: lippmann display out/fish.png --display scenes/displays/uhd-4k.toml
    --monitor 1
    """
    check_input(image)
    if display is None and port is None:
        raise InputError("no display; give --display FILE, or a board with --port URL")
    panel = None if display is None else display.panel
    if display is not None:
        target = Target(int(display.identity, 16), *display.panel.size_px)
    if port is not None:
        with opened_board(port, baud, None if force else display) as board:
            target = Target(board.info.identity, board.info.width, board.info.height)
    pixels = load_frame(image, target, None, panel, force)
    with full_screen((target.width, target.height), monitor) as show:
        show(pixels, seconds)
    size = {"width": target.width, "height": target.height}
    result = {"image": image, "monitor": monitor, **size, "identity": f"{target.identity:016x}"}
    emit(result, f"{image}: shown on monitor {monitor}, {target.width} x {target.height}")

"""`lippmann display`: an image on a monitor of this machine, pixel by pixel."""

from __future__ import annotations

import click

from lippmann.base.fullscreen import full_screen
from lippmann.base.images import check_input
from lippmann.board.board import Board
from lippmann.board.panel_frames import Target, load_frame
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.options_common import Finite
from lippmann.cli.options_port import BAUD, check_board, chosen_port
from lippmann.cli.output import emit
from lippmann.display.description import load_display
from lippmann.errors import InputError


@make_command("display")
def command(
    image: str = argument(),
    display_path: str | None = option(
        "Display file; its panel is the monitor.", None, flag="--display", metavar="FILE"
    ),
    port: str | None = option("A board that knows the display behind the monitor.", None, metavar="URL"),
    baud: int | None = BAUD,
    monitor: int = option("Number of the monitor, from 0.", 0, click.IntRange(0)),
    seconds: float | None = option("Duration; default: until Escape or q is pressed.", None, Finite(0.0)),
    force: bool = option("Show an image that was rendered for another display, or names none.", False),
) -> None:
    """Show an image on a monitor, full-screen and unscaled.

    The monitor is the panel behind the microlens array.

    Example: lippmann display out/fish.png --display scenes/displays/uhd-4k.toml --monitor 1
    """
    check_input(image)
    if display_path is None and port is None:
        raise InputError("give the display with --display FILE, or a board that knows it with --port URL")
    panel = None
    if display_path is not None:
        display = load_display(display_path)
        panel = display.panel
        target = Target(int(display.identity, 16), panel.width_px, panel.height_px)
    if port is not None:
        with Board.open(*chosen_port(port, baud)) as board:
            if display_path is not None and not force:
                check_board(board, display, display_path)
            target = Target(board.info.identity, board.info.width, board.info.height)
    pixels = load_frame(image, target, None, panel, force)
    with full_screen((target.width, target.height), monitor) as show:
        show(pixels, seconds)
    result = {
        "image": image, "monitor": monitor, "width": target.width, "height": target.height,
        "identity": f"{target.identity:016x}",
    }  # fmt: skip
    emit(result, f"{image}: shown on monitor {monitor}, {target.width} x {target.height}")

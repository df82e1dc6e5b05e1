"""`lippmann display`: an image on a monitor of this machine, pixel by pixel."""

from __future__ import annotations

import click

from lippmann.board.board import Board
from lippmann.board.frames import Target, load_frame
from lippmann.cli.options.common import Finite, json_option
from lippmann.cli.options.port import baud_option, check_board
from lippmann.cli.output import emit, log
from lippmann.display import load_display
from lippmann.errors import InputError
from lippmann.fullscreen import show


@click.command("display")
@click.argument("image")
@click.option("--display", "display_path", metavar="FILE", help="Display file; its panel is the monitor.")
@click.option("--port", metavar="URL", help="A board that knows the display behind the monitor.")
@baud_option
@click.option("--monitor", type=click.IntRange(0), default=0, show_default=True, help="Number of the monitor, from 0.")
@click.option("--seconds", type=Finite(0.0), help="Duration; default: until Escape or q is pressed.")
@click.option("--force", is_flag=True, help="Show an image that was rendered for another display, or names none.")
@json_option
def command(
    image: str,
    display_path: str | None,
    port: str | None,
    baud: int,
    monitor: int,
    seconds: float | None,
    force: bool,
    as_json: bool,
) -> None:
    """Show an image on a monitor, full-screen and unscaled.

    The monitor is the panel behind the microlens array.

    Example: lippmann display out/fish.png --display scenes/displays/uhd-4k.toml --monitor 1
    """
    if display_path is None and port is None:
        raise InputError("give the display with --display FILE, or a board that knows it with --port URL")
    panel = None
    if display_path is not None:
        display = load_display(display_path)
        panel = display.panel
        target = Target(int(display.identity, 16), panel.width_px, panel.height_px)
    if port is not None:
        with Board.open(port, baud) as board:
            if display_path is not None and not force:
                check_board(board, display, display_path)
            target = Target(board.info.identity, board.info.width, board.info.height)
    pixels = load_frame(image, target, None, panel, force, log)
    show(pixels, monitor, seconds)
    result = {
        "image": image, "monitor": monitor, "width": target.width, "height": target.height,
        "identity": f"{target.identity:016x}",
    }  # fmt: skip
    emit(result, as_json, f"{image}: shown on monitor {monitor}, {target.width} x {target.height}")

"""`lippmann display`: an image on a panel of the host's graphics card, one-to-one."""

from __future__ import annotations

import click

from lippmann.board.board import Board
from lippmann.board.frames import Target, load_frame
from lippmann.cli.options.common import Finite, json_option
from lippmann.cli.options.port import baud_option
from lippmann.cli.output import emit
from lippmann.display import Transfer, load_display
from lippmann.errors import InputError, input_error
from lippmann.fullscreen import show


@click.command("display")
@click.argument("image")
@click.option("--display", "display_path", metavar="FILE", help="Display file: its panel is the monitor.")
@click.option("--port", metavar="URL", help="A board that drives the same panel's array, asked which it is.")
@baud_option
@click.option("--monitor", type=click.IntRange(0), default=0, show_default=True, help="Its number, from 0.")
@click.option("--seconds", type=Finite(0.0), help="How long; else until Escape or q.")
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
    """Show an image full-screen and unscaled on a monitor that is the panel behind the array.

    Example: lippmann display out/fish.png --display scenes/displays/uhd-4k.toml --monitor 1
    """
    if display_path is None and port is None:
        raise InputError("name the panel with --display FILE, or with --port URL the board that knows it")
    transfer: Transfer = "srgb"
    bits = 8
    if display_path is not None:
        display = load_display(display_path)
        target = Target(int(display.identity, 16), display.panel.width_px, display.panel.height_px)
        transfer, bits = display.panel.transfer, display.panel.bits
    if port is not None:
        with Board.open(port, baud) as board:
            own = Target(board.info.identity, board.info.width, board.info.height)
        if display_path is not None and own != target and not force:
            raise input_error(
                port, f"the board drives {own.identity:016x}, {display_path} is {target.identity:016x}", "name its file"
            )
        target = own
    pixels = load_frame(image, target, transfer, bits, force)
    show(pixels, monitor, seconds)
    result = {
        "image": image, "monitor": monitor, "width": target.width, "height": target.height,
        "identity": f"{target.identity:016x}",
    }  # fmt: skip
    emit(result, as_json, lambda: click.echo(f"{image}: shown on monitor {monitor}, {target.width} x {target.height}"))

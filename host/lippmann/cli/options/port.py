"""What the commands share that talk to a board: port and baud rate."""

from __future__ import annotations

import click

from lippmann.board.discovery import find_board
from lippmann.link.port import DEFAULT_BAUD

port_option = click.option(
    "--port",
    metavar="URL",
    help="The board's port: a device, a pty, or socket://HOST:PORT; when left out, every port is asked.",
)
baud_option = click.option("--baud", type=click.IntRange(1), default=DEFAULT_BAUD, show_default=True)


def chosen_port(port: str | None, baud: int) -> str:
    """Return the port named, or that of the one board that answers.

    Raises
    ------
    DeviceError
        When none is named and not just one answers.
    """
    return find_board(baud=baud).url if port is None else port

"""Options of the commands that use a board: its port and its baud rate."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import click

from lippmann.board.board import Board, find_board
from lippmann.board.fpga_boards import usual_baud
from lippmann.cli.frame import option
from lippmann.display.description import Display
from lippmann.errors import input_error

PORT = option(
    "The board's port: a device, a pty, unix://PATH, or socket://HOST:PORT. Default: the one USB serial adapter, "
    "or virtual board of yours on a Unix socket, that answers.",
    None,
    metavar="URL",
)
BAUD = option(
    "Baud rate of a serial port. Default: that of a known board (ULX3S: 3000000), else 115200.",
    None,
    click.IntRange(1),
)


def chosen_port(port: str | None, baud: int | None) -> tuple[str, int]:
    """Return port and baud rate; when `port` is None, the port of the only board that answers.

    Raises DeviceError unless there is one.
    """
    url = find_board(baud=baud, allowed=_confirmed) if port is None else port
    return url, baud or usual_baud(url)


OpenBoard = Callable[[], Board]


def _opened(*, port: str | None = PORT, baud: int | None = BAUD) -> OpenBoard:
    return lambda: Board.open(*chosen_port(port, baud))


#: Opens the board that --port and --baud name, or the only board found. Raises as `chosen_port` and `Board.open`.
OPEN_BOARD: Any = _opened


def _confirmed(urls: list[str]) -> bool:
    """Ask on the terminal whether to write to ports that may be other devices; without a terminal, do not."""
    question = f"No board on a known USB adapter. Send a query to {', '.join(urls)}, too? Other devices may react to it"
    return sys.stdin is not None and sys.stdin.isatty() and click.confirm(question, err=True)


def check_board(board: Board, display: Display, path: str, otherwise: str = "") -> None:
    """Refuse a board that drives another display than that of the file `path`; `otherwise` is added to the remedy."""
    own = f"{board.info.identity:016x}"
    if own != display.identity:
        what = f"the board drives display {own}, {path} is {display.identity}"
        raise input_error(board.line.url, what, f"give the board's display file{otherwise}")

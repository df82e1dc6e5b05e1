"""Options of the commands that use a board: its port and its baud rate."""

from __future__ import annotations

import functools
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


def opened_board(
    port: str | None, baud: int | None, display: Display | None = None, action: str = "", frames: bool = False
) -> Board:
    """Open a board; refuse one that drives another than a display. `action` is what --force would do all the same.

    `frames`: it is to show frames, which `Board.check_panel` checks. Raises as `chosen_port` and `Board.open`.
    """
    board = Board.open(*chosen_port(port, baud))
    try:
        if display is not None:
            check_board(board, display, action)
        if frames:
            board.check_panel()
    except BaseException:
        board.close()
        raise
    return board


OpenBoard = Callable[..., Board]


def _open_board(*, port: str | None = PORT, baud: int | None = BAUD) -> OpenBoard:
    return functools.partial(opened_board, port, baud)


#: `opened_board` with the board that --port and --baud name, or the only board found.
OPEN_BOARD: Any = _open_board


def _confirmed(urls: list[str]) -> bool:
    """Ask on the terminal whether to write to ports that may be other devices; without a terminal, do not."""
    question = f"No board on a known USB adapter. Send a query to {', '.join(urls)}, too? Other devices may react to it"
    return sys.stdin is not None and sys.stdin.isatty() and click.confirm(question, err=True)


def check_board(board: Board, display: Display, action: str = "") -> None:
    """Refuse a board that drives another display; `action` is what --force would do all the same."""
    own = f"{board.info.identity:016x}"
    if own != display.identity:
        what = f"the board drives display {own}, '{display.name}' is {display.identity}"
        raise input_error(
            board.line.url, what, f"give the board's display file{action and f', or {action} with --force'}"
        )

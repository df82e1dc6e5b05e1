"""Options --port and --baud, shared by commands that use a board."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import Any

import click

from lippmann.board.board import Board
from lippmann.board.board_search import find_board
from lippmann.board.fpga_boards import usual_baud
from lippmann.cli.frame import option
from lippmann.display.description import Display
from lippmann.errors import input_error

PORT = option(
    "Port of the board: a device, a pty, unix://PATH or socket://HOST:PORT.  [default: the only board that answers]",
    metavar="URL",
)
BAUD = option("Baud rate of a serial port.  [default: the rate of a known board, or 115200]", kind=click.IntRange(1))
FORCE_BOARD = option("Accept a board of another display.")


def chosen_port(port: str | None, baud: int | None) -> tuple[str, int]:
    """Return port and baud rate; search for the board if `port` is None.

    Raises the errors of `find_board`.
    """
    url = find_board(baud=baud, allowed=_confirmed) if port is None else port
    return url, baud or usual_baud(url)


def opened_board(
    port: str | None, baud: int | None, display: Display | None = None, action: str = "", frames: bool = False
) -> Board:
    """Open a board; check its display and, if `frames` is True, its panel.

    Raises the errors of `chosen_port`, `Board.open`, `check_board` and
    `Board.check_panel`.
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


#: Option group; its value is `opened_board` with --port and --baud filled in.
OPEN_BOARD: Any = _open_board


def _confirmed(urls: list[str]) -> bool:
    question = f"No board answers on a known USB adapter. Query {', '.join(urls)}? Other devices may react"
    return sys.stdin is not None and sys.stdin.isatty() and click.confirm(question, err=True)


def check_board(board: Board, display: Display, action: str = "") -> None:
    """Raise InputError for a board of another display; `action` is what --force allows."""
    identity = f"{board.info.identity:016x}"
    if identity != display.identity:
        what = f"the board drives display {identity}, but '{display.name}' is {display.identity}"
        remedy = f"give the board's display file{action and f', or {action} with --force'}"
        raise input_error(board.line.url, what, remedy)

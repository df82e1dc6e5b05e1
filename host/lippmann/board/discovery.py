"""Search of boards: every port is asked who is there."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from lippmann.board.board import Board, Hello
from lippmann.errors import DeviceError
from lippmann.link.port import DEFAULT_BAUD, ports

#: How long a port may be silent, s.
SEARCH_PATIENCE_S = 1.0

#: Baud rates that boards are set to.
COMMON_BAUDS = (115_200, 230_400, 460_800, 921_600, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 6_000_000, 12_000_000)


class Found(NamedTuple):
    """A board's port, and what it says of itself."""

    url: str
    hello: Hello


def find_boards(
    urls: Iterable[str] | None = None, baud: int = DEFAULT_BAUD, patience_s: float = SEARCH_PATIENCE_S
) -> tuple[list[Found], list[DeviceError]]:
    """Ask each port (this machine's, unless named); return the boards, and why the other ports are none."""
    found, others = [], []
    for url in ports() if urls is None else urls:
        try:
            with Board.open(url, baud, patience_s) as board:
                found.append(Found(url, board.info))
        except DeviceError as error:
            others.append(error)
    return found, others


def find_board(
    urls: Iterable[str] | None = None, baud: int = DEFAULT_BAUD, patience_s: float = SEARCH_PATIENCE_S
) -> Found:
    """Return the one board that answers.

    Raises
    ------
    DeviceError
        When none or more than one answers.
    """
    found, others = find_boards(urls, baud, patience_s)
    if len(found) == 1:
        return found[0]
    if found:
        names = ", ".join(board.url for board in found)
        raise DeviceError(f"{len(found)} boards answer ({names}); name one with --port")
    seen = f"of {len(others)} ports none answers ({others[0]})" if others else "this machine has no serial port"
    raise DeviceError(f"no board: {seen}; plug one in, start a virtual one (lippmann board start), or name its --port")


def baud_of_board(url: str, bauds: Iterable[int] = COMMON_BAUDS, patience_s: float = SEARCH_PATIENCE_S) -> int | None:
    """Return the first baud rate at which a board answers at a port, or None.

    Raises
    ------
    InputError
        For a URL that cannot be.
    """
    for baud in bauds:
        if find_boards([url], baud, patience_s)[0]:
            return baud
    return None

"""Search for boards: HELLO is sent to serial ports, and a board replies."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

from lippmann.board.board import Board, Hello
from lippmann.board.fpga_boards import usual_baud
from lippmann.board.port import adapter_ports, ports
from lippmann.board.socket_port import own_boards
from lippmann.errors import DeviceError

#: Longest silence of a port in a search, s.
SEARCH_PATIENCE_S = 1.0
#: Baud rates that boards are set to.
COMMON_BAUDS = (115_200, 230_400, 460_800, 921_600, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 6_000_000, 12_000_000)


class Found(NamedTuple):
    """A board's port, and its reply to HELLO."""

    url: str
    hello: Hello


def find_boards(
    urls: Iterable[str], baud: int | None = None, patience_s: float = SEARCH_PATIENCE_S
) -> tuple[list[Found], list[DeviceError]]:
    """Send HELLO to each port; return the boards, and the errors of the other ports.

    Without `baud` at the rate of the port's known board (`fpga_boards.usual_baud`).
    """
    found, others = [], []
    for url in urls:
        try:
            with Board.open(url, baud or usual_baud(url), patience_s) as board:
                found.append(Found(url, board.info))
        except DeviceError as error:
            others.append(error)
    return found, others


def find_board(
    urls: Iterable[str] | None = None,
    baud: int | None = None,
    patience_s: float = SEARCH_PATIENCE_S,
    allowed: Callable[[list[str]], bool] = lambda urls: False,
) -> Found:
    """Return the one board that answers.

    A search writes to ports, and a device that is not a board may act on the bytes. So without `urls` it writes to
    known USB adapters (`lippmann.board.port.ADAPTER_VENDORS`) and this user's virtual boards on Unix sockets, and to
    this machine's other ports only when no board answers there and `allowed`, called with them, returns True. Raises
    DeviceError when no board or more than one answers.
    """
    known = [*adapter_ports(), *own_boards()] if urls is None else list(urls)
    rest = [url for url in ports() if url not in known] if urls is None else []
    found, others = find_boards(known, baud, patience_s)
    if not found and rest and allowed(rest):
        found, more = find_boards(rest, baud, patience_s)
        others += more
        rest = []
    if len(found) == 1:
        return found[0]
    if found:
        names = ", ".join(board.url for board in found)
        raise DeviceError(f"{len(found)} boards answer ({names}); name one with --port")
    what = f"of {len(others)} ports none answers ({others[0]})" if others else "this machine has no serial port"
    if rest:
        what = f"{f'{what}; ' if others else ''}not tried, for they may be other devices: {', '.join(rest)}"
    raise DeviceError(f"no board: {what}; name its port with --port, or start a virtual board (lippmann board start)")


def baud_of_board(url: str, bauds: Iterable[int] = COMMON_BAUDS, patience_s: float = SEARCH_PATIENCE_S) -> int | None:
    """Return the first baud rate at which a board answers at a port, or None; raise InputError for an invalid URL."""
    return next((baud for baud in bauds if find_boards([url], baud, patience_s)[0]), None)

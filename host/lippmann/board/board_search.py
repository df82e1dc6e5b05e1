"""Search for boards: at which port, and at which baud rate, a board answers."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from lippmann.board.board import Board
from lippmann.board.fpga_boards import usual_baud
from lippmann.board.port import adapter_ports, own_boards, ports
from lippmann.errors import DeviceError

#: Time-out of each port in a search, s.
SEARCH_PATIENCE_S = 1.0
#: Baud rates that `baud_of_board` tries.
COMMON_BAUDS = (115_200, 230_400, 460_800, 921_600, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 6_000_000, 12_000_000)


def find_boards(
    urls: Iterable[str], baud: int | None = None, patience_s: float = SEARCH_PATIENCE_S
) -> tuple[list[str], list[DeviceError]]:
    """Send HELLO to each port, by default at its `usual_baud`.

    Return the ports at which a board answers, and the errors of the other ports.
    """
    boards, errors = [], []
    for url in urls:
        try:
            Board.open(url, baud or usual_baud(url), patience_s).close()
            boards.append(url)
        except DeviceError as error:
            errors.append(error)
    return boards, errors


def find_board(
    urls: Iterable[str] | None = None,
    baud: int | None = None,
    patience_s: float = SEARCH_PATIENCE_S,
    allowed: Callable[[list[str]], bool] = lambda urls: False,
) -> str:
    """Return the port of the board that answers; raise DeviceError unless exactly one answers.

    A search may disturb other devices. Therefore, if `urls` is None, only known USB
    adapters and this user's virtual boards are tried first. If no board answers,
    `allowed` gets the list of other ports; these are tried if it returns True.
    """
    first_urls = [*adapter_ports(), *own_boards()] if urls is None else list(urls)
    others = [url for url in ports() if url not in first_urls] if urls is None else []
    boards, errors = find_boards(first_urls, baud, patience_s)
    if not boards and others and allowed(others):
        boards, other_errors = find_boards(others, baud, patience_s)
        errors += other_errors
        others = []
    if len(boards) == 1:
        return boards[0]
    if boards:
        raise DeviceError(f"{len(boards)} boards answer ({', '.join(boards)}); name a port with --port")
    what = f"none of {len(errors)} ports answers ({errors[0]})" if errors else "this machine has no serial port"
    if others:
        what = f"{f'{what}; ' if errors else ''}not tried, as they may be other devices: {', '.join(others)}"
    raise DeviceError(f"no board: {what}; name a port with --port, or start a virtual board (lippmann board start)")


def baud_of_board(url: str) -> int | None:
    """Return the first baud rate at which a board answers, or None.

    Raises InputError for an invalid URL.
    """
    return next((baud for baud in COMMON_BAUDS if find_boards([url], baud)[0]), None)

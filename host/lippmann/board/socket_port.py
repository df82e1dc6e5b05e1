"""Boards on sockets: unix://PATH on this machine, socket://HOST:PORT over TCP, with the token of a virtual board."""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from urllib.parse import parse_qs, urlsplit

from lippmann.base.files import listening, private_folder, private_path
from lippmann.errors import InputError

SCHEMES = ("unix://", "socket://")
#: Longest time until a host accepts a connection, s.
CONNECT_S = 5.0
#: Longest token that is sent, bytes.
MAX_TOKEN = 256
#: Names of this machine.
LOOPBACK = ("127.0.0.1", "localhost")


class SocketPort:
    """A connected socket with the methods of a serial port; its reads and writes do not block.

    Raises ValueError for a URL that is none, OSError when nobody accepts the connection.
    """

    #: Of serial ports without a file number, which this one has.
    in_waiting = 0
    write_timeout: float | None = 0

    def __init__(self, url: str) -> None:
        if url.startswith("unix://"):
            self._socket = socket.socket(socket.AF_UNIX)
            place: str | tuple[str, int] = url.removeprefix("unix://")
            self._socket.settimeout(CONNECT_S)
        else:
            host, port = _address(url)
            self._socket = socket.create_connection((host, port), timeout=CONNECT_S)
            # Send a short packet at once, before the one before it is acknowledged.
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            if url.startswith("unix://"):
                self._socket.connect(place)
            if token := token_of(url):
                self._socket.sendall(token)
        except BaseException:
            self._socket.close()
            raise
        self._socket.setblocking(False)

    def fileno(self) -> int:
        """Return the file number, for select."""
        return self._socket.fileno()

    def read(self, count: int) -> bytes:
        """Return at most `count` bytes of those that have arrived; OSError when the other side has closed."""
        try:
            data = self._socket.recv(count)
        except (BlockingIOError, InterruptedError):
            return b""
        if not data and count:
            raise ConnectionResetError("socket disconnected")
        return data

    def write(self, data: bytes) -> int:
        """Send what is accepted at once; return the number of bytes."""
        try:
            return self._socket.send(data)
        except (BlockingIOError, InterruptedError):
            return 0

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


def own_boards() -> list[str]:
    """Return the URLs of the virtual boards on Unix sockets that this user runs.

    They are not asked: to connect would take the place of another program that a board serves and that is silent.
    """
    try:
        place = private_folder()
    except InputError:  # another user's folder: no board of ours
        return []
    live = listening()
    return sorted(f"unix://{path}" for path in place.glob("board-*.sock") if str(path) in live)


def _address(url: str) -> tuple[str, int]:
    """Return host and port of socket://HOST:PORT."""
    parts = urlsplit(url)
    if not parts.hostname or parts.port is None or set(parse_qs(parts.query, True)) - {"token"}:
        raise ValueError("not socket://HOST:PORT")
    return parts.hostname, parts.port


def token_of(url: str) -> bytes:
    """Return the line that a board on TCP asks for first: the URL's ?token=, or that of this user's own board there.

    Nothing for other ports, such as a real board behind a server of serial ports.
    """
    if not url.startswith("socket://"):
        return b""
    host, port = _address(url)
    given = parse_qs(urlsplit(url).query).get("token")
    if given:
        return given[0].encode()[:MAX_TOKEN] + b"\n"
    if host in LOOPBACK:
        with suppress(OSError), (private_path() / f"tcp-{port}.token").open("rb") as stream:
            # Others may have made the folder: theirs is no token of ours.
            if os.fstat(stream.fileno()).st_uid == os.getuid():
                return stream.read(MAX_TOKEN)
    return b""

"""Open a board's port (a serial device, Unix or TCP socket) by its URL; transfer packets.

unix://PATH is a Unix socket, socket://HOST:PORT a TCP socket. pyserial opens other URLs.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import selectors
import socket
import stat
import time
from collections import deque
from numbers import Integral
from urllib.parse import parse_qs, urlsplit

import serial
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from lippmann.base.files import listening, private_folder, private_path
from lippmann.board.packets import DELIMITER, Packet, PacketReader
from lippmann.errors import DeviceError, InputError, NoBoardError, device_error, input_error, no_board_error

#: URL schemes of sockets.
SCHEMES = ("unix://", "socket://")
REMEDY = "give a serial device, or socket://HOST:PORT"
#: Bits per byte on the line: start bit, eight data bits, stop bit.
BITS_A_BYTE = 10
DEFAULT_BAUD = 115200
#: Maximum received packets in the queue; a full queue drops old packets.
MAX_WAITING = 1024
READ_BYTES = 65536
#: Time-out for writing a request, s.
SEND_S = 2.0
#: Time-out for connecting to a socket, s.
CONNECT_S = 5.0
#: Maximum length of a virtual board's access token, bytes.
MAX_TOKEN = 256
#: USB vendor numbers of serial adapters (FTDI, Silicon Labs, WCH, Prolific).
ADAPTER_VENDORS = (0x0403, 0x10C4, 0x1A86, 0x067B)


def open_port(url: str, baud: int = DEFAULT_BAUD) -> serial.Serial | socket.SocketIO:
    """Open a port for exclusive use; reads and writes do not block.

    Raises InputError for an invalid URL or baud rate, NoBoardError when the port is
    missing, busy, not permitted or refuses the connection, and DeviceError when the
    port does not support the baud rate.
    """
    address: object = url
    if not (isinstance(address, str) and address):
        what = "the port is empty" if isinstance(address, str) else f"{address!r} is not a port"
        raise InputError(f"{what}; {REMEDY}")
    if not (isinstance(baud, Integral) and baud > 0):
        raise InputError(f"the baud rate {baud} is not positive; give a rate such as {DEFAULT_BAUD}")
    try:
        if url.startswith(SCHEMES):
            return _connect(url)
        port: serial.Serial = serial.serial_for_url(url, baudrate=baud, timeout=0, write_timeout=0, exclusive=True)
    except (serial.SerialException, OSError) as error:
        raise _refusal(url, error) from None
    except (ValueError, TypeError, NotImplementedError) as error:
        if "baud" in str(error):
            raise device_error(url, f"the port does not support {baud} baud", "choose another rate") from None
        raise input_error(url, f"is not a port ({error})", REMEDY) from None
    return port


def _connect(url: str) -> socket.SocketIO:
    """Connect to a socket and send the token."""
    if url.startswith("unix://"):
        link, address = socket.socket(socket.AF_UNIX), url.removeprefix("unix://")
    else:
        link, address = socket.create_connection(_address(url), timeout=CONNECT_S), ""
        # Send short packets without waiting for acknowledgements.
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    with link:  # the returned file keeps the socket open
        if address:
            link.settimeout(CONNECT_S)
            link.connect(address)
        if token := token_of(url):
            link.sendall(token)
        link.setblocking(False)
        return link.makefile("rwb", buffering=0)


def _address(url: str) -> tuple[str, int]:
    parts = urlsplit(url)
    if not parts.hostname or parts.port is None or set(parse_qs(parts.query, True)) - {"token"}:
        raise ValueError("not socket://HOST:PORT")
    return parts.hostname, parts.port


def token_of(url: str) -> bytes:
    """Return a virtual board's access token from the URL (?token=) or this user's token file."""
    if not url.startswith("socket://"):
        return b""
    host, port = _address(url)
    tokens = parse_qs(urlsplit(url).query).get("token")
    if tokens:
        return tokens[0].encode()[:MAX_TOKEN] + b"\n"
    if host in ("127.0.0.1", "localhost") and hasattr(os, "getuid"):  # Windows has no virtual boards
        with contextlib.suppress(OSError), (private_path() / f"tcp-{port}.token").open("rb") as stream:
            # Another user's file is not this user's token.
            if os.fstat(stream.fileno()).st_uid == os.getuid():
                return stream.read(MAX_TOKEN)
    return b""


def own_boards() -> list[str]:
    """Return the URLs of this user's virtual boards, without connecting."""
    if not hasattr(socket, "AF_UNIX"):
        return []
    try:
        place = private_folder()
    except InputError:  # the folder belongs to another user
        return []
    live = listening()
    return sorted(f"unix://{path}" for path in place.glob("board-*.sock") if str(path) in live)


def _refusal(url: str, error: Exception) -> NoBoardError | InputError:
    cause: BaseException | None = error
    while isinstance(cause, serial.SerialException) and cause.errno is None:
        cause = cause.__context__
    if isinstance(cause, TypeError | ValueError | KeyError):
        return input_error(url, "is not an address", "give socket://HOST:PORT")
    if isinstance(cause, socket.gaierror):
        return no_board_error(url, "no such host", "check the name, or use 127.0.0.1")
    if isinstance(cause, TimeoutError):
        return no_board_error(url, "the host does not answer", "check its address and the network")
    if url.startswith("unix://"):
        other = getattr(cause, "errno", None) in (errno.EACCES, errno.EPERM)
        what = "the board belongs to another user" if other else "no board uses this socket"
        return no_board_error(url, what, "start your own board: lippmann board start")
    match getattr(cause, "errno", None):
        case errno.ENOENT if re.fullmatch(r"[\w.-]+:\d+", url):
            return input_error(url, "is not a port", f"did you mean socket://{url}?")
        case errno.ENOENT | errno.ENODEV | errno.ENXIO:
            others = ", ".join(ports()) or "this machine has none"
            what, remedy = "no such port", f"plug the board in, or name another port: {others}"
        case errno.EACCES | errno.EPERM:
            what, remedy = "no permission", _permission_remedy(url)
        case errno.EBUSY | errno.EAGAIN:
            what, remedy = "the port is busy", "close the other program that uses the port"
        case errno.ECONNREFUSED:
            what, remedy = "no program listens on this port", "start the virtual board: lippmann board start"
        case _ if "configure port" in str(error):  # pyserial gives no errno for errors of termios
            what, remedy = "is not a serial port", REMEDY
        case _:
            what, remedy = f"is not a usable port ({error})", REMEDY
    return no_board_error(url, what, remedy)


def _permission_remedy(path: str) -> str:
    with contextlib.suppress(OSError, KeyError, ImportError):
        import grp  # only Unix has this module

        device = os.stat(path)
        allowed = stat.S_IRGRP | stat.S_IWGRP
        if device.st_gid != 0 and device.st_mode & allowed == allowed:
            group = grp.getgrgid(device.st_gid).gr_name
            return f"join the group that owns the port: sudo usermod -aG {group} $USER, then log in again"
    return 'give one of your groups access by a udev rule such as GROUP="dialout", MODE="0660"'


def ports() -> list[str]:
    """Return this machine's serial ports, known USB adapters first."""
    by_vendor = sorted(
        list_ports.comports(), key=lambda port: (port.vid not in ADAPTER_VENDORS, port.vid is None, port.device)
    )
    return [port.device for port in by_vendor]


def adapter_ports() -> list[str]:
    """Return the serial ports of the USB vendors in `ADAPTER_VENDORS`."""
    return sorted(port.device for port in list_ports.comports() if port.vid in ADAPTER_VENDORS)


def port_info(url: str) -> ListPortInfo | None:
    """Return the system's description of a serial port; None if the port is not listed."""
    return next((port for port in list_ports.comports() if port.device == url), None)


def port_trouble(url: str) -> DeviceError | InputError | None:
    """Try to open a port; return the error, or None if the port opens."""
    try:
        open_port(url).close()
    except (DeviceError, InputError) as error:
        return error
    return None


class Line:
    """A packet connection for one thread; it reads while writing to avoid a deadlock."""

    def __init__(self, url: str, baud: int = DEFAULT_BAUD) -> None:
        self.url = url
        self.baud = baud
        self.reader = PacketReader()
        self.written = 0
        self._port = open_port(url, baud)
        self._waiting: deque[Packet] = deque(maxlen=MAX_WAITING)
        # A delimiter before the first packet ends another program's unfinished packet.
        self._broken = True
        self._closed = False
        # `select` would refuse file descriptors above 1,023.
        self._selector = selectors.DefaultSelector()
        #: Set if the port has no file descriptor (rfc2217://, loop://) and is polled.
        self._polled: serial.Serial | None = None
        try:
            self._selector.register(self._port, selectors.EVENT_READ)
        except (OSError, ValueError):
            assert not isinstance(self._port, socket.SocketIO)
            self._polled = self._port
            self._polled.write_timeout = None

    def close(self) -> None:
        """Close the port."""
        self._closed = True
        self._selector.close()
        self._port.close()

    @property
    def waiting(self) -> int:
        """Number of received packets in the queue."""
        return len(self._waiting)

    def seconds(self, count: int) -> float:
        """Return the transmission time of `count` bytes, s."""
        return count * BITS_A_BYTE / self.baud

    def send(self, packet: bytes, patience_s: float) -> bool:
        """Write a packet; return False if the port takes no byte for `patience_s`.

        Raises NoBoardError when the connection is lost.
        """
        if self._broken:
            packet = DELIMITER + packet
        self._broken = True
        end = time.monotonic() + patience_s
        while packet:
            writable = self._wait(max(end - time.monotonic(), 0.0), write=True)
            if writable:
                try:
                    count = self._port.write(packet) or 0
                except (serial.SerialException, OSError) as error:
                    raise self._lost(error) from None
                self.written += count
                packet = packet[count:]
                end = time.monotonic() + patience_s
            elif time.monotonic() >= end:
                return False
        self._broken = False
        return True

    def receive(self, wait_s: float) -> Packet | None:
        """Return the next packet, or None if no packet arrives for `wait_s`.

        Raises NoBoardError when the connection is lost.
        """
        end = time.monotonic() + wait_s
        while not self._waiting:
            remaining_s = end - time.monotonic()
            self._wait(max(remaining_s, 0.0), write=False)
            if remaining_s <= 0.0 and not self._waiting:
                return None
        return self._waiting.popleft()

    def _wait(self, wait_s: float, write: bool) -> bool:
        """Wait for the port and read its bytes; return whether the port accepts bytes."""
        if self._closed:
            raise device_error(self.url, "the line to the board is closed", "open the board again (Board.open)")
        if self._polled is not None:
            if not self._polled.in_waiting and not write:
                time.sleep(min(wait_s, 0.001))  # wait for the next poll
            self._take()
            return write
        self._selector.modify(self._port, selectors.EVENT_READ | selectors.EVENT_WRITE * write)
        events = sum(ready for _, ready in self._selector.select(wait_s))
        if events & selectors.EVENT_READ:
            self._take()
        return bool(events & selectors.EVENT_WRITE)

    def _take(self) -> None:
        data: bytes | None
        try:
            if self._polled is not None:
                data = self._polled.read(self._polled.in_waiting)
            else:
                is_socket = isinstance(self._port, socket.SocketIO)
                # pyserial's `read` would call `select`.
                data = self._port.read(READ_BYTES) if is_socket else os.read(self._port.fileno(), READ_BYTES)
                if data == b"":
                    raise ConnectionResetError("disconnected")
        except BlockingIOError:
            return
        except (serial.SerialException, OSError, TypeError) as error:
            raise self._lost(error) from None
        self._waiting.extend(self.reader.feed(data or b""))

    def _lost(self, error: Exception) -> NoBoardError:
        if self.url.startswith(SCHEMES) and not self.reader.bytes:
            what, remedy = "the board closed the connection", "close the other program that uses the board"
            if self.url.startswith("socket://") and not token_of(self.url):
                remedy += ", or give the board's token: socket://HOST:PORT?token=..."
            return no_board_error(self.url, what, remedy)
        first = "check that the board runs" if self.url.startswith(SCHEMES) else "plug the board in"
        remedy = f"{first}; a running board keeps the received data"
        return no_board_error(self.url, f"the connection is lost ({error})", remedy)

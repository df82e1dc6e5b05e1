"""Serial ports and sockets that pyserial opens by a URL, and packets over them."""

from __future__ import annotations

import contextlib
import errno
import grp
import os
import re
import select
import socket
import stat
import time
from collections import deque

import serial
from serial.tools import list_ports

from lippmann.board.packets import DELIMITER, Packet, PacketReader
from lippmann.board.socket_port import SCHEMES, SocketPort, token_of
from lippmann.errors import DeviceError, InputError, NoBoardError, device_error, input_error, no_board_error

#: Bits on the line for each byte: start bit, eight data bits, stop bit.
BITS_A_BYTE = 10
DEFAULT_BAUD = 115200
#: Pause before a port without a file number is polled again, s.
POLL_S = 0.001
#: Received packets that are kept for the caller; when more come, the oldest are dropped.
MAX_WAITING = 1024
READ_BYTES = 65536
#: Longest time to write a request to the port before it is sent again, s.
SEND_S = 2.0
#: USB vendors of the serial adapters on FPGA boards: FTDI, Silicon Labs, WCH, Prolific.
ADAPTER_VENDORS = (0x0403, 0x10C4, 0x1A86, 0x067B)


def open_port(url: str, baud: int = DEFAULT_BAUD) -> serial.Serial | SocketPort:
    """Open a port for this program alone: a URL of pyserial's `serial_for_url`. Its reads and writes do not block.

    Raises InputError for an invalid URL or baud rate; NoBoardError when the port does not exist, is busy, needs a
    permission, or refuses the connection; DeviceError when the port does not support the baud rate.
    """
    if not url:
        raise InputError("an empty port; give a device, or socket://HOST:PORT")
    if baud <= 0:
        raise InputError(f"the baud rate {baud} is not positive; give one such as {DEFAULT_BAUD}")
    try:
        if url.startswith(SCHEMES):
            return SocketPort(url)
        port: serial.Serial = serial.serial_for_url(url, baudrate=baud, timeout=0, write_timeout=0, exclusive=True)
    except (serial.SerialException, OSError) as error:
        raise _refusal(url, error) from None
    except (ValueError, TypeError, NotImplementedError) as error:
        if "baud" in str(error):
            raise device_error(url, f"the port does not support {baud} baud", "choose another rate") from None
        raise input_error(url, f"is not a port ({error})", "give a device, or socket://HOST:PORT") from None
    return port


def _refusal(url: str, error: Exception) -> NoBoardError | InputError:
    """Return the error of a port that did not open: the cause and the remedy."""
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
        what = "it belongs to another user" if other else "no board is there"
        return no_board_error(url, what, "start a board of your own: lippmann board start")
    match getattr(cause, "errno", None):
        case errno.ENOENT if re.fullmatch(r"[\w.-]+:\d+", url):
            return input_error(url, "is not a port", f"did you mean socket://{url}?")
        case errno.ENOENT | errno.ENODEV | errno.ENXIO:
            known = ", ".join(ports()) or "this machine has none"
            what, remedy = "no such port", f"plug the board in, or name another: {known}"
        case errno.EACCES | errno.EPERM:
            what, remedy = "no permission", _permission(url)
        case errno.EBUSY | errno.EAGAIN:
            what, remedy = "the port is busy", "close the other program that uses it"
        case errno.ECONNREFUSED:
            what, remedy = "no program listens there", "start the virtual board: lippmann board start"
        case _ if "configure port" in str(error):  # pyserial keeps no number of what termios refused
            what, remedy = "is not a serial port", "give a serial device, a pty, or socket://HOST:PORT"
        case _:
            what, remedy = f"is not a usable port ({error})", "give a serial device, a pty, or socket://HOST:PORT"
    return no_board_error(url, what, remedy)


def _permission(path: str) -> str:
    """Return how to get permission for a device: join its group, when the group may read and write it."""
    with contextlib.suppress(OSError, KeyError):
        found = os.stat(path)
        allowed = stat.S_IRGRP | stat.S_IWGRP
        if found.st_gid != 0 and found.st_mode & allowed == allowed:
            group = grp.getgrgid(found.st_gid).gr_name
            return f"join the group that owns it: sudo usermod -aG {group} $USER, then log in again"
    return 'give it to one of your groups, with a udev rule such as GROUP="dialout", MODE="0660"'


def ports() -> list[str]:
    """Return this machine's serial ports, known USB adapters first (see `adapter_ports`)."""
    found = list_ports.comports()
    found = sorted(found, key=lambda port: (port.vid not in ADAPTER_VENDORS, port.vid is None, port.device))
    return [port.device for port in found]


def adapter_ports() -> list[str]:
    """Return the serial ports whose USB vendor makes the adapters on FPGA boards."""
    return sorted(port.device for port in list_ports.comports() if port.vid in ADAPTER_VENDORS)


def serial_number(url: str) -> str:
    """Return the serial number of a port's USB adapter, empty when it has none."""
    return next((port.serial_number or "" for port in list_ports.comports() if port.device == url), "")


def port_trouble(url: str) -> DeviceError | InputError | None:
    """Return the error of a port that cannot be opened; None when it can."""
    try:
        open_port(url).close()
    except (DeviceError, InputError) as error:
        return error
    return None


class Line:
    """Packets over an open port, for one thread.

    It reads while it writes: two sides that only write would block each other. `written` counts the bytes written, the
    reader's `counts` the bytes and packets received.
    """

    def __init__(self, url: str, baud: int = DEFAULT_BAUD) -> None:
        self.url = url
        self.baud = baud
        self.reader = PacketReader()
        self.written = 0
        self._port = open_port(url, baud)
        self._waiting: deque[Packet] = deque(maxlen=MAX_WAITING)
        # A delimiter goes before the first packet: it ends a packet that another program left unfinished.
        self._broken = True
        self._closed = False
        try:
            self._fileno: int | None = self._port.fileno()
        except (OSError, AttributeError):  # rfc2217:// and loop:// have none
            self._fileno = None
            self._port.write_timeout = None

    def close(self) -> None:
        """Close the port."""
        self._closed = True
        self._port.close()

    @property
    def waiting(self) -> int:
        """Packets that have arrived and that `receive` has not returned yet."""
        return len(self._waiting)

    def seconds(self, count: int) -> float:
        """Return how long `count` bytes take on the line, s."""
        return count * BITS_A_BYTE / self.baud

    def send(self, packet: bytes, patience_s: float) -> bool:
        """Write a whole packet; return False when the port accepted no byte for `patience_s`.

        Like `receive`, it raises NoBoardError when the connection is lost.
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
        """Return the next valid packet, or None when none arrives within `wait_s`."""
        end = time.monotonic() + wait_s
        while not self._waiting:
            left = end - time.monotonic()
            self._wait(max(left, 0.0), write=False)
            if left <= 0.0 and not self._waiting:
                return None
        return self._waiting.popleft()

    def _wait(self, wait_s: float, write: bool) -> bool:
        """Read what has arrived; return whether the port accepts bytes. Waits at most `wait_s` for either."""
        if self._closed:
            raise device_error(self.url, "the line to the board is closed", "open it again (Board.open)")
        if self._fileno is None:
            if not self._port.in_waiting and not write:
                time.sleep(min(wait_s, POLL_S))
            self._take()
            return write
        readable, writable, _ = select.select([self._fileno], [self._fileno] if write else [], [], wait_s)
        if readable:
            self._take()
        return bool(writable)

    def _take(self) -> None:
        """Read what has arrived."""
        try:
            data = self._port.read(READ_BYTES if self._fileno is not None else self._port.in_waiting)
        except (serial.SerialException, OSError, TypeError) as error:
            raise self._lost(error) from None
        self._waiting.extend(self.reader.feed(data))

    def _lost(self, error: Exception) -> NoBoardError:
        if self.url.startswith(SCHEMES) and not self.reader.counts.bytes:
            what, remedy = "it closed the connection at once", "close the other program that uses the board"
            if self.url.startswith("socket://") and not token_of(self.url):
                remedy += ", or give the board's token: socket://HOST:PORT?token=..."
            return no_board_error(self.url, what, remedy)
        first = "see whether the board runs: if so," if self.url.startswith(SCHEMES) else "plug the board in;"
        remedy = f"{first} it keeps what arrived"
        return no_board_error(self.url, f"the connection is lost ({error})", remedy)

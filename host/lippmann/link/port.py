"""Ports: whatever pyserial opens by a URL (a device, a pty, socket://), and packets over it."""

from __future__ import annotations

import contextlib
import errno
import grp
import os
import select
import socket
import stat
import time
from collections import deque
from types import TracebackType

import serial
from serial.tools import list_ports

from lippmann.errors import DeviceError, InputError, NoBoardError, device_error, input_error, no_board_error
from lippmann.link.packets import DELIMITER, Packet, PacketReader

#: Bits on the line for each byte: start, eight, stop.
BITS_A_BYTE = 10
DEFAULT_BAUD = 115200
#: Longest pause between two looks at a port that cannot be waited on, s.
POLL_S = 0.001
#: Good packets held for the caller; of a flood the oldest go.
MAX_WAITING = 1024
READ_BYTES = 65536


def open_port(url: str, baud: int = DEFAULT_BAUD) -> serial.Serial:
    """Open a port for this program alone; reads and writes of it do not block.

    Parameters
    ----------
    url
        Whatever pyserial's `serial_for_url` takes.
    baud
        Bits a second; a socket takes no notice.

    Raises
    ------
    InputError
        For a URL or a baud rate that cannot be.
    NoBoardError
        When the port is missing, busy, forbidden, refused, or none.
    DeviceError
        When it does not run at this rate.
    """
    if not url:
        raise InputError("an empty port; give a device, or socket://HOST:PORT")
    if baud <= 0:
        raise InputError(f"a baud rate of {baud} cannot be; give a positive one, such as {DEFAULT_BAUD}")
    try:
        port = serial.serial_for_url(url, baudrate=baud, timeout=0, write_timeout=0, exclusive=True)
    except serial.SerialException as error:
        raise _refusal(url, error) from None
    except (ValueError, TypeError, NotImplementedError) as error:
        if "baud" in str(error):
            raise device_error(url, f"the port does not run at {baud} baud", "choose another rate") from None
        raise input_error(url, f"is no port ({error})", "give a device, or socket://HOST:PORT") from None
    if url.startswith("socket://"):
        # A short packet is not to wait for the one before to be acknowledged.
        with socket.fromfd(port.fileno(), socket.AF_INET, socket.SOCK_STREAM) as same:
            same.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return port


def _refusal(url: str, error: serial.SerialException) -> NoBoardError | InputError:
    """Say why a port did not open, and what helps."""
    # pyserial keeps a socket's own error as the context of its exception only.
    cause: BaseException | None = error
    while isinstance(cause, serial.SerialException) and cause.errno is None:
        cause = cause.__context__
    if isinstance(cause, TypeError | ValueError | KeyError):
        return input_error(url, "is no address", "give socket://HOST:PORT")
    if isinstance(cause, socket.gaierror):
        return no_board_error(url, "no such host", "check the name, or use 127.0.0.1")
    if isinstance(cause, TimeoutError):
        return no_board_error(url, "the host does not answer", "check its address and the network")
    missing = "no such port", "plug the board in, or name another: " + (", ".join(ports()) or "this machine has none")
    forbidden = "no permission", _permission(url)
    busy = "the port is busy", "close the other program that uses it"
    known = {
        errno.ENOENT: missing,
        errno.ENODEV: missing,
        errno.ENXIO: missing,
        errno.EACCES: forbidden,
        errno.EPERM: forbidden,
        errno.EBUSY: busy,
        errno.EAGAIN: busy,
        errno.ECONNREFUSED: ("nobody listens there", "start the virtual board: lippmann board start"),
    }
    what, remedy = known.get(
        cause.errno or 0 if isinstance(cause, OSError) else 0,
        (f"is no port that can be used ({error})", "give a serial device, a pty, or socket://HOST:PORT"),
    )
    return no_board_error(url, what, remedy)


def _permission(path: str) -> str:
    """Return how to get permission for a device: through its group, where that may read and write it."""
    with contextlib.suppress(OSError, KeyError):
        found = os.stat(path)
        allowed = stat.S_IRGRP | stat.S_IWGRP
        if found.st_gid != 0 and found.st_mode & allowed == allowed:
            group = grp.getgrgid(found.st_gid).gr_name
            return f"join the group that owns it: sudo usermod -aG {group} $USER, then log in again"
    return 'give it to a group of yours, by a rule of udev such as GROUP="dialout", MODE="0660"'


def ports() -> list[str]:
    """Return this machine's serial ports, those on USB first."""
    found = sorted(list_ports.comports(), key=lambda port: (port.vid is None, port.device))
    return [port.device for port in found]


def port_trouble(url: str) -> DeviceError | InputError | None:
    """Return why a port cannot be opened, and what helps; None when it can."""
    try:
        open_port(url).close()
    except (DeviceError, InputError) as error:
        return error
    return None


class Line:
    """Packets over an open port. One thread at a time; while it writes it reads, so neither side waits in vain.

    Attributes
    ----------
    url, baud
        As opened.
    reader
        Its `counts` tell what came.
    written
        Bytes given to the port.
    """

    def __init__(self, url: str, baud: int = DEFAULT_BAUD) -> None:
        self.url = url
        self.baud = baud
        self.reader = PacketReader()
        self.written = 0
        self._port = open_port(url, baud)
        self._waiting: deque[Packet] = deque(maxlen=MAX_WAITING)
        # What the board may have heard before is ended.
        self._broken = True
        try:
            self._fileno: int | None = self._port.fileno()
        except (OSError, AttributeError):  # rfc2217:// and loop:// have none
            self._fileno = None
            self._port.write_timeout = None

    def __enter__(self) -> Line:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the port back."""
        # pyserial forgets a socket that its peer has closed, and leaves it open.
        connection = getattr(self._port, "_socket", None)
        self._port.close()
        if connection is not None:
            connection.close()

    @property
    def waiting(self) -> int:
        """Packets that came and were not yet received."""
        return len(self._waiting)

    def seconds(self, count: int) -> float:
        """Return how long some bytes take on the line, s."""
        return count * BITS_A_BYTE / self.baud

    def send(self, packet: bytes, patience_s: float) -> bool:
        """Write a packet whole; return False when the line took nothing for `patience_s`.

        Raises
        ------
        NoBoardError
            When the line is lost.
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
        """Return the next good packet, or None when none came for `wait_s`.

        Raises
        ------
        NoBoardError
            When the line is lost.
        """
        end = time.monotonic() + wait_s
        while not self._waiting:
            left = end - time.monotonic()
            self._wait(max(left, 0.0), write=False)
            if left <= 0.0 and not self._waiting:
                return None
        return self._waiting.popleft()

    def _wait(self, wait_s: float, write: bool) -> bool:
        """Take what came; return whether the port takes bytes. Ends with either, or after `wait_s`."""
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
        """Read what is there."""
        try:
            data = self._port.read(READ_BYTES if self._fileno is not None else self._port.in_waiting)
        except (serial.SerialException, OSError, TypeError) as error:
            raise self._lost(error) from None
        self._waiting.extend(self.reader.feed(data))

    def _lost(self, error: Exception) -> NoBoardError:
        if self.url.startswith("socket://") and not self.reader.counts.bytes:
            return no_board_error(
                self.url, "it hung up before it said anything", "close another program that talks to the board"
            )
        return no_board_error(self.url, f"the line is lost ({error})", "plug the board in again; what it holds is kept")

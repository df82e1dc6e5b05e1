"""A session with a board: requests for HELLO, registers, tile CRCs and buffer swaps."""

from __future__ import annotations

import secrets
import struct
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Annotated, NamedTuple, Self

import numpy as np

from lippmann.base.toml import documented, key
from lippmann.board.packets import MAX_PACKET, REPLY, VERSIONS, Kind, ReplyStatus, packed
from lippmann.board.port import DEFAULT_BAUD, SEND_S, Line
from lippmann.board.retries import UPDATE, RoundTrip, refusal
from lippmann.board.tiles import TILE, Crcs, TileGrid
from lippmann.errors import DeviceError, InputError, NoBoardError
from lippmann.fixed.registers import BOARD_REGISTERS, OPTICS_REGISTERS, SCENE_REGISTERS, Write

#: Time without a reply after which a request fails, s.
PATIENCE_S = 10.0
#: Clock of the slowest (simulated) board, Hz; it sets the time-out of frame requests.
SLOWEST_HZ = 3e5
#: Clock cycles per pixel allowed for PRESENT: twice what CRC and buffer swap take.
PRESENT_CLOCKS = 4
#: Maximum words in a READ or WRITE request, and tiles in a TILES request.
MAX_WORDS, MAX_TILES = 64, 512
#: First register addresses of optics block and scene.
OPTICS_BASE, SCENE_BASE = 0x200, 0x400
#: Registers with their board addresses, keyed by name with the block's prefix.
REGISTERS = {
    prefix + name: replace(register, address=base + register.address)
    for prefix, base, registers in (
        ("", 0, BOARD_REGISTERS),
        ("optics.", OPTICS_BASE, OPTICS_REGISTERS),
        ("scene.", SCENE_BASE, SCENE_REGISTERS),
    )
    for name, register in registers.items()
}

HELLO_REQUEST = struct.Struct("<BI")
HELLO_REPLY = struct.Struct("<BIQHHBHIHI")
READ_REQUEST = struct.Struct("<HB")
ADDRESS = struct.Struct("<H")
PRESENT_REQUEST = struct.Struct("<HI")
EPOCH = struct.Struct("<H")
TILES_REQUEST = struct.Struct("<BHH")
TILES_REPLY = struct.Struct("<HH")


@documented
class Hello(NamedTuple):
    """A board's reply to HELLO."""

    version: Annotated[int, key("protocol version")]
    identity: Annotated[int, key("identity of the board's display (`Display.identity` as a number)")]
    width: Annotated[int, key("panel width, px")]
    height: Annotated[int, key("panel height, px")]
    tile: Annotated[int, key("side length of a tile, px")]
    max_packet: Annotated[int, key("maximum packet length that the board accepts, bytes before COBS")]
    clock_hz: Annotated[int, key("clock frequency of the board")]
    epoch: Annotated[int, key("number of buffer swaps, modulo 2^16")]
    optics: Annotated[int, key("word of the optics block's register `build`")]

    @property
    def grid(self) -> TileGrid:
        """The tile grid of the panel."""
        return TileGrid(self.width, self.height)


class TileTable(NamedTuple):
    """The epoch, and the CRC-32 (count,) of each tile of a frame buffer; 0 for an empty tile."""

    epoch: int
    crcs: Crcs


class Session:
    """The open connection to a board; a `with` block closes it. `info` is the latest reply to HELLO.

    A request is repeated until its reply arrives. A request raises DeviceError when the
    board refuses it, and NoBoardError when no reply arrives within `patience_s` seconds.
    """

    def __init__(self, line: Line, patience_s: float = PATIENCE_S) -> None:
        self.line, self.patience_s = line, patience_s
        # A random first sequence number rarely matches a late reply to another program.
        self._seq = secrets.randbits(16)
        self._round_trip = RoundTrip()
        self.info = self.hello()

    @classmethod
    def open(cls, url: str, baud: int = DEFAULT_BAUD, patience_s: float = PATIENCE_S) -> Self:
        """Open a serial device, a pty, unix://PATH or socket://HOST:PORT, and send HELLO.

        Raises `open_port`'s errors, and DeviceError if no board with this protocol
        answers.
        """
        line = Line(url, baud)
        try:
            return cls(line, patience_s)
        except BaseException:
            line.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the port."""
        self.line.close()

    def next_seq(self) -> int:
        """Return the next sequence number."""
        self._seq = (self._seq + 1) & 0xFFFF
        return self._seq

    def ask(self, kind: Kind, body: bytes, size: int, work_s: float = 0.0) -> bytes:
        """Send a request; return the `size` bytes after the reply's status.

        Raises the errors of `checked`.
        """
        status, answer = self.request(kind, body, work_s)
        return self.checked(kind, status, answer, size)

    def checked(self, kind: Kind, status: int, body: bytes, size: int) -> bytes:
        """Return a reply's body.

        Raises an error unless the status is OK and the body has `size` bytes.
        """
        if status != ReplyStatus.OK:
            raise refusal(self.line.url, kind, status, body)
        if len(body) != size:
            raise self.error(f"the board's reply to {kind.name} has {len(body)} bytes, not {size}", UPDATE)
        return body

    def request(self, kind: Kind, body: bytes, work_s: float = 0.0, seq: int | None = None) -> tuple[int, bytes]:
        """Repeat a request until its reply arrives; return the status and the rest of the body.

        All repetitions have the same sequence number `seq` (default: a new number), so
        the board executes the request once. Raises NoBoardError if no reply arrives for
        `work_s` plus `patience_s`; a line that accepts no bytes adds `SEND_S`.
        """
        seq = self.next_seq() if seq is None else seq
        packet = packed(kind, seq, body)
        end = time.monotonic() + work_s + self.patience_s
        again = False
        while True:
            self.line.send(packet, min(SEND_S, self.patience_s))
            sent_at = time.monotonic()
            until = min(end, sent_at + self._round_trip.time_out_s + self.line.seconds(len(packet) + MAX_PACKET))
            # Other packets may arrive endlessly, so check the time after each packet.
            while time.monotonic() < until:
                reply = self.line.receive(until - time.monotonic())
                if reply and reply.kind == kind | REPLY and reply.seq == seq and reply.body:
                    if again:
                        self._round_trip.ease()
                    elif not work_s:
                        self._round_trip.sample(time.monotonic() - sent_at)
                    return reply.body[0], reply.body[1:]
            if time.monotonic() >= end:
                self._round_trip.give_up()
                raise self.silence()
            self._round_trip.back_off()
            again = True

    def silence(self) -> NoBoardError:
        """Return the error for a board that does not answer."""
        counts = self.line.reader
        what, remedy = "nothing answers", "check the board's power, the cable, the port and the baud rate"
        if counts.accepted:
            what = f"the board has not answered for {self.patience_s:g} s"
            remedy = "check the board's power and cable, or a virtual board's machine load"
        elif counts.bytes:
            what = f"{counts.bytes} bytes arrived, but no packet at {self.line.baud} baud"
            remedy = "give the board's baud rate, or the port of a board"
        return NoBoardError.at(self.line.url, what, remedy)

    def error(self, what: str, remedy: str) -> DeviceError:
        """Return a DeviceError that names the board's port."""
        return DeviceError.at(self.line.url, what, remedy)

    def hello(self) -> Hello:
        """Send HELLO, check the reply and store it in `info`.

        Raises DeviceError for a board that this host does not support.
        """
        nonce = secrets.randbits(32)
        for spoken in VERSIONS:
            status, body = self.request(Kind.HELLO, HELLO_REQUEST.pack(spoken, nonce))
            if status != ReplyStatus.WRONG_VERSION:
                break
        version, echo, *others = HELLO_REPLY.unpack(self.checked(Kind.HELLO, status, body, HELLO_REPLY.size))
        hello = Hello(version, *others)
        if version != spoken:
            raise self.error(f"the board replies in protocol version {version}, but {spoken} was requested", UPDATE)
        if echo != nonce:
            raise self.error("the reply belongs to another HELLO", "check that no other program uses this line")
        if hello.tile != TILE or hello.max_packet < MAX_PACKET or not 1 <= hello.grid.count <= 1 << 16:
            limits = f"panel {hello.width} x {hello.height}, tile {hello.tile}, packet {hello.max_packet}"
            raise self.error(f"this host does not support the board's limits ({limits})", UPDATE)
        self.info = hello
        return hello

    def must_be(self, before: Hello) -> None:
        """Raise DeviceError if the display's identity or size differs from that in `before`."""
        if (self.info.identity, self.info.width, self.info.height) != (before.identity, before.width, before.height):
            raise self.error("another board answers now", "stream an image rendered for that board's display")

    def read(self, address: int, count: int = 1) -> list[int]:
        """Return `count` words starting at a byte address.

        Raises InputError for an address without a register.
        """
        words: list[int] = []
        for first in range(0, count, MAX_WORDS):
            size = min(MAX_WORDS, count - first)
            body = self.ask(Kind.READ, READ_REQUEST.pack(_checked(address + 4 * first), size), 4 * size)
            words += struct.unpack(f"<{size}I", body)
        return words

    def word(self, name: str) -> int:
        """Return the word of the register `REGISTERS[name]`."""
        return self.read(REGISTERS[name].address)[0]

    def fields(self, name: str) -> dict[str, int]:
        """Return the fields of the register `REGISTERS[name]`."""
        return REGISTERS[name].values(self.word(name))

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write 1 to 64 words starting at a byte address; the board writes all words or none.

        Raises InputError for an address without a register, and for words that do not fit.
        """
        if not 1 <= len(words) <= MAX_WORDS:
            raise InputError(f"{len(words)} words cannot be written at once; give 1 to {MAX_WORDS}")
        if wide := [word for word in words if not 0 <= word < 1 << 32]:
            raise InputError(f"the word {wide[0]} does not fit into 32 bits; give 0 to 0xFFFFFFFF")
        self.ask(Kind.WRITE, ADDRESS.pack(_checked(address)) + struct.pack(f"<{len(words)}I", *words), 0)

    def write_all(self, writes: Iterable[Write]) -> None:
        """Write registers of the optics block in order; one request writes adjacent registers."""
        runs: list[list[Write]] = []
        for one in writes:
            if runs and one.address == runs[-1][-1].address + 4 and len(runs[-1]) < MAX_WORDS:
                runs[-1].append(one)
            else:
                runs.append([one])
        for run in runs:
            self.write(OPTICS_BASE + run[0].address, [one.word for one in run])

    def tiles(self, buffer: int) -> TileTable:
        """Return the tile CRCs of a frame buffer, `BACK` or `FRONT`."""
        count = self.info.grid.count
        crcs = np.empty(count, np.uint32)
        epochs = set()
        for first in range(0, count, MAX_TILES):
            size = min(MAX_TILES, count - first)
            body = self.ask(Kind.TILES, TILES_REQUEST.pack(buffer, first, size), TILES_REPLY.size + 4 * size)
            epoch, echo = TILES_REPLY.unpack(body[: TILES_REPLY.size])
            if echo != first:
                raise self.error(f"the board replies for tile {echo}, not tile {first}", "update the board")
            epochs.add(epoch)
            crcs[first : first + size] = np.frombuffer(body[TILES_REPLY.size :], "<u4")
        if len(epochs) > 1:
            raise self.error("the buffers were swapped during the query", "let one program at a time use the board")
        return TileTable(epochs.pop(), crcs)

    def present(self, epoch: int, crc: int) -> tuple[ReplyStatus, int]:
        """Swap the buffers if the back buffer's CRC-32 is `crc`.

        Return OK and the new epoch, or the status of a refusal and `epoch`.
        """
        clocks = PRESENT_CLOCKS * self.info.width * self.info.height
        status, body = self.request(Kind.PRESENT, PRESENT_REQUEST.pack(epoch, crc), clocks / SLOWEST_HZ)
        if status in (ReplyStatus.STALE_EPOCH, ReplyStatus.FRAME_CRC_DIFFERS):
            return ReplyStatus(status), epoch
        return ReplyStatus.OK, EPOCH.unpack(self.checked(Kind.PRESENT, status, body, EPOCH.size))[0]


def _checked(address: int) -> int:
    if address % 4 or not 0 <= address < 1 << 16:
        raise InputError(f"0x{address:X} is not a register address; give a multiple of 4 up to 0xFFFC")
    return address

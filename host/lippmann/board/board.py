"""The board as the host sees it: one request at a time, sent again until its reply comes."""

from __future__ import annotations

import secrets
import struct
import time
from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import NamedTuple

import numpy as np

from lippmann.board.tiles import TILE, Crcs, Grid
from lippmann.errors import (
    DeviceError,
    InputError,
    LippmannError,
    NoBoardError,
    device_error,
    input_error,
    no_board_error,
)
from lippmann.fixed.build import Build
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.register_file import Write, build_of
from lippmann.fixed.words import Ints
from lippmann.link.packets import MAX_PACKET, REPLY, VERSION, Kind, Status, packed
from lippmann.link.port import DEFAULT_BAUD, Line
from lippmann.link.round_trip import RoundTrip
from lippmann.registers import OPTICS_REGISTERS

#: How long a board may be silent before it counts as gone, s.
PATIENCE_S = 10.0
#: How long a request may take to leave the port before it counts as lost, s.
SEND_S = 2.0
#: Slowest clock of a board, one that is simulated: bounds the wait where the board has a whole frame to do, Hz.
SLOWEST_HZ = 3e5
#: Clocks for each pixel of a PRESENT: the CRC, the wait for the swap, and as much again.
PRESENT_CLOCKS = 4
#: Clocks for each ray of a SIGN, nine words of it.
SIGN_CLOCKS = 10
#: Rays a TRACE holds, words a READ or WRITE, tiles a TILES.
MAX_RAYS, MAX_WORDS, MAX_TILES = 64, 64, 512
#: Where the optics block's registers begin in the board's addresses.
OPTICS_BASE = 0x200

HELLO_REQUEST = struct.Struct("<BI")
HELLO_REPLY = struct.Struct("<BIQHHBHIHI")
READ_REQUEST = struct.Struct("<HB")
ADDRESS = struct.Struct("<H")
PRESENT_REQUEST = struct.Struct("<HI")
EPOCH = struct.Struct("<H")
TILES_REQUEST = struct.Struct("<BHH")
TILES_REPLY = struct.Struct("<HH")
SIGNATURE = struct.Struct("<II")

BACK, FRONT = 0, 1

#: What a refusal means, and what helps.
REFUSALS = {
    Status.UNKNOWN_TYPE: ("it does not know this request", "update the board"),
    Status.WRONG_LENGTH: ("it takes this request for malformed", "update the board or this host"),
    Status.NO_SUCH_ADDRESS: (
        "it has no register there, or not for this",
        "see docs/reference/board-registers.md for those it has",
    ),
    Status.STALE_EPOCH: ("its buffers were swapped meanwhile", "stream the frame again"),
    Status.BAD_TILE_DATA: ("it cannot decode a tile", "update the board or this host"),
    Status.FRAME_CRC_DIFFERS: ("it holds another frame than was sent", "stream the frame again"),
    Status.NO_SUCH_TILE: ("it has no such tile", "render the image for this panel"),
    Status.WRONG_VERSION: (f"it does not speak version {VERSION} of the protocol", "update the board or this host"),
    Status.OPTICS_REFUSED: ("its optics block refuses the window", "write the raster's registers first"),
}


class Hello(NamedTuple):
    """What a board says of itself.

    Attributes
    ----------
    version
        Of the protocol.
    identity
        The display's that the board is set up for (see `Display.identity`, there in hexadecimal).
    width, height
        The panel, px.
    tile
        Side of a tile, px.
    max_packet
        Longest packet it takes, bytes before COBS.
    clock_hz
        Its clock.
    epoch
        Swaps of its buffers, modulo 2^16.
    optics
        The optics block's register `build`.
    """

    version: int
    identity: int
    width: int
    height: int
    tile: int
    max_packet: int
    clock_hz: int
    epoch: int
    optics: int

    @property
    def grid(self) -> Grid:
        """The panel's tiles."""
        return Grid(self.width, self.height)


class Table(NamedTuple):
    """CRC-32 of a buffer's tiles (count,), 0 where it holds nothing, and the epoch they belong to."""

    epoch: int
    crcs: Crcs


class Signature(NamedTuple):
    """Number of a frame's rays and the CRC-32 of all their words."""

    rays: int
    crc: int


class Board:
    """A board at the end of a line, open from `open` to the end of its `with` block.

    Attributes
    ----------
    line
        The line, which the board owns.
    info
        What the board said of itself last.
    """

    def __init__(self, line: Line, patience_s: float = PATIENCE_S) -> None:
        self.line = line
        self.patience_s = patience_s
        # Random, so that replies that are still on their way to another program fit nothing here.
        self._seq = secrets.randbits(16)
        self._round_trip = RoundTrip()
        self.info = self.hello()

    @classmethod
    def open(cls, url: str, baud: int = DEFAULT_BAUD, patience_s: float = PATIENCE_S) -> Board:
        """Open a port and greet the board there.

        Raises
        ------
        InputError
            For a URL or a baud rate that cannot be.
        DeviceError
            When the port does not open, or no board answers that this host can talk to.
        """
        line = Line(url, baud)
        try:
            return cls(line, patience_s)
        except BaseException:
            line.close()
            raise

    def __enter__(self) -> Board:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the port back."""
        self.line.close()

    def hello(self) -> Hello:
        """Begin a session: ask who is there, check that it can be talked to, and remember the answer.

        Raises
        ------
        DeviceError
            When nobody answers, or with another version or limits that this host does not know.
        """
        nonce = secrets.randbits(32)
        body = self._ask(Kind.HELLO, HELLO_REQUEST.pack(VERSION, nonce), HELLO_REPLY.size)
        version, echo, *rest = HELLO_REPLY.unpack(body)
        hello = Hello(version, *rest)
        if version != VERSION:
            raise self._error(f"the board speaks version {version} of the protocol, this host {VERSION}", "update one")
        if echo != nonce:
            raise self._error("something answers with another greeting", "see what else uses this line")
        if hello.tile != TILE or hello.max_packet < MAX_PACKET or not 1 <= hello.grid.count <= 1 << 16:
            raise self._error(
                f"the board names limits that this host does not know (panel {hello.width} x {hello.height}, "
                f"tile {hello.tile}, packet {hello.max_packet})",
                "update one",
            )
        self.info = hello
        return hello

    def must_be(self, before: Hello) -> None:
        """Refuse a board that drives another display than one that was greeted before.

        Raises
        ------
        DeviceError
            When it does.
        """
        if (self.info.identity, self.info.width, self.info.height) != (before.identity, before.width, before.height):
            raise self._error(
                "another board answers than before",
                "stream to it anew, with an image that was rendered for its display",
            )

    def read(self, address: int, count: int = 1) -> list[int]:
        """Return words from a byte address on, a multiple of 4.

        Raises
        ------
        InputError
            For an address where the board has no register.
        DeviceError
            When the board does not answer.
        """
        words: list[int] = []
        for first in range(0, count, MAX_WORDS):
            some = min(MAX_WORDS, count - first)
            body = self._ask(Kind.READ, READ_REQUEST.pack(_checked(address + 4 * first), some), 4 * some)
            words += struct.unpack(f"<{some}I", body)
        return words

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write 1 to 64 words from a byte address on: all of them or none, once.

        Raises
        ------
        InputError
            For an address where the board has no register, too many words, or none.
        DeviceError
            When the board does not answer.
        """
        if not 1 <= len(words) <= MAX_WORDS:
            raise InputError(f"{len(words)} words cannot be written at once; give 1 to {MAX_WORDS}")
        if not all(0 <= word < 1 << 32 for word in words):
            raise InputError("a word to write is outside its 32 bits; give 0 to 0xFFFFFFFF")
        self._ask(Kind.WRITE, ADDRESS.pack(_checked(address)) + struct.pack(f"<{len(words)}I", *words), 0)

    def write_all(self, writes: Iterable[Write], base: int = OPTICS_BASE) -> None:
        """Write registers in their order, neighbours together; addresses count from `base`. Raises as `write`."""
        run: list[Write] = []
        for one in writes:
            if run and (one.address != run[-1].address + 4 or len(run) == MAX_WORDS):
                self.write(base + run[0].address, [write.word for write in run])
                run = []
            run.append(one)
        if run:
            self.write(base + run[0].address, [write.word for write in run])

    def optics_build(self) -> Build:
        """Return what the board's optics were built with. Raises as `read`, and InputError for unknown optics."""
        names = ("identity", "version", "build")
        return build_of({name: self.read(OPTICS_BASE + OPTICS_REGISTERS[name].address)[0] for name in names})

    def tiles(self, buffer: int) -> Table:
        """Return the CRCs of the tiles of a buffer, `BACK` or `FRONT`.

        Raises
        ------
        DeviceError
            When the board does not answer, or swaps its buffers meanwhile.
        """
        count = self.info.grid.count
        crcs = np.empty(count, np.uint32)
        epochs = set()
        for first in range(0, count, MAX_TILES):
            some = min(MAX_TILES, count - first)
            body = self._ask(Kind.TILES, TILES_REQUEST.pack(buffer, first, some), TILES_REPLY.size + 4 * some)
            epoch, echo = TILES_REPLY.unpack(body[: TILES_REPLY.size])
            if echo != first:
                raise self._error(f"the board answers for tile {echo}, asked for {first}", "update the board")
            epochs.add(epoch)
            crcs[first : first + some] = np.frombuffer(body[TILES_REPLY.size :], "<u4")
        if len(epochs) > 1:
            raise self._error("its buffers were swapped meanwhile", "let one program at a time use the board")
        return Table(epochs.pop(), crcs)

    def present(self, epoch: int, crc: int) -> tuple[Status, int]:
        """Ask to show the back buffer; return OK, STALE_EPOCH or FRAME_CRC_DIFFERS, and the board's epoch.

        Without OK the epoch is the one that was asked for.

        Raises
        ------
        DeviceError
            When the board does not answer.
        """
        clocks = PRESENT_CLOCKS * self.info.width * self.info.height
        status, body = self._request(Kind.PRESENT, PRESENT_REQUEST.pack(epoch, crc), clocks / SLOWEST_HZ)
        if status in (Status.STALE_EPOCH, Status.FRAME_CRC_DIFFERS):
            return Status(status), epoch
        return Status.OK, EPOCH.unpack(self._good(Kind.PRESENT, status, body, EPOCH.size))[0]

    def trace(self, u: Ints, v: Ints, a: Ints, b: Ints) -> FixedRays:
        """Trace rays (N,) through the board's pipeline; words as `lippmann.fixed.ray_pipeline` takes and gives them.

        Raises
        ------
        DeviceError
            When the board does not answer.
        """
        rays = np.stack([u, v, a, b], axis=1).astype("<i4")
        out = np.empty((len(rays), len(FixedRays._fields)), np.int64)
        for first in range(0, len(rays), MAX_RAYS):
            some = rays[first : first + MAX_RAYS]
            body = self._ask(Kind.TRACE, some.tobytes(), 4 * out.shape[1] * len(some))
            out[first : first + MAX_RAYS] = np.frombuffer(body, "<i4").reshape(len(some), -1)
        return FixedRays(*out.T)

    def sign(self, rays: int) -> Signature:
        """Run one frame of the raster, of about `rays` rays; return their number and CRC-32.

        Raises
        ------
        DeviceError
            When the board does not answer, or refuses the raster's window.
        """
        body = self._ask(Kind.SIGN, b"", SIGNATURE.size, SIGN_CLOCKS * rays / SLOWEST_HZ)
        return Signature(*SIGNATURE.unpack(body))

    def next_seq(self) -> int:
        """Return a sequence number that was not used lately."""
        self._seq = (self._seq + 1) & 0xFFFF
        return self._seq

    def silence(self) -> NoBoardError:
        """Return the error of a board that does not answer, with what the line tells of the cause."""
        counts = self.line.reader.counts
        if counts.accepted:
            return no_board_error(
                self.line.url, f"the board has not answered for {self.patience_s:g} s", "check its power and the cable"
            )
        if counts.bytes:
            return no_board_error(
                self.line.url,
                f"{counts.bytes} bytes came, but no packet: no board, or one at another baud rate than "
                f"{self.line.baud}",
                "give the board's rate",
            )
        return no_board_error(
            self.line.url, "nothing answers", "check the board's power, the cable, the port and the baud rate"
        )

    def refusal(self, kind: int, status: int) -> LippmannError:
        """Return the error of a status other than OK."""
        name = Kind(kind).name
        if status not in REFUSALS:
            return self._error(f"the board answers {name} with status {status}", "update the board or this host")
        what, remedy = REFUSALS[Status(status)]
        make = input_error if status == Status.NO_SUCH_ADDRESS else device_error
        return make(self.line.url, f"the board refuses {name}: {what}", remedy)

    def _error(self, what: str, remedy: str) -> DeviceError:
        return device_error(self.line.url, what, remedy)

    def _ask(self, kind: Kind, body: bytes, size: int, work_s: float = 0.0) -> bytes:
        """Return the reply's body behind its status, `size` bytes; raise for another status."""
        status, answer = self._request(kind, body, work_s)
        return self._good(kind, status, answer, size)

    def _good(self, kind: Kind, status: int, body: bytes, size: int) -> bytes:
        if status != Status.OK:
            raise self.refusal(kind, status)
        if len(body) != size:
            raise self._error(
                f"the board's reply to {kind.name} has {len(body)} bytes, not {size}", "update the board or this host"
            )
        return body

    def _request(self, kind: Kind, body: bytes, work_s: float) -> tuple[int, bytes]:
        """Send a request until its reply comes; return status and the rest of the reply's body.

        The sequence number stays the same, by which the board knows what it has done already. Ends after the board's
        work and `patience_s` at the latest, and a send that the line does not take.
        """
        seq = self.next_seq()
        packet = packed(kind, seq, body)
        end = time.monotonic() + work_s + self.patience_s
        again = False
        while True:
            self.line.send(packet, min(SEND_S, self.patience_s))
            sent = time.monotonic()
            until = min(end, sent + self._round_trip.time_out_s + self.line.seconds(len(packet) + MAX_PACKET))
            # Not until nothing comes: of what nobody asked for there may be no end.
            while time.monotonic() < until:
                reply = self.line.receive(until - time.monotonic())
                if reply and reply.kind == kind | REPLY and reply.seq == seq and reply.body:
                    if again:
                        self._round_trip.ease()
                    elif not work_s:
                        self._round_trip.sample(time.monotonic() - sent)
                    return reply.body[0], reply.body[1:]
            if time.monotonic() >= end:
                raise self.silence()
            self._round_trip.back_off()
            again = True


def _checked(address: int) -> int:
    """Refuse an address that no request can hold."""
    if address % 4 or not 0 <= address < 1 << 16:
        raise InputError(f"address 0x{address:X} is none of a register; give a multiple of 4 up to 0xFFFC")
    return address

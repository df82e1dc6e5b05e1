"""A board: requests to it, one at a time and sent again until the reply arrives, and images on its panel."""

from __future__ import annotations

import contextlib
import secrets
import struct
import time
from collections.abc import Iterable, Sequence
from typing import Annotated, NamedTuple, Self

import numpy as np

from lippmann.base.progress import Progress
from lippmann.base.toml import documented, key
from lippmann.board.packets import MAX_PACKET, REPLY, RESET_VERSION, VERSIONS, Kind, ReplyStatus, packed
from lippmann.board.panel_frames import image_frame
from lippmann.board.port import DEFAULT_BAUD, SEND_S, Line
from lippmann.board.round_trip import RoundTrip
from lippmann.board.streaming import Sent, send_frame
from lippmann.board.tiles import TILE, Crcs, TileGrid
from lippmann.errors import DeviceError, InputError, LippmannError, NoBoardError
from lippmann.fixed.build import Build
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.registers import BOARD_REGISTERS, OPTICS_REGISTERS, Write, build_of
from lippmann.fixed.words import Ints
from lippmann.rendering.integral_image import IntegralImage

#: Longest silence of a board before a request fails, s.
PATIENCE_S = 10.0
#: Slowest clock of a board (a simulated one), Hz: bounds the wait for requests that process a whole frame.
SLOWEST_HZ = 3e5
#: Clocks for each pixel of a PRESENT: CRC and buffer swap, doubled for safety.
PRESENT_CLOCKS = 4
#: Frame ends until one whole frame has begun and ended.
FRAME_ENDS = 2
#: Longest time for these frames, s: a simulated panel is slow.
FRAME_SECONDS = 120.0
#: Pause between two queries of the frame counter, or of a signature, s.
QUERY_S = 0.02
#: Clocks for each ray of a SIGN: nine words, and one to spare.
SIGN_CLOCKS = 10
#: Clocks for each tile of a RESET: two entries are cleared, in a table of a power of two.
RESET_CLOCKS = 8
#: What runs, in the reply of a busy board: a frame that a write started, the SIGN that is answered, the drawing of
#: the panel; or the slot of a BLOCK is shown.
FRAME_RUNS, THIS_RUNS, SCENE_RUNS, SLOT_SHOWN = 1, 3, 4, 5
#: Most rays in a TRACE, words in a READ or WRITE, tiles in a TILES request.
MAX_RAYS, MAX_WORDS, MAX_TILES = 64, 64, 512
#: Address of the optics block's first register.
OPTICS_BASE = 0x200
#: Address of the scene's first register.
SCENE_BASE = 0x400

HELLO_REQUEST = struct.Struct("<BI")
HELLO_REPLY = struct.Struct("<BIQHHBHIHI")
READ_REQUEST = struct.Struct("<HB")
ADDRESS = struct.Struct("<H")
PRESENT_REQUEST = struct.Struct("<HI")
EPOCH = struct.Struct("<H")
TILES_REQUEST = struct.Struct("<BHH")
TILES_REPLY = struct.Struct("<HH")
SIGNATURE = struct.Struct("<II")
BUSY_REPLY = struct.Struct("<BI")

UPDATE = "update the board or this host"
#: Remedy where the scene that the board draws is in the way.
END_SCENE = "end the scene first: lippmann board write scene.source scene=0"
#: Cause and remedy of each refusal.
REFUSALS = {
    ReplyStatus.UNKNOWN_TYPE: ("it does not know this request", "update the board"),
    ReplyStatus.WRONG_LENGTH: ("the request has the wrong length", UPDATE),
    ReplyStatus.NO_SUCH_ADDRESS: (
        "the address is in no block of registers, or cannot be written",
        "see docs/reference/board-registers.md, and scene-registers.md of a board that draws",
    ),
    ReplyStatus.STALE_EPOCH: ("its buffers were swapped during the transfer", "stream the frame again"),
    ReplyStatus.BAD_TILE_DATA: ("it cannot decode a tile", UPDATE),
    ReplyStatus.FRAME_CRC_DIFFERS: ("its frame differs from the one sent", "stream the frame again"),
    ReplyStatus.NO_SUCH_TILE: ("it has no such tile", "render the image for this panel"),
    ReplyStatus.WRONG_VERSION: (
        f"it does not support version {' or '.join(map(str, sorted(VERSIONS, reverse=True)))} of the protocol",
        UPDATE,
    ),
    ReplyStatus.OPTICS_REFUSED: ("its optics block refuses the window", "write the raster's registers first"),
}
#: Status STALE_EPOCH of a request that is executed once: its number is older than that of the last one.
OLD_NUMBER = ("another program has used it since the connection", "connect again, and let one program at a time use it")
#: Requests that are executed once, in the order of their numbers.
ONCE = (Kind.WRITE, Kind.SIGN, Kind.ABORT, Kind.RESET)


@documented
class Hello(NamedTuple):
    """A board's reply to HELLO."""

    version: Annotated[int, key("version of the protocol")]
    identity: Annotated[int, key("identity of the board's display (`Display.identity` as a number)")]
    width: Annotated[int, key("columns of the panel, px")]
    height: Annotated[int, key("rows of the panel, px")]
    tile: Annotated[int, key("side of a tile, px")]
    max_packet: Annotated[int, key("longest packet that the board accepts, bytes before COBS")]
    clock_hz: Annotated[int, key("frequency of the board's clock")]
    epoch: Annotated[int, key("number of buffer swaps, modulo 2^16")]
    optics: Annotated[int, key("register `build` of the optics block")]

    @property
    def grid(self) -> TileGrid:
        """The panel's tiles."""
        return TileGrid(self.width, self.height)


class TileTable(NamedTuple):
    """CRC-32 of each tile in a buffer (count,), 0 for an empty tile, and the epoch of the reply."""

    epoch: int
    crcs: Crcs


class Board:
    """A board with a panel, real or virtual, and the open line to it; a `with` block closes the line.

    Each request raises `DeviceError` when the board refuses it, and `NoBoardError` when the board does not answer for
    `patience_s` seconds. `info` is its latest reply to HELLO.

    Examples
    --------
    >>> with Board.open("socket://127.0.0.1:4000") as board:  # doctest: +SKIP
    ...     board.show(image)
    """

    def __init__(self, line: Line, patience_s: float = PATIENCE_S) -> None:
        self.line = line
        self.patience_s = patience_s
        # Random, so that late replies to another program match no request of this one.
        self._seq = secrets.randbits(16)
        self._round_trip = RoundTrip()
        self.info = self.hello()

    @classmethod
    def open(cls, url: str, baud: int = DEFAULT_BAUD, patience_s: float = PATIENCE_S) -> Self:
        """Open a port, a serial device, a pty, or socket://HOST:PORT, and send HELLO to the board there.

        Raises
        ------
        InputError
            For an invalid URL or baud rate.
        DeviceError
            When the port does not open, or no board with this protocol answers.
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

    def hello(self) -> Hello:
        """Begin a session: send HELLO, check the reply, and keep it in `info`.

        Raises DeviceError when the board speaks no version of the protocol that this host knows, and for limits that
        this host does not support.
        """
        nonce = secrets.randbits(32)
        for asked in VERSIONS:
            status, body = self._request(Kind.HELLO, HELLO_REQUEST.pack(asked, nonce))
            if status != ReplyStatus.WRONG_VERSION:
                break
        version, echo, *rest = HELLO_REPLY.unpack(self._good(Kind.HELLO, status, body, HELLO_REPLY.size))
        hello = Hello(version, *rest)
        if version != asked:
            raise self._error(f"the board speaks version {version} of the protocol, this host {asked}", "update one")
        if echo != nonce:
            raise self._error("the reply answers another HELLO", "check that no other program uses this line")
        if hello.tile != TILE or hello.max_packet < MAX_PACKET or not 1 <= hello.grid.count <= 1 << 16:
            raise self._error(
                f"the board has limits that this host does not support (panel {hello.width} x {hello.height}, "
                f"tile {hello.tile}, packet {hello.max_packet})",
                "update one",
            )
        self.info = hello
        return hello

    def must_be(self, before: Hello) -> None:
        """Raise DeviceError when this board drives another display than the one that answered before."""
        if (self.info.identity, self.info.width, self.info.height) != (before.identity, before.width, before.height):
            raise self._error("another board answers than before", "stream an image that was rendered for its display")

    def read(self, address: int, count: int = 1) -> list[int]:
        """Return `count` words from a byte address, a multiple of 4; raise InputError where there is no register."""
        words: list[int] = []
        for first in range(0, count, MAX_WORDS):
            some = min(MAX_WORDS, count - first)
            body = self.ask(Kind.READ, READ_REQUEST.pack(_checked(address + 4 * first), some), 4 * some)
            words += struct.unpack(f"<{some}I", body)
        return words

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write 1 to 64 words from a byte address, exactly once: all of them or none.

        Raises InputError for an address without a register, and for words that do not fit.
        """
        if not 1 <= len(words) <= MAX_WORDS:
            raise InputError(f"{len(words)} words cannot be written at once; give 1 to {MAX_WORDS}")
        if not all(0 <= word < 1 << 32 for word in words):
            raise InputError("a word does not fit into 32 bits; give 0 to 0xFFFFFFFF")
        self.ask(Kind.WRITE, ADDRESS.pack(_checked(address)) + struct.pack(f"<{len(words)}I", *words), 0)

    def write_all(self, writes: Iterable[Write], base: int = OPTICS_BASE) -> None:
        """Write registers in order, neighbours in one request; addresses count from `base`."""
        run: list[Write] = []
        for one in writes:
            if run and (one.address != run[-1].address + 4 or len(run) == MAX_WORDS):
                self.write(base + run[0].address, [write.word for write in run])
                run = []
            run.append(one)
        if run:
            self.write(base + run[0].address, [write.word for write in run])

    def optics_build(self) -> Build:
        """Return the build of the board's optics block; raises InputError for unknown optics."""
        names = ("identity", "version", "build")
        return build_of({name: self.read(OPTICS_BASE + OPTICS_REGISTERS[name].address)[0] for name in names})

    def tiles(self, buffer: int) -> TileTable:
        """Return the CRCs of the tiles of a buffer, `BACK` or `FRONT`."""
        count = self.info.grid.count
        crcs = np.empty(count, np.uint32)
        epochs = set()
        for first in range(0, count, MAX_TILES):
            some = min(MAX_TILES, count - first)
            body = self.ask(Kind.TILES, TILES_REQUEST.pack(buffer, first, some), TILES_REPLY.size + 4 * some)
            epoch, echo = TILES_REPLY.unpack(body[: TILES_REPLY.size])
            if echo != first:
                raise self._error(f"the board replies for tile {echo}, not tile {first}", "update the board")
            epochs.add(epoch)
            crcs[first : first + some] = np.frombuffer(body[TILES_REPLY.size :], "<u4")
        if len(epochs) > 1:
            raise self._error("its buffers were swapped during the query", "let one program at a time use the board")
        return TileTable(epochs.pop(), crcs)

    def present(self, epoch: int, crc: int) -> tuple[ReplyStatus, int]:
        """Swap the buffers when the back buffer's CRC-32 is `crc`.

        Return OK and the board's new epoch, or STALE_EPOCH or FRAME_CRC_DIFFERS and the epoch of the request.
        """
        clocks = PRESENT_CLOCKS * self.info.width * self.info.height
        status, body = self._request(Kind.PRESENT, PRESENT_REQUEST.pack(epoch, crc), clocks / SLOWEST_HZ)
        if status in (ReplyStatus.STALE_EPOCH, ReplyStatus.FRAME_CRC_DIFFERS):
            return ReplyStatus(status), epoch
        return ReplyStatus.OK, EPOCH.unpack(self._good(Kind.PRESENT, status, body, EPOCH.size))[0]

    def trace(self, u: Ints, v: Ints, a: Ints, b: Ints) -> FixedRays:
        """Trace rays (N,) through the board's pipeline; words as in `lippmann.fixed.ray_pipeline`."""
        rays = np.stack([u, v, a, b], axis=1).astype("<i4")
        out = np.empty((len(rays), len(FixedRays._fields)), np.int64)
        for first in range(0, len(rays), MAX_RAYS):
            some = rays[first : first + MAX_RAYS]
            body = self.ask(Kind.TRACE, some.tobytes(), 4 * out.shape[1] * len(some))
            out[first : first + MAX_RAYS] = np.frombuffer(body, "<i4").reshape(len(some), -1)
        return FixedRays(*out.T)

    def sign(self, rays: int) -> tuple[int, int]:
        """Trace one frame of the raster, of about `rays` rays; return their number and the CRC-32 of their words.

        The frame is ended when it lasts too long for so many rays, or when Ctrl-C is pressed.
        """
        work_s = SIGN_CLOCKS * rays / SLOWEST_HZ
        seq, until = self.next_seq(), time.monotonic() + work_s + self.patience_s
        try:
            while True:
                status, body = self._request(Kind.SIGN, b"", work_s if self.info.version == 1 else 0.0, seq)
                runs = BUSY_REPLY.unpack(body) if status == ReplyStatus.BUSY else (0, 0)
                if runs[0] != THIS_RUNS:
                    return SIGNATURE.unpack(self._good(Kind.SIGN, status, body, SIGNATURE.size))
                if time.monotonic() > until:
                    break
                time.sleep(QUERY_S)
        except KeyboardInterrupt:
            with contextlib.suppress(LippmannError):
                self.abort()
            raise
        self.abort()
        what = f"its frame has not ended after {runs[1]} rays; {rays} were expected"
        raise self._error(what, "write the raster's registers first; the frame was ended")

    def frame_runs(self) -> bool:
        """Return whether the optics trace a frame, or a start waits (for the end of a frame, or for the raster)."""
        status = OPTICS_REGISTERS["status"]
        return bool(status.fields["running"].value(self.read(OPTICS_BASE + status.address)[0]))

    def abort(self) -> None:
        """End the frame that the board's optics trace, drop a start that waits, and wait for an empty pipeline."""
        self._needs_version_2(Kind.ABORT)
        self.ask(Kind.ABORT, b"", 0)

    def reset(self) -> None:
        """Reset the board to its state after power-up, the line excepted: it forgets frames, tiles and registers."""
        self._needs_version_2(Kind.RESET)
        self.ask(Kind.RESET, b"", 0, RESET_CLOCKS * self.info.grid.count / SLOWEST_HZ)
        self.hello()

    def _needs_version_2(self, kind: Kind) -> None:
        if self.info.version < RESET_VERSION:
            what = f"the board speaks version {self.info.version} of the protocol, which has no {kind.name}"
            raise self._error(what, "update the board, or press its reset button")

    def show(self, image: IntegralImage, progress: Progress | None = None, force: bool = False) -> Sent:
        """Show an image on the panel, encoded with the transfer curve and the bits of the image's display.

        The panel keeps its frame until the new one has arrived whole and its CRC-32 is right. Return the tiles, bytes
        and seconds that the transfer took.

        Parameters
        ----------
        image
            The image; its display must be the board's.
        progress
            Called with (tiles done, tiles of the frame).
        force
            Show an image for another display of the same size in pixels.

        Raises
        ------
        InputError
            For an image of another display, size, transfer curve or number of bits.
        DeviceError
            When the board does not answer, shows a test pattern, or refuses the frame.
        """
        self.check_no_pattern()
        return send_frame(self, image_frame(image, self.info, force), progress)

    def check_no_pattern(self) -> None:
        """Raise DeviceError while the panel shows a test pattern in place of the frame."""
        display = BOARD_REGISTERS["display"]
        pattern = display.fields["pattern"]
        number = pattern.value(self.read(display.address)[0])
        if number:
            what = (
                f"the panel shows test pattern {number} ({dict(pattern.names).get(number, 'unknown')}), not the frame"
            )
            raise self._error(what, "end it with lippmann board write display pattern=0")

    def panel_crc(self) -> int:
        """Return the CRC-32 of a frame that was scanned out, from first to last pixel, after this call.

        Raises DeviceError when the board scans out no frame.
        """
        frames = BOARD_REGISTERS["frames"].address
        first = self.read(frames)[0]
        until = time.monotonic() + FRAME_SECONDS
        while (self.read(frames)[0] - first) & 0xFFFFFFFF < FRAME_ENDS:
            if time.monotonic() > until:
                raise self._error("the board scans out no frame", "check its clock and its cable")
            time.sleep(QUERY_S)
        return self.read(BOARD_REGISTERS["shown_crc"].address)[0]

    def verify(self, crc: int) -> None:
        """Raise DeviceError when the scanned-out frame has another CRC-32 than the frame that was sent."""
        scanned = self.panel_crc()
        if scanned == crc:
            return
        display = BOARD_REGISTERS["display"]
        changed = self.read(display.address)[0] != display.fields["brightness"].reset
        remedy = "set brightness=255 pattern=0 to verify (lippmann board write display)"
        raise self._error(
            f"the panel shows a frame of CRC-32 {scanned:08x}, the frame sent has {crc:08x}",
            remedy
            if changed
            else "stream the frame again, or end the scene (scene.source) or the button's test pattern",
        )

    def next_seq(self) -> int:
        """Return the next sequence number."""
        self._seq = (self._seq + 1) & 0xFFFF
        return self._seq

    def silence(self) -> NoBoardError:
        """Return the error of a board that does not answer; the received bytes suggest the cause."""
        counts = self.line.reader.counts
        what, remedy = "nothing answers", "check the board's power, the cable, the port and the baud rate"
        if counts.accepted:
            what = f"the board has not answered for {self.patience_s:g} s"
            remedy = "check its power and the cable; of a virtual board, that its machine is not overloaded"
        elif counts.bytes:
            what = (
                f"{counts.bytes} bytes came, but no packet: no board, or one at another baud rate than {self.line.baud}"
            )
            remedy = "give the board's rate"
        return NoBoardError.at(self.line.url, what, remedy)

    def refusal(self, kind: int, status: int, body: bytes = b"") -> LippmannError:
        """Return the error of a reply whose status is not OK; `body` follows the status."""
        name = Kind(kind).name
        if status == ReplyStatus.BUSY and len(body) == BUSY_REPLY.size:
            runs, rays = BUSY_REPLY.unpack(body)
            if runs == SCENE_RUNS:
                return self._error(f"the board refuses {name} while its optics draw a scene", END_SCENE)
            if runs == SLOT_SHOWN:
                what = f"the board refuses {name}: the slot is shown, or a written layer is about to show it"
                return self._error(what, "load another slot, or hide the layer first")
            by = "a frame that a register write started" if runs == FRAME_RUNS else f"a signature ({rays} rays so far)"
            remedy = "wait, or end it with lippmann board abort"
            if runs == FRAME_RUNS:
                # No stream enters over the line, so such a frame waits for ever.
                remedy += ", the only way if its source is the stream"
            return self._error(f"the board refuses {name} while {by} runs", remedy)
        if status not in REFUSALS:
            return self._error(f"the board answers {name} with status {status}", UPDATE)
        is_old = status == ReplyStatus.STALE_EPOCH and kind in ONCE
        what, remedy = OLD_NUMBER if is_old else REFUSALS[ReplyStatus(status)]
        kind_of_error = InputError if status == ReplyStatus.NO_SUCH_ADDRESS else DeviceError
        return kind_of_error.at(self.line.url, f"the board refuses {name}: {what}", remedy)

    def _error(self, what: str, remedy: str) -> DeviceError:
        return DeviceError.at(self.line.url, what, remedy)

    def ask(self, kind: Kind, body: bytes, size: int, work_s: float = 0.0) -> bytes:
        """Send a request; return the `size` bytes behind the reply's status. Raises for a status other than OK."""
        status, answer = self._request(kind, body, work_s)
        return self._good(kind, status, answer, size)

    def _good(self, kind: Kind, status: int, body: bytes, size: int) -> bytes:
        if status != ReplyStatus.OK:
            raise self.refusal(kind, status, body)
        if len(body) != size:
            raise self._error(f"the board's reply to {kind.name} has {len(body)} bytes, not {size}", UPDATE)
        return body

    def _request(self, kind: Kind, body: bytes, work_s: float = 0.0, seq: int | None = None) -> tuple[int, bytes]:
        """Send a request until its reply arrives; return the status and the rest of the reply's body.

        The sequence number, a new one unless it is given, stays the same, so the board executes a repeated request
        once. Fails `patience_s` after the time of the board's work, or later by one send that the line does not accept.
        """
        seq = self.next_seq() if seq is None else seq
        packet = packed(kind, seq, body)
        end = time.monotonic() + work_s + self.patience_s
        again = False
        while True:
            self.line.send(packet, min(SEND_S, self.patience_s))
            sent = time.monotonic()
            until = min(end, sent + self._round_trip.time_out_s + self.line.seconds(len(packet) + MAX_PACKET))
            # Bounded by time: a line may deliver other packets without end.
            while time.monotonic() < until:
                reply = self.line.receive(until - time.monotonic())
                if reply and reply.kind == kind | REPLY and reply.seq == seq and reply.body:
                    if again:
                        self._round_trip.ease()
                    elif not work_s:
                        self._round_trip.sample(time.monotonic() - sent)
                    return reply.body[0], reply.body[1:]
            if time.monotonic() >= end:
                self._round_trip.give_up()
                raise self.silence()
            self._round_trip.back_off()
            again = True


def _checked(address: int) -> int:
    """Return the address; refuse one that no request can hold."""
    if address % 4 or not 0 <= address < 1 << 16:
        raise InputError(f"0x{address:X} is not a register address; give a multiple of 4 up to 0xFFFC")
    return address

"""Streaming of frames: tiles are sent in a window, lost ones again; the panel shows the frame when it is whole."""

from __future__ import annotations

import struct
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import takewhile
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from lippmann.board.tiles import Coded, Coding, Crcs, Pixels, code_tile, frame_crc, raw_tile
from lippmann.errors import InputError, device_error
from lippmann.link.packets import BACK, FRONT, REPLY, Kind, Packet, ReplyStatus, packed
from lippmann.link.port import SEND_S
from lippmann.link.round_trip import RoundTrip
from lippmann.toml import documented, key

if TYPE_CHECKING:
    from lippmann.board.board import Board

#: Most bytes that are sent and not yet acknowledged: about 16 raw tiles.
WINDOW_BYTES = 50_000
#: Most rounds of a frame, before it fails (see `Sent.rounds`).
MAX_ROUNDS = 8

TILE_REQUEST = struct.Struct("<HHB")
TILE_REPLY = struct.Struct("<H")

#: Called with (tiles done, tiles of the frame).
Progress = Callable[[int, int], None]


@documented
@dataclass
class Sent:
    """Tiles, bytes and seconds of a frame's transfer.

    `known` and `arrived` are the numbers of the tiles that were sent, and of those that arrived; not dataclass fields.
    """

    crc: Annotated[int, key("CRC-32 of the frame, as the board confirmed it")] = 0
    epoch: Annotated[int, key("the board's epoch that shows this frame")] = 0
    tiles: Annotated[int, key("tiles of the frame")] = 0
    skipped: Annotated[int, key("tiles that the board held already")] = 0
    raw: Annotated[int, key("tiles that arrived raw")] = 0
    solid: Annotated[int, key("tiles that arrived as one colour")] = 0
    qoi: Annotated[int, key("tiles that arrived as QOI")] = 0
    copied: Annotated[int, key("tiles that the board copied from its front buffer")] = 0
    sends: Annotated[int, key("TILE packets sent")] = 0
    resends: Annotated[int, key("TILE packets that repeat a tile")] = 0
    rounds: Annotated[int, key("1, and 1 more for each time that the frame was completed or started again")] = 0
    unchanged: Annotated[bool, key("whether the board showed this frame already")] = False
    payload_bytes: Annotated[int, key("bytes of the coded tiles that arrived")] = 0
    wire_bytes: Annotated[int, key("bytes written to the line")] = 0
    image_bytes: Annotated[int, key("bytes of the frame's pixels")] = 0
    seconds: Annotated[float, key("from the first request until the frame was shown, without lost connections")] = 0.0

    def __post_init__(self) -> None:
        self.known: set[int] = set()
        self.arrived: set[int] = set()

    @property
    def rate(self) -> float:
        """Bytes of the frame a second."""
        return self.image_bytes / self.seconds if self.seconds else 0.0

    @property
    def overhead(self) -> float:
        """Bytes on the line beyond those of the coded tiles, as a share of these."""
        return self.wire_bytes / self.payload_bytes - 1.0 if self.payload_bytes else 0.0


def send_frame(
    board: Board,
    frame: Pixels,
    progress: Progress | None = None,
    window_bytes: int = WINDOW_BYTES,
    sent: Sent | None = None,
) -> Sent:
    """Send a frame to the board and show it on the panel.

    The frame is (height, width, 3) uint8, of the panel's size. Tiles that the board holds are not sent: after a lost
    connection, call again with the same frame. The call fails when no reply comes, or no tile arrives, for
    `board.patience_s`. At most `window_bytes` are sent and not yet acknowledged. `sent` holds the counts of the same
    frame before a lost connection; this call adds to them, also when it fails.

    Raises InputError when the frame does not have the panel's size; NoBoardError when the connection is lost, or the
    board does not answer; DeviceError when the board refuses tiles, or another board took its place.
    """
    grid = board.info.grid
    if frame.shape != (grid.height, grid.width, 3) or frame.dtype != np.uint8:
        raise InputError(
            f"a frame of {frame.shape} {frame.dtype} does not fit a panel of {grid.width} x {grid.height} pixels; "
            f"give ({grid.height}, {grid.width}, 3) uint8"
        )
    begun = time.monotonic()
    written = board.line.written
    crcs = grid.crcs(frame)
    sent = sent or Sent()
    sent.crc, sent.tiles, sent.image_bytes = frame_crc(frame), grid.count, frame.size
    try:
        _show(board, frame, crcs, sent, progress, window_bytes)
    finally:
        sent.wire_bytes += board.line.written - written
        sent.seconds += time.monotonic() - begun
    sent.skipped = sent.tiles - len(sent.known)
    return sent


def _show(board: Board, frame: Pixels, crcs: Crcs, sent: Sent, progress: Progress | None, window_bytes: int) -> None:
    """Send the missing tiles and present the frame, until the board shows it."""
    status = ReplyStatus.OK
    for _ in range(MAX_ROUNDS):
        if status == ReplyStatus.STALE_EPOCH:
            # The board was reset, or is another one.
            before = board.info
            board.hello()
            board.must_be(before)
        back = board.tiles(BACK)
        front = board.tiles(FRONT)
        sent.rounds += 1
        if back.epoch != front.epoch:
            status = ReplyStatus.STALE_EPOCH
            continue
        # 0 marks an empty tile, also where the CRC of the tile is 0.
        in_front = (front.crcs == crcs) & (crcs != 0)
        if in_front.all():
            sent.epoch = front.epoch
            sent.unchanged = sent.unchanged or sent.rounds == 1
            if progress:
                progress(sent.tiles, sent.tiles)
            return
        missing = np.flatnonzero((back.crcs != crcs) | (crcs == 0))
        if status == ReplyStatus.FRAME_CRC_DIFFERS and not len(missing):
            # Every tile has the right CRC but not the frame: two contents of a tile share a CRC.
            missing = np.arange(sent.tiles)
            in_front[:] = False
        sender = _Sender(board, frame, front.epoch, in_front, sent, window_bytes)
        status = sender.run(missing.tolist(), progress)
        if status == ReplyStatus.OK:
            status, sent.epoch = board.present(front.epoch, sent.crc)
        if status == ReplyStatus.OK:
            return
    raise device_error(
        board.line.url,
        f"the frame was sent {MAX_ROUNDS} times and is still not whole on the board",
        "check its power, and that no other program uses it",
    )


class _Flight(NamedTuple):
    """A TILE packet without a reply yet: its tile, data, length on the line, and time of sending."""

    tile: int
    coded: Coded
    length: int
    time: float


@dataclass
class _Sender:
    """Sends tiles of one frame in one epoch.

    Each TILE packet has its own sequence number, a repeated tile too, so a reply identifies its packet. The line keeps
    the order: earlier packets that are still unanswered are lost, or their replies are.
    """

    board: Board
    frame: Pixels
    epoch: int
    in_front: np.ndarray[tuple[int], np.dtype[np.bool_]]
    sent: Sent
    window_bytes: int

    def __post_init__(self) -> None:
        self._queue: deque[int] = deque()
        self._arrived: set[int] = set()
        self._refused: set[int] = set()
        # By sequence number, in the order of sending: unanswered, and given up (a late reply may come).
        self._flights: dict[int, _Flight] = {}
        self._lost: dict[int, _Flight] = {}
        self._bytes = 0
        self._round_trip = RoundTrip()

    def run(self, tiles: Iterable[int], progress: Progress | None) -> ReplyStatus:
        """Send tiles until the board has them; return OK, or STALE_EPOCH when the board is in another epoch."""
        self._queue.extend(tiles)
        held = self.sent.tiles - len(self._queue)
        line = self.board.line
        last_gain = last_reply = time.monotonic()
        while self._queue or self._flights:
            # Read replies before more is sent: they decide what to send.
            while self._queue and (not self._flights or (not line.waiting and self._bytes < self.window_bytes)):
                if not self._send(self._queue.popleft()):
                    break
            if not self._flights:
                # The queue held only tiles that had arrived meanwhile.
                continue
            oldest = next(iter(self._flights.values()))
            due = max(oldest.time, last_reply) + self._round_trip.time_out_s + line.seconds(oldest.length)
            end = last_gain + self.board.patience_s
            reply = line.receive(min(due, end) - time.monotonic())
            gains = len(self._arrived)
            status = self._take(reply) if reply else None
            if status == ReplyStatus.STALE_EPOCH:
                return status
            now = time.monotonic()
            if status is not None:
                last_reply = now
            if len(self._arrived) > gains:
                last_gain = now
                if progress:
                    progress(held + len(self._arrived), self.sent.tiles)
            elif now >= end:
                raise self.board.silence()
            elif status is None and now >= due:
                # Send one packet again; its reply shows which of the others are lost.
                self._round_trip.back_off()
                self._give_up([next(iter(self._flights))])
        return ReplyStatus.OK

    def _send(self, tile: int) -> bool:
        """Send a tile in its shortest coding, unless it has arrived; return False when the line accepts no more."""
        if tile in self._arrived:
            return True
        pixels = self.board.info.grid.cut(self.frame, tile)
        if self.in_front[tile] and tile not in self._refused:
            coded = Coded(Coding.COPY, b"")
        else:
            coded = raw_tile(pixels) if tile in self._refused else code_tile(pixels)
        seq = self.board.next_seq()
        packet = packed(Kind.TILE, seq, TILE_REQUEST.pack(self.epoch, tile, coded.coding) + coded.data)
        # A sequence number that is used again belongs to the new packet.
        self._lost.pop(seq, None)
        self.sent.sends += 1
        self.sent.resends += tile in self.sent.known
        self.sent.known.add(tile)
        taken = self.board.line.send(packet, min(SEND_S, self.board.patience_s))
        self._flights[seq] = _Flight(tile, coded, len(packet), time.monotonic())
        self._bytes += len(packet)
        return taken

    def _take(self, reply: Packet) -> ReplyStatus | None:
        """Process a reply; return OK, STALE_EPOCH or BAD_TILE_DATA, or None for a reply to another request."""
        if reply.kind != Kind.TILE | REPLY or not reply.body:
            return None
        if reply.seq in self._flights:
            self._give_up(list(takewhile(lambda seq: seq != reply.seq, self._flights)))
            flight = self._flights.pop(reply.seq)
            self._bytes -= flight.length
        elif reply.seq in self._lost:
            flight = self._lost.pop(reply.seq)
        else:
            return None
        # Late replies are timed too: the first one shows that the line is slower than expected.
        self._round_trip.sample(time.monotonic() - flight.time)
        status = reply.body[0]
        if status == ReplyStatus.OK and reply.body[1:] == TILE_REPLY.pack(flight.tile):
            if flight.tile not in self._arrived:
                self._arrived.add(flight.tile)
                self.sent.arrived.add(flight.tile)
                self.sent.payload_bytes += len(flight.coded.data)
                count = "copied" if flight.coded.coding == Coding.COPY else flight.coded.coding.name.lower()
                setattr(self.sent, count, getattr(self.sent, count) + 1)
        elif status == ReplyStatus.BAD_TILE_DATA and flight.coded.coding != Coding.RAW:
            # Sent raw next: raw pixels need no decoder.
            self._refused.add(flight.tile)
            self._queue.appendleft(flight.tile)
        elif status != ReplyStatus.STALE_EPOCH:
            raise self.board.refusal(Kind.TILE, status)
        return ReplyStatus(status)

    def _give_up(self, numbers: list[int]) -> None:
        """Treat packets as lost: their tiles are sent next."""
        for seq in reversed(numbers):
            flight = self._flights.pop(seq)
            self._bytes -= flight.length
            self._lost[seq] = flight
            self._queue.appendleft(flight.tile)

"""Streams frames: a window of tiles on their way, only the lost ones sent again, shown when the frame is whole."""

from __future__ import annotations

import struct
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from lippmann.board.board import BACK, FRONT, SEND_S, Board
from lippmann.board.tiles import Coded, Coding, Crcs, Pixels, code_tile, frame_crc, raw_tile
from lippmann.errors import InputError, device_error
from lippmann.link.packets import REPLY, Kind, Packet, Status, packed
from lippmann.link.round_trip import RoundTrip

#: Bytes on their way at most: about 16 raw tiles.
WINDOW_BYTES = 50_000
#: Times that a frame is begun, mended or begun anew before it counts as failed.
MAX_ROUNDS = 8

TILE_REQUEST = struct.Struct("<HHB")
TILE_REPLY = struct.Struct("<H")

#: Takes (tiles done, tiles of the frame).
Progress = Callable[[int, int], None]


@dataclass
class Sent:
    """What a frame took.

    Attributes
    ----------
    crc
        The frame's CRC-32, as the board confirmed it.
    epoch
        The board's, with this frame shown.
    tiles
        Tiles of the frame.
    skipped
        Those that it held before.
    raw, solid, qoi, copied
        Those that arrived, by coding.
    sends
        TILE packets written, and of them
    resends
        those for a tile that had been sent before.
    rounds
        1, and one more each time that the frame was mended or begun anew.
    unchanged
        The board showed this frame already.
    payload_bytes
        Coded pixels of the tiles that arrived.
    wire_bytes
        All bytes written to the line.
    image_bytes
        Bytes of the image's pixels.
    seconds
        From the first request to the frame's display; when the line was lost, without the time that it was away.
    known, arrived
        Numbers of the tiles that were sent, and that arrived; no fields.
    """

    crc: int = 0
    epoch: int = 0
    tiles: int = 0
    skipped: int = 0
    raw: int = 0
    solid: int = 0
    qoi: int = 0
    copied: int = 0
    sends: int = 0
    resends: int = 0
    rounds: int = 0
    unchanged: bool = False
    payload_bytes: int = 0
    wire_bytes: int = 0
    image_bytes: int = 0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        self.known: set[int] = set()
        self.arrived: set[int] = set()

    @property
    def rate(self) -> float:
        """Bytes of the image a second."""
        return self.image_bytes / self.seconds if self.seconds else 0.0

    @property
    def overhead(self) -> float:
        """Bytes on the line beyond the coded pixels, as a share of these."""
        return self.wire_bytes / self.payload_bytes - 1.0 if self.payload_bytes else 0.0


def send_frame(
    board: Board,
    image: Pixels,
    progress: Progress | None = None,
    window_bytes: int = WINDOW_BYTES,
    sent: Sent | None = None,
) -> Sent:
    """Bring an image to the panel.

    The board is asked what it holds, so nothing is sent that it has: after a loss of the line, call again with the same
    image. Each wait is bounded: `board.patience_s` without a tile that arrives, or without a reply, ends it.

    Parameters
    ----------
    image
        (height, width, 3) uint8, as large as the panel.
    progress
        Called as tiles arrive.
    window_bytes
        Bytes on their way at most.
    sent
        What the same image took until the line was lost; this call adds to it, when it fails too.

    Raises
    ------
    InputError
        When the image is not as large as the panel.
    NoBoardError
        When the line is lost, or the board falls silent.
    DeviceError
        When the board refuses tiles, or another took its place.
    """
    grid = board.info.grid
    if image.shape != (grid.height, grid.width, 3) or image.dtype != np.uint8:
        raise InputError(
            f"an image of {image.shape} {image.dtype} does not fit a panel of {grid.width} x {grid.height} pixels; "
            f"give ({grid.height}, {grid.width}, 3) uint8"
        )
    begun = time.monotonic()
    written = board.line.written
    crcs = grid.crcs(image)
    sent = sent or Sent()
    sent.crc, sent.tiles, sent.image_bytes = frame_crc(image), grid.count, image.size
    try:
        _show(board, image, crcs, sent, progress, window_bytes)
    finally:
        sent.wire_bytes += board.line.written - written
        sent.seconds += time.monotonic() - begun
    sent.skipped = sent.tiles - len(sent.known)
    return sent


def _show(board: Board, image: Pixels, crcs: Crcs, sent: Sent, progress: Progress | None, window_bytes: int) -> None:
    """Send what the board lacks and present it, until it shows the frame."""
    status = Status.OK
    for _ in range(MAX_ROUNDS):
        if status == Status.STALE_EPOCH:
            # It was reset, and may be another one.
            before = board.info
            board.hello()
            board.must_be(before)
        back = board.tiles(BACK)
        front = board.tiles(FRONT)
        sent.rounds += 1
        if back.epoch != front.epoch:
            status = Status.STALE_EPOCH
            continue
        # 0 says that nothing is held, whatever the tile's own CRC is.
        in_front = (front.crcs == crcs) & (crcs != 0)
        if in_front.all():
            sent.epoch = front.epoch
            sent.unchanged = sent.unchanged or sent.rounds == 1
            if progress:
                progress(sent.tiles, sent.tiles)
            return
        missing = np.flatnonzero((back.crcs != crcs) | (crcs == 0))
        if status == Status.FRAME_CRC_DIFFERS and not len(missing):
            # All tiles seem right, yet one is not: two contents of a tile share a CRC.
            missing = np.arange(sent.tiles)
            in_front[:] = False
        sender = _Sender(board, image, front.epoch, in_front, sent, window_bytes)
        status = sender.run(missing.tolist(), progress)
        if status == Status.OK:
            status, sent.epoch = board.present(front.epoch, sent.crc)
        if status == Status.OK:
            return
    raise device_error(
        board.line.url,
        f"the board took the frame {MAX_ROUNDS} times and never held it whole",
        "check its power, and that no other program uses it",
    )


@dataclass
class _Flight:
    """A TILE packet on its way: its tile, data, length on the line, and when it was sent."""

    tile: int
    coded: Coded
    length: int
    time: float = field(default_factory=time.monotonic)


class _Sender:
    """Sends tiles of one frame in one epoch.

    Each TILE packet, a repeated one too, has a sequence number of its own. So a reply tells which packet it answers; as
    the line keeps the order, all packets before it that are still unanswered are lost, or their replies are.
    """

    def __init__(
        self,
        board: Board,
        image: Pixels,
        epoch: int,
        in_front: np.ndarray[tuple[int], np.dtype[np.bool_]],
        sent: Sent,
        window_bytes: int,
    ) -> None:
        self._board = board
        self._image = image
        self._epoch = epoch
        self._in_front = in_front
        self._sent = sent
        self._window_bytes = window_bytes
        self._queue: deque[int] = deque()
        self._arrived: set[int] = set()
        self._refused: set[int] = set()
        # By sequence number, in the order of sending: on their way, and given up but perhaps answered yet.
        self._flights: dict[int, _Flight] = {}
        self._lost: dict[int, _Flight] = {}
        self._bytes = 0
        self._round_trip = RoundTrip()

    def run(self, tiles: Iterable[int], progress: Progress | None) -> Status:
        """Send tiles until the board has them: OK, or STALE_EPOCH when it is in another epoch."""
        self._queue.extend(tiles)
        held = self._sent.tiles - len(self._queue)
        line = self._board.line
        last_gain = last_reply = time.monotonic()
        while self._queue or self._flights:
            # What has come says first what is to be sent.
            while self._queue and (not self._flights or (not line.waiting and self._bytes < self._window_bytes)):
                if not self._send(self._queue.popleft()):
                    break
            if not self._flights:
                # Only tiles that arrived meanwhile were left.
                continue
            oldest = next(iter(self._flights.values()))
            due = max(oldest.time, last_reply) + self._round_trip.time_out_s + line.seconds(oldest.length)
            end = last_gain + self._board.patience_s
            reply = line.receive(min(due, end) - time.monotonic())
            gains = len(self._arrived)
            status = self._take(reply) if reply else None
            if status == Status.STALE_EPOCH:
                return status
            now = time.monotonic()
            if status is not None:
                last_reply = now
            if len(self._arrived) > gains:
                last_gain = now
                if progress:
                    progress(held + len(self._arrived), self._sent.tiles)
            elif now >= end:
                raise self._board.silence()
            elif status is None and now >= due:
                # One packet asks whether the line lives; its reply tells what of the others is lost.
                self._round_trip.back_off()
                self._give_up([next(iter(self._flights))])
        return Status.OK

    def _send(self, tile: int) -> bool:
        """Send a tile in its cheapest coding, unless it arrived; return False when the line takes no more."""
        if tile in self._arrived:
            return True
        pixels = self._board.info.grid.cut(self._image, tile)
        if self._in_front[tile] and tile not in self._refused:
            coded = Coded(Coding.COPY, b"")
        else:
            coded = raw_tile(pixels) if tile in self._refused else code_tile(pixels)
        seq = self._board.next_seq()
        packet = packed(Kind.TILE, seq, TILE_REQUEST.pack(self._epoch, tile, coded.coding) + coded.data)
        # A number that comes round again belongs to the new packet.
        self._lost.pop(seq, None)
        self._sent.sends += 1
        self._sent.resends += tile in self._sent.known
        self._sent.known.add(tile)
        taken = self._board.line.send(packet, min(SEND_S, self._board.patience_s))
        self._flights[seq] = _Flight(tile, coded, len(packet))
        self._bytes += len(packet)
        return taken

    def _take(self, reply: Packet) -> Status | None:
        """Take a reply: OK, STALE_EPOCH, BAD_TILE_DATA, or None when it answers nothing that was sent here."""
        if reply.kind != Kind.TILE | REPLY or not reply.body:
            return None
        if reply.seq in self._flights:
            earlier = []
            for seq in self._flights:
                if seq == reply.seq:
                    break
                earlier.append(seq)
            self._give_up(earlier)
            flight = self._flights.pop(reply.seq)
            self._bytes -= flight.length
        elif reply.seq in self._lost:
            flight = self._lost.pop(reply.seq)
        else:
            return None
        # Late or not, it answers one send: a line that is slower than thought is known by the first late reply.
        self._round_trip.sample(time.monotonic() - flight.time)
        status = reply.body[0]
        if status == Status.OK and reply.body[1:] == TILE_REPLY.pack(flight.tile):
            self._arrive(flight)
        elif status == Status.BAD_TILE_DATA and flight.coded.coding != Coding.RAW:
            # Raw pixels cannot be misread.
            self._refused.add(flight.tile)
            self._queue.appendleft(flight.tile)
        elif status != Status.STALE_EPOCH:
            raise self._board.refusal(Kind.TILE, status)
        return Status(status)

    def _arrive(self, flight: _Flight) -> None:
        """Count a tile that the board has."""
        if flight.tile in self._arrived:
            return
        self._arrived.add(flight.tile)
        sent = self._sent
        sent.arrived.add(flight.tile)
        sent.payload_bytes += len(flight.coded.data)
        match flight.coded.coding:
            case Coding.RAW:
                sent.raw += 1
            case Coding.SOLID:
                sent.solid += 1
            case Coding.QOI:
                sent.qoi += 1
            case Coding.COPY:
                sent.copied += 1

    def _give_up(self, numbers: list[int]) -> None:
        """Take packets for lost: their tiles are the next to be sent."""
        for seq in reversed(numbers):
            flight = self._flights.pop(seq)
            self._bytes -= flight.length
            self._lost[seq] = flight
            self._queue.appendleft(flight.tile)

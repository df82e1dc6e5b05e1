"""Streaming of frames: tiles are sent in a window, lost ones again; the panel shows the frame when it is whole."""

from __future__ import annotations

import struct
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from lippmann.base.progress import Progress
from lippmann.base.toml import documented, key
from lippmann.board.packets import BACK, FRONT, Kind, ReplyStatus
from lippmann.board.request_window import Flight, Window
from lippmann.board.tiles import Coded, Coding, Crcs, Pixels, code_tile, frame_crc, raw_tile
from lippmann.errors import InputError, device_error

if TYPE_CHECKING:
    from lippmann.board.board import Board

#: Most bytes that are sent and not yet acknowledged: about 16 raw tiles.
WINDOW_BYTES = 50_000
#: Most rounds of a frame, before it fails (see `Sent.rounds`).
MAX_ROUNDS = 8

TILE_REQUEST = struct.Struct("<HHB")
TILE_REPLY = struct.Struct("<H")


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
        held = sent.tiles - len(missing)

        def arrived(count: int, held: int = held) -> None:
            if progress:
                progress(held + count, sent.tiles)

        status = sender.run(missing.tolist(), arrived, ends=ReplyStatus.STALE_EPOCH)
        if status == ReplyStatus.OK:
            status, sent.epoch = board.present(front.epoch, sent.crc)
        if status == ReplyStatus.OK:
            return
    raise device_error(
        board.line.url,
        f"the frame was sent {MAX_ROUNDS} times and is still not whole on the board",
        "check its power, and that no other program uses it",
    )


class _Sender(Window[Coded]):
    """Sends tiles of one frame in one epoch."""

    def __init__(
        self,
        board: Board,
        frame: Pixels,
        epoch: int,
        in_front: np.ndarray[tuple[int], np.dtype[np.bool_]],
        sent: Sent,
        window_bytes: int,
    ) -> None:
        super().__init__(board, Kind.TILE, window_bytes)
        self.frame, self.epoch, self.in_front, self.sent = frame, epoch, in_front, sent
        self._refused: set[int] = set()

    def request(self, item: int) -> tuple[bytes, Coded]:
        """Return the request of a tile in its shortest coding."""
        pixels = self.board.info.grid.cut(self.frame, item)
        if self.in_front[item] and item not in self._refused:
            coded = Coded(Coding.COPY, b"")
        else:
            coded = raw_tile(pixels) if item in self._refused else code_tile(pixels)
        self.sent.sends += 1
        self.sent.resends += item in self.sent.known
        self.sent.known.add(item)
        return TILE_REQUEST.pack(self.epoch, item, coded.coding) + coded.data, coded

    def answered(self, flight: Flight[Coded], status: ReplyStatus, body: bytes) -> bool:
        """Count a tile that has arrived; send one raw whose data the board refuses."""
        tile, coded = flight.item, flight.note
        if status == ReplyStatus.OK and body == TILE_REPLY.pack(tile):
            if tile not in self.arrived:
                self.sent.arrived.add(tile)
                self.sent.payload_bytes += len(coded.data)
                count = "copied" if coded.coding == Coding.COPY else coded.coding.name.lower()
                setattr(self.sent, count, getattr(self.sent, count) + 1)
            return True
        if status == ReplyStatus.BAD_TILE_DATA and coded.coding != Coding.RAW:
            # Sent raw next: raw pixels need no decoder.
            self._refused.add(tile)
            self.again(tile)
        elif status != ReplyStatus.STALE_EPOCH:
            raise self.board.refusal(Kind.TILE, status)
        return False

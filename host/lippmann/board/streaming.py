"""Stream frames to a board: send tiles, repeat lost tiles, and show only complete frames."""

from __future__ import annotations

import struct
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt

from lippmann.base.progress_protocol import Progress, check_progress
from lippmann.base.toml import documented, key
from lippmann.board.packets import BACK, FRONT, Kind, ReplyStatus
from lippmann.board.panel_frames import check_shape, panel_values
from lippmann.board.retries import MAX_ROUNDS, Window, refusal
from lippmann.board.session import Session
from lippmann.board.tiles import TILE, Coded, Coding, Pixels, code_tile, frame_crc, raw_tile
from lippmann.errors import InputError
from lippmann.rendering.executors import Band, RenderedBand
from lippmann.rendering.plan import Plan
from lippmann.rendering.sinks import bands_of_plan

#: Maximum unacknowledged bytes, about 16 raw tiles.
WINDOW_BYTES = 50_000

TILE_REQUEST = struct.Struct("<HHB")
TILE_REPLY = struct.Struct("<H")


@documented
@dataclass
class Sent:
    """Counts of a frame's transfer, and indices of sent tiles (`known`) and of arrived tiles."""

    crc: Annotated[int, key("CRC-32 of the frame, confirmed by the board")] = 0
    epoch: Annotated[int, key("epoch of the board in which it shows this frame")] = 0
    tiles: Annotated[int, key("tiles of the frame")] = 0
    skipped: Annotated[int, key("tiles that the board already had")] = 0
    raw: Annotated[int, key("tiles that arrived uncoded")] = 0
    solid: Annotated[int, key("tiles that arrived coded as a single colour")] = 0
    qoi: Annotated[int, key("tiles that arrived coded as QOI")] = 0
    copied: Annotated[int, key("tiles that the board copied from its front buffer")] = 0
    sends: Annotated[int, key("TILE packets sent")] = 0
    resends: Annotated[int, key("TILE packets that repeat a tile")] = 0
    rounds: Annotated[int, key("attempts to send the frame")] = 0
    unchanged: Annotated[bool, key("whether the board already showed this frame")] = False
    payload_bytes: Annotated[int, key("bytes of the arrived coded tiles")] = 0
    wire_bytes: Annotated[int, key("bytes written to the line")] = 0
    image_bytes: Annotated[int, key("bytes of the frame's pixels")] = 0
    seconds: Annotated[float, key("time until the frame was shown, without lost connections, s")] = 0.0

    def __post_init__(self) -> None:
        self.known: set[int] = set()
        self.arrived: set[int] = set()

    @property
    def rate(self) -> float:
        """Transfer rate: bytes of the frame per second."""
        return self.image_bytes / self.seconds if self.seconds else 0.0

    @property
    def overhead(self) -> float:
        """Bytes on the line besides coded tiles, per byte of coded tiles."""
        return self.wire_bytes / self.payload_bytes - 1.0 if self.payload_bytes else 0.0


def send_frame(
    session: Session,
    frame: Pixels,
    progress: Progress | None = None,
    window_bytes: int = WINDOW_BYTES,
    counts: Sent | None = None,
) -> Sent:
    """Send a frame (height, width, 3) uint8 and show it on the panel; `progress` counts tiles.

    Tiles that the board already has are not sent. After a lost connection, repeat the
    call with the same frame. Each call adds to `counts`, even if the call fails.

    Raises InputError for a frame of a wrong size, NoBoardError if the connection is
    lost or no reply arrives, and DeviceError if the board refuses tiles or another
    board answers.
    """
    check_progress(progress)
    grid = session.info.grid
    if frame.shape != (grid.height, grid.width, 3) or frame.dtype != np.uint8:
        raise InputError(
            f"a frame of {frame.shape} {frame.dtype} does not fit a panel of {grid.width} x {grid.height} pixels; "
            f"give ({grid.height}, {grid.width}, 3) uint8"
        )
    begun = time.monotonic()
    written = session.line.written
    counts = counts or Sent()
    counts.crc, counts.tiles, counts.image_bytes = frame_crc(frame), grid.count, frame.size
    try:
        _show(session, frame, counts, progress, window_bytes)
    finally:
        counts.wire_bytes += session.line.written - written
        counts.seconds += time.monotonic() - begun
    counts.skipped = counts.tiles - len(counts.known)
    return counts


def _show(session: Session, frame: Pixels, counts: Sent, progress: Progress | None, window_bytes: int) -> None:
    crcs = session.info.grid.crcs(frame)
    status = ReplyStatus.OK
    for _ in range(MAX_ROUNDS):
        if status == ReplyStatus.STALE_EPOCH:
            # The board was reset or exchanged.
            before = session.info
            session.hello()
            session.must_be(before)
        back = session.tiles(BACK)
        front = session.tiles(FRONT)
        counts.rounds += 1
        if back.epoch != front.epoch:
            status = ReplyStatus.STALE_EPOCH
            continue
        # A CRC of 0 marks an empty tile, so a tile whose CRC is 0 is always sent.
        in_front = (front.crcs == crcs) & (crcs != 0)
        if in_front.all():
            counts.epoch = front.epoch
            counts.unchanged = counts.unchanged or counts.rounds == 1
            if progress:
                progress(counts.tiles, counts.tiles)
            return
        missing = np.flatnonzero((back.crcs != crcs) | (crcs == 0))
        if status == ReplyStatus.FRAME_CRC_DIFFERS and not len(missing):
            # All tile CRCs match but not the frame's CRC, so a tile's content is wrong.
            missing = np.arange(counts.tiles)
            in_front[:] = False
        status = _send_tiles(session, frame, front.epoch, missing.tolist(), in_front, counts, progress, window_bytes)
        if status == ReplyStatus.OK:
            status, counts.epoch = session.present(front.epoch, counts.crc)
        if status == ReplyStatus.OK:
            return
    what = f"the board's frame is still incomplete after {MAX_ROUNDS} attempts"
    raise session.error(what, "check the board's power; close other programs that use it")


def _send_tiles(
    session: Session,
    frame: Pixels,
    epoch: int,
    tiles: Sequence[int],
    in_front: npt.NDArray[np.bool_],
    counts: Sent,
    progress: Progress | None = None,
    window_bytes: int = WINDOW_BYTES,
) -> ReplyStatus:
    """Send tiles; the board copies tiles `in_front` from its front buffer. Return OK, or STALE_EPOCH after a swap."""
    grid = session.info.grid
    refused: set[int] = set()

    def request(tile: int) -> bytes:
        pixels = grid.cut(frame, tile)
        if tile in refused:
            coded = raw_tile(pixels)
        else:
            coded = Coded(Coding.COPY, b"") if in_front[tile] else code_tile(pixels)
        counts.sends += 1
        counts.resends += tile in counts.known
        counts.known.add(tile)
        return TILE_REQUEST.pack(epoch, tile, coded.coding) + coded.data

    def has_arrived(tile: int, body: bytes, status: ReplyStatus, reply: bytes) -> bool:
        coding = Coding(body[TILE_REQUEST.size - 1])
        if status == ReplyStatus.OK and reply == TILE_REPLY.pack(tile):
            if tile not in window.arrived:
                counts.arrived.add(tile)
                counts.payload_bytes += len(body) - TILE_REQUEST.size
                count = "copied" if coding == Coding.COPY else coding.name.lower()
                setattr(counts, count, getattr(counts, count) + 1)
            return True
        if status == ReplyStatus.BAD_TILE_DATA and coding != Coding.RAW:
            refused.add(tile)  # raw pixels need no decoder
        elif status != ReplyStatus.STALE_EPOCH:
            raise refusal(session.line.url, Kind.TILE, status)
        return False

    window = Window(session, Kind.TILE, window_bytes, request, has_arrived)
    return window.run(tiles, grid.count, progress, ends=ReplyStatus.STALE_EPOCH)


class BoardSink:
    """A `Sink` that sends a tile as soon as all its rows are known; `finish` shows the frame."""

    def __init__(self, session: Session, plan: Plan, force: bool = False) -> None:
        """Raise InputError for a plan of another display; with `force`, only for another panel size."""
        self._panel = plan.display.panel
        check_shape(self._panel.shape, plan.display, session.info, force)
        self.bands = bands_of_plan(plan)
        self._session = session
        self._grid = session.info.grid
        self._frame = np.zeros(self._panel.shape, np.uint8)
        self._missing = np.ones(self._grid.height, np.bool_)
        self._sent = Sent()

    def add_rows(self, first: int, rows: Pixels) -> None:
        """Add panel values (rows, width, 3), from row `first` on; send complete tiles."""
        last = first + len(rows)
        self._frame[first:last] = rows
        self._missing[first:last] = False
        complete = [
            tile
            for row in range(first // TILE, -(-last // TILE))
            if not self._missing[row * TILE : (row + 1) * TILE].any()
            for tile in range(row * self._grid.columns, (row + 1) * self._grid.columns)
        ]
        begun, written = time.monotonic(), self._session.line.written
        back = self._session.tiles(BACK)
        to_send = [tile for tile in complete if back.crcs[tile] != frame_crc(self._grid.cut(self._frame, tile))]
        in_front = np.zeros(self._grid.count, np.bool_)
        # If the board's buffers were swapped meanwhile, `finish` sends these tiles again.
        _send_tiles(self._session, self._frame, back.epoch, to_send, in_front, self._sent)
        self._sent.wire_bytes += self._session.line.written - written
        self._sent.seconds += time.monotonic() - begun

    def finish(self) -> Sent:
        """Send missing tiles, show the frame and return the counts.

        Raises the errors of `send_frame`.
        """
        return send_frame(self._session, self._frame, counts=self._sent)

    def missing_bands(self) -> Sequence[Band]:
        """Return all bands of the plan."""
        return self.bands

    def take(self, rendered: RenderedBand) -> None:
        """Add a band's rows, and send complete tiles."""
        values = panel_values(rendered.radiance, self._panel.transfer, self._panel.bits)
        self.add_rows(rendered.band.rows.start, values)

    def stop(self, done_rows: int) -> None:
        """Do nothing: the panel keeps its frame."""


class Sender:
    """A thread that shows pictures on a board; it sends only the newest waiting picture."""

    def __init__(self, session: Session) -> None:
        self.frames = self.tiles = self.wire_bytes = 0
        self._session = session
        self._newest: deque[Pixels] = deque(maxlen=1)
        self._error: Exception | None = None
        self._over = False
        self._calls = threading.Semaphore(0)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send(self, pixels: Pixels) -> None:
        """Queue the next picture (height, width, 3).

        Raises the error of an earlier picture that could not be sent.
        """
        if self._error is not None:
            raise self._error
        self._newest.append(pixels.copy())
        self._calls.release()

    def finish(self) -> None:
        """Send the newest picture and end the thread; raises the errors of `send`."""
        self._over = True
        self._calls.release()
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        while self._calls.acquire() and (self._newest or not self._over):
            if not self._newest:  # the newest picture was already sent
                continue
            try:
                counts = send_frame(self._session, self._newest.pop())
            except Exception as error:  # `send` and `finish` raise this error
                self._error = error
                return
            self.frames += 1
            self.tiles += len(counts.arrived)
            self.wire_bytes += counts.wire_bytes

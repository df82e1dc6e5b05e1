"""Streaming of frames: tiles are sent in a window, lost ones again; the panel shows the frame when it is complete."""

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

from lippmann.base.progress import Progress
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

#: Maximum of bytes that are sent and not yet acknowledged: about 16 raw tiles.
WINDOW_BYTES = 50_000

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
    session: Session,
    frame: Pixels,
    progress: Progress | None = None,
    window_bytes: int = WINDOW_BYTES,
    sent: Sent | None = None,
) -> Sent:
    """Send a frame to the board and show it on the panel.

    The frame is (height, width, 3) uint8, of the panel's size. Tiles that the board holds are not sent: after a lost
    connection, call again with the same frame, and with the counts `sent`, to which each call adds, also when it fails.
    `window_bytes` is that of `Window`; `progress` counts tiles.

    Raises InputError when the frame does not have the panel's size; NoBoardError when the connection is lost, or the
    board does not answer; DeviceError when the board refuses tiles, or another board took its place.
    """
    grid = session.info.grid
    if frame.shape != (grid.height, grid.width, 3) or frame.dtype != np.uint8:
        raise InputError(
            f"a frame of {frame.shape} {frame.dtype} does not fit a panel of {grid.width} x {grid.height} pixels; "
            f"give ({grid.height}, {grid.width}, 3) uint8"
        )
    begun = time.monotonic()
    written = session.line.written
    sent = sent or Sent()
    sent.crc, sent.tiles, sent.image_bytes = frame_crc(frame), grid.count, frame.size
    try:
        _show(session, frame, sent, progress, window_bytes)
    finally:
        sent.wire_bytes += session.line.written - written
        sent.seconds += time.monotonic() - begun
    sent.skipped = sent.tiles - len(sent.known)
    return sent


def _show(session: Session, frame: Pixels, sent: Sent, progress: Progress | None, window_bytes: int) -> None:
    """Send the missing tiles and present the frame, until the board shows it."""
    crcs = session.info.grid.crcs(frame)
    status = ReplyStatus.OK
    for _ in range(MAX_ROUNDS):
        if status == ReplyStatus.STALE_EPOCH:
            # The board was reset, or is another one.
            before = session.info
            session.hello()
            session.must_be(before)
        back = session.tiles(BACK)
        front = session.tiles(FRONT)
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
        status = _send_tiles(session, frame, front.epoch, missing.tolist(), in_front, sent, progress, window_bytes)
        if status == ReplyStatus.OK:
            status, sent.epoch = session.present(front.epoch, sent.crc)
        if status == ReplyStatus.OK:
            return
    raise session.error(
        f"the frame was sent {MAX_ROUNDS} times and is still not whole on the board",
        "check its power, and that no other program uses it",
    )


def _send_tiles(
    session: Session,
    frame: Pixels,
    epoch: int,
    tiles: Sequence[int],
    in_front: npt.NDArray[np.bool_],
    sent: Sent,
    progress: Progress | None = None,
    window_bytes: int = WINDOW_BYTES,
) -> ReplyStatus:
    """Send tiles of a frame in one epoch; those `in_front` are copied from the board's front buffer.

    Return OK, or STALE_EPOCH when the board's buffers were swapped meanwhile.
    """
    grid = session.info.grid
    refused: set[int] = set()

    def request(tile: int) -> bytes:
        pixels = grid.cut(frame, tile)
        if tile in refused:
            coded = raw_tile(pixels)
        else:
            coded = Coded(Coding.COPY, b"") if in_front[tile] else code_tile(pixels)
        sent.sends += 1
        sent.resends += tile in sent.known
        sent.known.add(tile)
        return TILE_REQUEST.pack(epoch, tile, coded.coding) + coded.data

    def has_arrived(tile: int, body: bytes, status: ReplyStatus, reply: bytes) -> bool:
        coding = Coding(body[TILE_REQUEST.size - 1])
        if status == ReplyStatus.OK and reply == TILE_REPLY.pack(tile):
            if tile not in window.arrived:
                sent.arrived.add(tile)
                sent.payload_bytes += len(body) - TILE_REQUEST.size
                count = "copied" if coding == Coding.COPY else coding.name.lower()
                setattr(sent, count, getattr(sent, count) + 1)
            return True
        if status == ReplyStatus.BAD_TILE_DATA and coding != Coding.RAW:
            # Sent raw next: raw pixels need no decoder.
            refused.add(tile)
        elif status != ReplyStatus.STALE_EPOCH:
            raise refusal(session.line.url, Kind.TILE, status)
        return False

    window = Window(session, Kind.TILE, window_bytes, request, has_arrived)
    return window.run(tiles, grid.count, progress, ends=ReplyStatus.STALE_EPOCH)


class BoardSink:
    """Bands of a plan, sent to a board as they are rendered: a `lippmann.rendering.sinks.Sink`.

    The panel shows the frame when `finish` returns. A tile is sent when its last row has come.
    """

    def __init__(self, session: Session, plan: Plan, force: bool = False) -> None:
        """Raise InputError for a plan for another display than the board's, with `force` only for another size."""
        panel = plan.display.panel
        check_shape((panel.height_px, panel.width_px, 3), plan.display, session.info, force)
        self.bands = bands_of_plan(plan)
        self._panel = panel
        self._session = session
        self._grid = session.info.grid
        self._frame = np.zeros((self._grid.height, self._grid.width, 3), np.uint8)
        self._missing = np.ones(self._grid.height, np.bool_)
        self._sent = Sent()

    def put(self, first: int, rows: Pixels) -> None:
        """Take panel values (rows, width, 3) uint8 from row `first` on, and send the tiles that are complete.

        Rows may come in any order, of any number, each once.
        """
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
        # Where the board's buffers were swapped meanwhile, `finish` begins again.
        _send_tiles(self._session, self._frame, back.epoch, to_send, in_front, self._sent)
        self._sent.wire_bytes += self._session.line.written - written
        self._sent.seconds += time.monotonic() - begun

    def finish(self) -> Sent:
        """Send the tiles that the board lacks, show the frame, and return the counts; raises as `send_frame`."""
        return send_frame(self._session, self._frame, sent=self._sent)

    def missing_bands(self) -> Sequence[Band]:
        """Return all bands."""
        return self.bands

    def take(self, rendered: RenderedBand) -> None:
        """Send the tiles that are complete with a band."""
        values = panel_values(rendered.radiance, self._panel.transfer, self._panel.bits)
        self.put(rendered.band.rows.start, values)

    def stop(self, done_rows: int) -> None:
        """Leave the panel as it is: it shows a frame only when that is complete."""


class Sender:
    """A thread that shows pictures on a board, each whole; of those that come while it sends, the newest is next."""

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
        """Give the next picture (height, width, 3); raise what the board's last one met."""
        if self._error is not None:
            raise self._error
        self._newest.append(pixels.copy())
        self._calls.release()

    def finish(self) -> None:
        """Wait until the newest picture is shown, and end the thread; raise as `send`."""
        self._over = True
        self._calls.release()
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        while self._calls.acquire() and (self._newest or not self._over):
            if not self._newest:  # sent already, by an earlier call
                continue
            try:
                sent = send_frame(self._session, self._newest.pop())
            except Exception as error:  # it is raised where pictures are made
                self._error = error
                return
            self.frames += 1
            self.tiles += len(sent.arrived)
            self.wire_bytes += sent.wire_bytes

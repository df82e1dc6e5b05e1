"""Sends the newest of a stream of pictures to a board, beside whoever makes them."""

from __future__ import annotations

import threading

from lippmann.base.fullscreen import Pixels
from lippmann.board.board import Board
from lippmann.board.streaming import send_frame


class Sender:
    """A thread that shows pictures on a board, each whole; of those that come while it sends, the newest is next."""

    def __init__(self, board: Board) -> None:
        self.frames = self.tiles = self.wire_bytes = 0
        self._board = board
        self._next: Pixels | None = None
        self._error: Exception | None = None
        self._over, self._busy = False, False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send(self, pixels: Pixels) -> None:
        """Give the next picture (height, width, 3); raise what the board's last one met."""
        with self._changed:
            if self._error is not None:
                raise self._error
            self._next = pixels.copy()
            self._changed.notify_all()

    def finish(self) -> None:
        """Wait until the newest picture is shown, and end the thread; raise as `send`."""
        with self._changed:
            self._over = True
            self._changed.notify_all()
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._next is not None or self._over)
                pixels, self._next = self._next, None
            if pixels is None:
                return
            try:
                sent = send_frame(self._board, pixels)
            except Exception as error:  # it is raised where pictures are made
                with self._changed:
                    self._error = error
                return
            self.frames += 1
            self.tiles += len(sent.arrived)
            self.wire_bytes += sent.wire_bytes

"""The closed loop on the virtual board: rays are checked, a frame is streamed, and the scanned-out frame is kept."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lippmann.board.board import Board
from lippmann.board.check_rays import Check, check_rays
from lippmann.board.stream import Progress, Sent, send_frame
from lippmann.board.tiles import Pixels
from lippmann.display import Display
from lippmann.sim import virtual_board

#: Longest silence of a virtual board with its video running, s: it shares the machine.
PATIENCE_S = 300.0


@dataclass(frozen=True)
class Loop:
    """Results of the closed loop.

    Attributes
    ----------
    check
        Comparison of a region's rays with the twin's.
    sent
        Tiles, bytes and seconds of the transfer.
    panel_crc
        CRC-32 of the scanned-out frame, as the board reports it.
    panel_frame
        (height, width, 3) uint8, the scanned-out frame.
    clocks, seconds
        Simulated clocks, and the time that they took.
    """

    check: Check
    sent: Sent
    panel_crc: int
    panel_frame: Pixels
    clocks: int
    seconds: float


def run_on_virtual_board(
    display: Display,
    frame: Pixels,
    columns: tuple[int, int],
    rows: tuple[int, int],
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Loop:
    """Start a virtual board for a display, compare a region's rays, stream a frame, and keep the scanned-out frame.

    Parameters
    ----------
    frame
        (height, width, 3) uint8, panel values.
    columns, rows
        First and last of the region whose rays are compared.
    progress
        Called with (tiles done, tiles of the frame).
    say
        Called with a sentence before each long step.

    Raises
    ------
    DeviceError
        When the board fails, or scans out no frame in time.
    InputError
        For a display that the board's optics do not support.
    MissingLibraryError
        When a tool is missing.
    """
    with tempfile.TemporaryDirectory() as folder:
        say("starting the virtual board (compiled once, half a minute) ...")
        virtual = virtual_board.start(display, capture=Path(folder))
        try:
            with Board.open(virtual.url, patience_s=PATIENCE_S) as board:
                check = check_rays(board, display, columns, rows)
                sent = send_frame(board, frame, progress)
                crc = board.panel_crc()
        finally:
            done = virtual.stop()
        last = max(Path(folder).glob("frame-*.rgb"))
        panel_frame = np.frombuffer(last.read_bytes(), np.uint8).reshape(frame.shape)
    return Loop(check, sent, crc, panel_frame, done["clocks"], done["seconds"])

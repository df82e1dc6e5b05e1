"""The loop on the virtual board: its rays checked, a frame streamed to it, and what then leaves for the panel."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lippmann.board.board import Board
from lippmann.board.check import Check, check_rays
from lippmann.board.displayed import shown_crc
from lippmann.board.stream import Progress, Sent, send_frame
from lippmann.board.tiles import Pixels
from lippmann.display import Display
from lippmann.sim import virtual_board

#: A simulated board with its video running shares the machine: replies may take long.
PATIENCE_S = 300.0


@dataclass(frozen=True)
class Loop:
    """What the virtual board did.

    Attributes
    ----------
    check
        A region's rays against the twin's.
    sent
        What streaming the frame took.
    shown_crc
        CRC-32 of the frame that left for the panel, as the board says.
    scanned
        (height, width, 3) uint8, the frame that left for the panel.
    clocks
        Clocks that were simulated.
    """

    check: Check
    sent: Sent
    shown_crc: int
    scanned: Pixels
    clocks: int


def run_on_virtual_board(
    display: Display,
    frame: Pixels,
    columns: tuple[int, int],
    rows: tuple[int, int],
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Loop:
    """Start a virtual board for a display, compare a region's rays, stream a frame, and take what is scanned out.

    Parameters
    ----------
    frame
        (height, width, 3) uint8, the panel's values.
    columns, rows
        First and last of the region whose rays are compared.
    progress
        Called as tiles arrive.
    say
        Told what is being done.

    Raises
    ------
    DeviceError
        When the board fails, or the panel does not show a frame in time.
    InputError
        For a display that the board's optics cannot hold.
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
                shown = shown_crc(board)
        finally:
            done = virtual.stop()
        last = max(Path(folder).glob("frame-*.rgb"))
        scanned = np.frombuffer(last.read_bytes(), np.uint8).reshape(frame.shape)
    return Loop(check, sent, shown, scanned, done["clocks"])

"""The closed loop on the virtual board: rays are checked, a frame is streamed, and the scanned-out frame is kept."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from lippmann.board.board import Board
from lippmann.board.check_rays import Check, check_rays
from lippmann.board.stream import Progress, Sent, send_frame
from lippmann.board.tiles import Pixels
from lippmann.display import Display
from lippmann.sim import virtual_board
from lippmann.toml import documented, key

#: Longest silence of a virtual board with its video running, s: it shares the machine.
PATIENCE_S = 300.0


@documented
@dataclass(frozen=True)
class Loop:
    """Results of the closed loop."""

    check: Annotated[Check, key("comparison of a region's rays with the twin's")]
    sent: Annotated[Sent, key("tiles, bytes and seconds of the transfer")]
    panel_crc: Annotated[int, key("CRC-32 of the scanned-out frame, as the board reports it")]
    panel_frame: Annotated[Pixels, key("(height, width, 3) uint8, the scanned-out frame")]
    clocks: Annotated[int, key("simulated clocks")]
    seconds: Annotated[float, key("time that the simulation took")]


def run_on_virtual_board(
    display: Display,
    frame: Pixels,
    columns: tuple[int, int],
    rows: tuple[int, int],
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Loop:
    """Start a virtual board for a display, compare a region's rays, stream a frame, and keep the scanned-out frame.

    `frame` holds panel values, (height, width, 3) uint8; `columns` and `rows` are first and last of the region. `say`
    is called with a sentence before each long step. Raises as `virtual_board.start`, `check_rays` and `send_frame`.
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

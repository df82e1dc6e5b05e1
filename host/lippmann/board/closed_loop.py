"""The closed loop on the virtual board: rays are checked, a frame is streamed, and the scanned-out frame is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from lippmann.base.files import scratch_folder
from lippmann.base.progress import Progress
from lippmann.base.toml import documented, key
from lippmann.board.board import Board
from lippmann.board.check_rays import Check, check_rays
from lippmann.board.streaming import Sent, send_frame
from lippmann.board.tiles import Pixels
from lippmann.display.description import Display
from lippmann.fixed.scene_build import SceneBuild
from lippmann.simulation import virtual_board

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


@dataclass
class Captured:
    """An open virtual board; when it has ended also its frames and counts.

    `frames` are those scanned out, (height, width, 3) uint8, in their order without repetitions; `counts` are those of
    `RunningBoard.stop`.
    """

    board: Board
    frames: list[Pixels] = field(default_factory=list)
    counts: dict[str, Any] = field(default_factory=dict)


@contextmanager
def capturing(display: Display, scene: SceneBuild | None = None) -> Iterator[Captured]:
    """Run a virtual board, and keep what it scans out; `scene` and errors are those of `virtual_board.start`."""
    with scratch_folder() as folder:
        virtual = virtual_board.start(display, capture=folder, scene=scene)
        try:
            with Board.open(virtual.url, patience_s=PATIENCE_S) as board:
                captured = Captured(board)
                yield captured
        finally:
            counts = virtual.stop()
        captured.counts = counts
        shape = display.panel.height_px, display.panel.width_px, 3
        for path in sorted(folder.glob("frame-*.rgb")):
            captured.frames.append(np.frombuffer(path.read_bytes(), np.uint8).reshape(shape))


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
    say("starting the virtual board (compiled once, half a minute) ...")
    with capturing(display) as captured:
        check = check_rays(captured.board, display, columns, rows)
        sent = send_frame(captured.board, frame, progress)
        crc = captured.board.panel_crc()
    return Loop(check, sent, crc, captured.frames[-1], captured.counts["clocks"], captured.counts["seconds"])

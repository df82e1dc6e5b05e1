"""Run a virtual board and capture its scanned-out frames; compare frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lippmann.base.files import scratch_folder
from lippmann.board.board import Board
from lippmann.board.tiles import Pixels
from lippmann.display.description import Display
from lippmann.fixed.scene_build import SceneBuild
from lippmann.simulation import virtual_board

#: Time without a reply after which a virtual board counts as failed, s.
PATIENCE_S = 300.0


@dataclass
class CapturedBoard:
    """An open virtual board, and its captured frames.

    After the board has ended, `frames` contains the scanned-out frames (height, width,
    3) uint8 without repetitions; `counts` is the result of `RunningBoard.stop`.
    """

    board: Board
    frames: list[Pixels] = field(default_factory=list)
    counts: dict[str, Any] = field(default_factory=dict)


@contextmanager
def capturing(display: Display, scene: SceneBuild | None = None) -> Iterator[CapturedBoard]:
    """Run a virtual board and capture its frames.

    Raises the errors of `virtual_board.start`.
    """
    with scratch_folder() as folder:
        virtual = virtual_board.start(display, capture=folder, scene=scene)
        try:
            with Board.open(virtual.url, patience_s=PATIENCE_S) as board:
                captured = CapturedBoard(board)
                yield captured
        finally:
            counts = virtual.stop()
        captured.counts = counts
        for path in sorted(folder.glob("frame-*.rgb")):
            frame = np.frombuffer(path.read_bytes(), np.uint8)
            captured.frames.append(frame.reshape(display.panel.shape))


def frames_differ(frames: Sequence[Pixels], expected: Sequence[Pixels]) -> int:
    """Count differing pixels of two lists of frames (height, width, 3); a missing frame differs in all pixels."""
    counts = [int((one != other).any(axis=2).sum()) for one, other in zip(frames, expected, strict=False)]
    return sum(counts) + sum(one.size // 3 for one in (*frames[len(counts) :], *expected[len(counts) :]))

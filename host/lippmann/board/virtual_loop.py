"""Loops on the virtual board: its rays and drawn frames are compared with the twin's, and what it scans out is kept."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from lippmann.base.files import scratch_folder
from lippmann.base.progress import Progress
from lippmann.base.toml import documented, key
from lippmann.board.board import Board, Check, check_rays
from lippmann.board.drawn_scene import Loaded, SceneBoard
from lippmann.board.film_player import Played, load_textures, play_film
from lippmann.board.streaming import Sent, send_frame
from lippmann.board.tiles import Pixels
from lippmann.display.description import Display
from lippmann.fixed.drawn_frame import draw
from lippmann.fixed.scene_build import SceneBuild
from lippmann.motion.layer_film import LayerFilm
from lippmann.simulation import virtual_board

logger = logging.getLogger(__name__)

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


@documented
@dataclass(frozen=True)
class DrawnLoop:
    """Results of a film on a virtual board that draws."""

    loaded: Annotated[Loaded, key("blocks, bytes and seconds of the load")]
    played: Annotated[Played, key("frames, bytes and late pixels")]
    frames: Annotated[list[Pixels], key("(height, width, 3) uint8 each, the scanned-out frames in their order")]
    pixels_differ: Annotated[int, key("pixels that differ from the twin's; a frame too many or too few counts whole")]


@dataclass
class CapturedBoard:
    """An open virtual board; when it has ended also its frames and counts.

    `frames` are those scanned out, (height, width, 3) uint8, in their order without repetitions; `counts` are those of
    `RunningBoard.stop`.
    """

    board: Board
    frames: list[Pixels] = field(default_factory=list)
    counts: dict[str, Any] = field(default_factory=dict)


@contextmanager
def capturing(display: Display, scene: SceneBuild | None = None) -> Iterator[CapturedBoard]:
    """Run a virtual board, and keep what it scans out; `scene` and errors are those of `virtual_board.start`."""
    with scratch_folder() as folder:
        virtual = virtual_board.start(display, capture=folder, scene=scene)
        try:
            with Board.open(virtual.url, patience_s=PATIENCE_S) as board:
                captured = CapturedBoard(board)
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
) -> Loop:
    """Start a virtual board for a display, compare a region's rays, stream a frame, and keep the scanned-out frame.

    `frame` holds panel values, (height, width, 3) uint8; `columns` and `rows` are first and last of the region;
    `progress` counts tiles. Raises as `virtual_board.start`, `check_rays` and `send_frame`.
    """
    logger.info("starting the virtual board (compiled once, half a minute) ...")
    with capturing(display) as captured:
        check = check_rays(captured.board, display, columns, rows)
        sent = send_frame(captured.board, frame, progress)
        crc = captured.board.panel_crc()
    return Loop(check, sent, crc, captured.frames[-1], captured.counts["clocks"], captured.counts["seconds"])


def draw_on_virtual_board(
    display: Display, film: LayerFilm, build: SceneBuild, progress: Progress | None = None
) -> DrawnLoop:
    """Play a film on a virtual board that draws, until its panel has shown every frame, and compare all it shows.

    `build` is that of the board's drawing; `progress` counts frames. Raises as `load_textures`, `play_film` and
    `virtual_board.start`.
    """
    with capturing(display, build) as captured:
        captured.board.panel_crc()  # a black frame has been scanned out
        scene = SceneBoard(captured.board)
        loaded, slots = load_textures(scene, display, film)
        played = play_film(scene, display, film, slots, every_frame=True, progress=progress)
        captured.board.panel_crc()  # and the last one
    optics = virtual_board.board_build(display, build)
    drawn = [draw(display, optics, film.at(frame)[0], build) for frame in range(film.frames)]
    # A frame like the one before it is captured once.
    expected = [np.zeros_like(drawn[0])]
    expected += [one for one, before in zip(drawn, [*expected, *drawn], strict=False) if (one != before).any()]
    return DrawnLoop(loaded, played, captured.frames[1:], frames_differ(captured.frames, expected))


def frames_differ(shown: Sequence[Pixels], expected: Sequence[Pixels]) -> int:
    """Return in how many pixels frames (height, width, 3) differ; those of a missing frame all do."""
    counts = [int((one != other).any(axis=2).sum()) for one, other in zip(shown, expected, strict=False)]
    return sum(counts) + sum(one.size // 3 for one in (*shown[len(counts) :], *expected[len(counts) :]))

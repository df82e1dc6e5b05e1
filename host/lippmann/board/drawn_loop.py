"""A board that draws plays a film, and the frames that it scans out are compared with those of the integer twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lippmann.base.progress import Progress
from lippmann.base.toml import documented, key
from lippmann.board.closed_loop import capturing
from lippmann.board.drawn_scene import Loaded, SceneBoard
from lippmann.board.film_player import Played, load_textures, play_film
from lippmann.board.tiles import Pixels
from lippmann.display.description import Display
from lippmann.fixed.drawn_frame import draw
from lippmann.fixed.scene_build import SceneBuild
from lippmann.motion.layer_film import LayerFilm
from lippmann.simulation.virtual_board import board_build


@documented
@dataclass(frozen=True)
class DrawnLoop:
    """Results of a film on a virtual board that draws."""

    loaded: Annotated[Loaded, key("blocks, bytes and seconds of the load")]
    played: Annotated[Played, key("frames, bytes and late pixels")]
    frames: Annotated[list[Pixels], key("(height, width, 3) uint8 each, the scanned-out frames in their order")]
    pixels_differ: Annotated[int, key("pixels that differ from the twin's; a frame too many or too few counts whole")]


def draw_on_virtual_board(
    display: Display, film: LayerFilm, build: SceneBuild, progress: Progress | None = None
) -> DrawnLoop:
    """Play a film on a virtual board that draws, until its panel has shown every frame, and compare all it shows.

    `build` is that of the board's drawing; `progress` is called with (frames done, frames). Raises as `load_textures`,
    `play_film` and `virtual_board.start`.
    """
    with capturing(display, build) as captured:
        captured.board.panel_crc()  # a black frame has been scanned out
        scene = SceneBoard(captured.board)
        loaded, slots = load_textures(scene, display, film)
        played = play_film(scene, display, film, slots, every_frame=True, progress=progress)
        captured.board.panel_crc()  # and the last one
    optics = board_build(display, build)
    drawn = [draw(display, optics, film.at(frame)[0], build) for frame in range(film.frames)]
    # A frame like the one before it is captured once.
    wanted = [np.zeros_like(drawn[0])]
    wanted += [one for one, before in zip(drawn, [*wanted, *drawn], strict=False) if (one != before).any()]
    return DrawnLoop(loaded, played, captured.frames[1:], frames_differ(captured.frames, wanted))


def frames_differ(shown: Sequence[Pixels], wanted: Sequence[Pixels]) -> int:
    """Return in how many pixels frames (height, width, 3) differ; those of a missing frame all do."""
    counts = [int((one != other).any(axis=2).sum()) for one, other in zip(shown, wanted, strict=False)]
    return sum(counts) + sum(one.size // 3 for one in (*shown[len(counts) :], *wanted[len(counts) :]))

"""Play a film of layers on a board: load textures, then write registers for each frame."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Annotated

from lippmann.base.progress_protocol import Progress
from lippmann.base.toml import documented, key
from lippmann.board.drawn_scene import Loaded, SceneBoard
from lippmann.display.description import Display
from lippmann.errors import InputError, located
from lippmann.fixed.scene_build import CURVE_SLOT
from lippmann.fixed.scene_configuration import build_curve_table, scene_words, slot_bytes
from lippmann.motion.layer_film import LayerFilm


@documented
@dataclass
class Played:
    """Counts of a played film."""

    first_bytes: Annotated[int, key("bytes sent to prepare the first frame, without textures")] = 0
    frames: Annotated[int, key("frames written")] = 0
    seconds: Annotated[float, key("time from the first frame to the write of the last frame, s")] = 0.0
    bytes: Annotated[int, key("bytes sent for the frames")] = 0
    most_bytes: Annotated[int, key("maximum number of bytes sent for a frame")] = 0
    late: Annotated[int, key("frames written more than one frame period late")] = 0
    underflows: Annotated[int, key("pixels that the board did not draw in time")] = 0


def load_textures(
    scene: SceneBoard, display: Display, film: LayerFilm, progress: Progress | None = None, where: str = "film"
) -> tuple[Loaded, list[int]]:
    """Load a film's textures and the panel's transfer curve; return transfer counts and each layer's slot.

    A shown scene stays on the panel unless it uses another transfer curve. `progress`
    counts blocks. `where` names the film in messages. Raises InputError, before it
    sends anything, for layers that do not fit the board and for motion beyond a
    register's range. Raises DeviceError when too few slots are free, and the errors of
    `SceneBoard.load`.
    """
    contents = []
    for name, layer in zip(film.names, film.stack.layers, strict=True):
        try:
            contents.append(slot_bytes(layer, scene.build).tobytes())
        except InputError as error:
            raise InputError(f"{where}: layer '{name}': {str(error).removeprefix('layer: ')}") from None
    for frame in range(film.frames):
        stack, numbers = film.at(frame)
        with located(f"{where}: frame {frame}"):
            scene_words(display, stack, scene.build, numbers, [film.names[number] for number in numbers])
    scene.wait()  # an ended scene's slots become free when the panel no longer shows it
    slots = scene.free_slots(contents)
    loaded = scene.load(dict(zip(slots, contents, strict=True)), progress)
    curve = build_curve_table(display).tobytes()
    if CURVE_SLOT in scene.status().slots and not scene.holds(CURVE_SLOT, curve):
        scene.draw(False)
    return scene.load({CURVE_SLOT: curve}, loaded=loaded), slots


def play_film(
    scene: SceneBoard,
    display: Display,
    film: LayerFilm,
    slots: list[int],
    repeat: int = 1,
    every_frame: bool = False,
    progress: Progress | None = None,
    played: Played | None = None,
) -> Played:
    """Play a film `repeat` times (0: endlessly); the last frame stays on the panel.

    `slots` comes from `load_textures`. Frames are written at the film's speed; with
    `every_frame`, each frame is written when the panel shows the previous frame.
    `progress` counts frames, unless the film is endless. `played` receives the counts,
    also after Ctrl-C. Raises DeviceError when the board refuses a write, the panel does
    not change, or no scene is shown at the end.
    """
    played = Played() if played is None else played
    line = scene.board.line
    _show_first(scene, display, film, slots, played)
    before = scene.status()
    begun = time.monotonic()
    period = 1.0 / film.frames_per_second
    interrupt: KeyboardInterrupt | None = None
    try:
        while repeat == 0 or played.frames < repeat * film.frames:
            if every_frame:
                scene.wait(True)
            else:
                wait = begun + played.frames * period - time.monotonic()
                time.sleep(max(wait, 0.0))
                played.late += wait < -period
            stack, numbers = film.at(played.frames % film.frames)
            written = line.written
            scene.set_stack(display, stack, [slots[number] for number in numbers])
            played.most_bytes = max(played.most_bytes, line.written - written)
            played.bytes += line.written - written
            played.frames += 1
            if progress and repeat:
                progress(played.frames, repeat * film.frames)
    except KeyboardInterrupt as error:
        interrupt = error
    played.seconds = time.monotonic() - begun
    if every_frame:
        scene.wait(True)
    after = scene.status()
    played.underflows = (after.underflows - before.underflows) % (1 << 32)
    if interrupt:
        raise interrupt
    if not after.is_shown:
        raise scene.board.error("the board no longer draws the scene (reset, or scene ended)", "play the film again")
    return played


def _show_first(scene: SceneBoard, display: Display, film: LayerFilm, slots: list[int], played: Played) -> None:
    """Show the first frame; until then, keep a shown scene whose lattice and background match."""
    stack, numbers = film.at(0)
    order = [slots[number] for number in numbers]
    is_shown = scene.status().is_shown
    goes_on = is_shown and scene.holds_common(display, stack)
    if is_shown and not goes_on:
        scene.draw(False)
    written = scene.board.line.written
    (scene.set_stack if goes_on else scene.prepare)(display, stack, order)
    played.first_bytes = scene.board.line.written - written
    scene.draw(True)

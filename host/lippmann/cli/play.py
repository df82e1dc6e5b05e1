"""`lippmann play`: a board draws a film of layers by itself."""

from __future__ import annotations

import time
from typing import Any

import click

from lippmann.board.scene import Loaded, SceneBoard
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.options.common import DISPLAY
from lippmann.cli.options.port import OPEN_BOARD, OpenBoard, check_board
from lippmann.cli.output import emit, progress_bar
from lippmann.display import Display, load_display
from lippmann.errors import input_error
from lippmann.film.layer_film import LayerFilm, check_keys, load_layer_film
from lippmann.fixed.scene_configuration import curve_table, scene_words, slot_bytes
from lippmann.layers.folder import check_for_display


@make_command("play")
def command(
    film_path: str = argument("FILM"),
    display_path: str = DISPLAY,
    repeat: int = option("Play the film this many times; 0: until Ctrl-C.", 1, click.IntRange(0)),
    force: bool = option("Accept a board that drives another display.", False),
    open_board: OpenBoard = OPEN_BOARD,
) -> None:
    """Play a film of layers, or show a folder of layers, on a board that draws.

    FILM is a film file of layers, or a folder that lippmann layers has made. The textures go to the board once; blocks
    that it holds are not sent again. Then each frame is one short packet. The last frame stays on the panel.

    Example: lippmann play swim-layers.toml --display scenes/displays/vga-square.toml --port socket://127.0.0.1:4000
    """
    display = load_display(display_path)
    film = load_layer_film(film_path)
    check_keys(film, film_path)
    check_for_display(film.stack, display, film_path)
    with open_board() as board:
        if not force:
            check_board(board, display, display_path, ", or play with --force")
        scene = SceneBoard(board)
        if len(film.stack.layers) > scene.build.layers:
            what = f"has {len(film.stack.layers)} layers, the board draws {scene.build.layers}"
            raise input_error(film_path, what, f"cut the scene again with --count {scene.build.layers}")
        loaded, slots = _load(scene, display, film)
        result = _play(scene, display, film, slots, repeat)
    result |= {"load": vars(loaded)}
    emit(
        {"port": board.line.url, "film": film_path, **result},
        [
            f"{loaded.blocks - loaded.skipped} of {loaded.blocks} blocks in {loaded.seconds:.3g} s",
            f"{result['frames']} frames in {result['seconds']:.4g} s, {result['bytes']} bytes on the line, at most "
            f"{result['most_bytes']} a frame; {result['late']} frames late, {result['underflows']} pixels late",
        ],
    )


def _load(scene: SceneBoard, display: Display, film: LayerFilm) -> tuple[Loaded, list[int]]:
    """Load the textures and the curve; return the counts, and each layer's slot."""
    contents = [slot_bytes(layer, scene.build).tobytes() for layer in film.stack.layers]
    for frame in range(film.frames):  # every value fits its register, or nothing is sent
        stack, numbers = film.at(frame)
        scene_words(display, stack, scene.build, numbers)
    loaded = Loaded()
    slots = scene.free_slots(contents)
    with progress_bar("loading the layers") as progress:
        scene.load(dict(zip(slots, contents, strict=True)), progress, loaded=loaded)
    curve = curve_table(display).tobytes()
    if 15 in scene.status().slots and not scene.holds(15, curve):
        scene.draw(False)
    scene.load({15: curve})
    return loaded, slots


def _play(
    scene: SceneBoard, display: Display, film: LayerFilm, slots: list[int], repeat: int
) -> dict[str, Any]:  # fmt: skip
    """Show the film's frames at its speed; return counts."""
    stack, numbers = film.at(0)
    order = [slots[number] for number in numbers]
    shown = scene.status().shown
    if shown and scene.holds_common(display, stack):
        scene.set_stack(display, stack, order)
        scene.wait(True)
    else:
        if shown:
            scene.draw(False)
        scene.prepare(display, stack, order)
        scene.draw(True)
    before = scene.status()
    line = scene.board.line
    begun, written = time.monotonic(), line.written
    frames = most = late = 0
    period = 1.0 / film.frames_per_second
    turn = 0
    while repeat == 0 or turn < repeat:
        for frame in range(film.frames):
            due = begun + frames * period
            wait = due - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            late += wait < -period
            stack, numbers = film.at(frame)
            at = line.written
            scene.set_stack(display, stack, [slots[number] for number in numbers])
            most = max(most, line.written - at)
            frames += 1
        turn += 1
    after = scene.status()
    return {
        "frames": frames,
        "seconds": time.monotonic() - begun,
        "bytes": line.written - written,
        "most_bytes": most,
        "late": late,
        "underflows": (after.underflows - before.underflows) % (1 << 32),
    }

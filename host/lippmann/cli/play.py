"""Command `lippmann play`."""

from __future__ import annotations

from collections.abc import Iterator

import click

from lippmann.base import interrupts
from lippmann.board.drawn_scene import Loaded, SceneBoard
from lippmann.board.film_player import Played, load_textures, play_film
from lippmann.cli.frame import Name, argument, make_command, option
from lippmann.cli.options import DISPLAY
from lippmann.cli.options_port import FORCE_BOARD, OPEN_BOARD, OpenBoard
from lippmann.cli.output import emit
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import Display
from lippmann.errors import input_error
from lippmann.layers.layers_and_pictures import check_for_display, warn_of_depths
from lippmann.motion.layer_film import check_keys, load_layer_film


@make_command("play")
def command(
    film_path: Name = argument("FILM"),
    display: Display = DISPLAY,
    repeat: int = option("Number of times to play; 0 plays until Ctrl-C.", 1, click.IntRange(0)),
    every_frame: bool = option("Wait until the panel shows each frame, for slow virtual boards."),
    force: bool = FORCE_BOARD,
    open_board: OpenBoard = OPEN_BOARD,
) -> int:
    """Play a film of layers, or show a folder of layers, on a board that draws scenes.

    FILM is a film file of layers, or a folder of `lippmann layers`. Missing textures
    are sent to the board first. The last frame stays on the panel.

    Example: lippmann play scenes/films/swim-layers.toml --display
    scenes/displays/vga-square.toml
    """
    film = load_layer_film(film_path)
    check_for_display(film.stack, display, film_path)
    check_keys(film, display, film_path)
    warn_of_depths(film.depths_mm(), display)
    with open_board(None if force else display, "play") as board:
        board.check_no_pattern()
        scene = SceneBoard(board)
        if len(film.stack.layers) > scene.build.layers:
            what = f"has {len(film.stack.layers)} layers, but the board draws {scene.build.layers}"
            raise input_error(film_path, what, f"cut the scene again with lippmann layers --count {scene.build.layers}")
        with progress_bar("loading the layers") as progress:
            loaded, slots = load_textures(scene, display, film, progress, film_path)
        played, code = Played(), 0
        try:
            play_film(scene, display, film, slots, repeat, every_frame, played=played)
        except KeyboardInterrupt:  # the normal way to end --repeat 0
            code = interrupts.exit_code()
    emit({"port": board.line.url, "film": film_path, **vars(played), "load": vars(loaded)}, _text(loaded, played))
    return code


def _text(loaded: Loaded, played: Played) -> Iterator[str]:
    blocks = f"{loaded.blocks - loaded.skipped} of {loaded.blocks} blocks in {loaded.seconds:.3g} s"
    yield f"{blocks}, {played.first_bytes} bytes of registers"
    if played.frames == 1:
        yield f"1 frame; {played.underflows} pixels late"
    else:
        size = f"{played.bytes} bytes on the line, at most {played.most_bytes} a frame"
        late = f"{played.late} frames late, {played.underflows} pixels late"
        yield f"{played.frames} frames in {played.seconds:.4g} s, {size}; {late}"

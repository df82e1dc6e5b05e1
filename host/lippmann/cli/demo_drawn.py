"""The demo's second half: a board draws two films of layers, and an eye that moves looks at its panel."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from lippmann import api
from lippmann.base.animation import write_animation
from lippmann.base.progress import report_each
from lippmann.base.tones import decode
from lippmann.board.virtual_loop import draw_on_virtual_board
from lippmann.cli.output import log
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import load_display
from lippmann.eye.observer import whole_window
from lippmann.fixed.scene_build import SceneBuild
from lippmann.motion.layer_film import load_layer_film
from lippmann.rendering.integral_image import IntegralImage

#: What is drawn, by the name of its results: a film of layers, and a folder of layers, which stands still.
FILMS = {"fish": "films/swim-layers.toml", "chart": "layers/chart"}
DISPLAY = "displays/vga-square.toml"
EYE_DISTANCE_MM = 600.0
#: Travel of the eye to each side, mm.
REACH_MM = 30.0
#: Views of a film that stands still; of another one each frame is seen once.
STILL_VIEWS = 16
VIEW_WIDTH_PX = 400


def draw_films(scenes: Path, out: Path, device: str) -> dict[str, dict[str, Any]]:
    """Have a virtual board draw the films, and write an animation of each, `drawn-NAME.gif`; return their figures.

    `scenes` is the folder of the scenes that ship, `out` that of the results.
    """
    display, build = load_display(scenes / DISPLAY), SceneBuild()
    window = whole_window(display, VIEW_WIDTH_PX)
    log("starting a virtual board that draws (compiled once, half a minute) ...")
    results = {}
    for name, path in FILMS.items():
        film = load_layer_film(scenes / path)
        with progress_bar(f"draw the {name}") as progress:
            loop = draw_on_virtual_board(display, film, build, progress)
        panels = [
            IntegralImage(decode(frame / np.float32(255.0), display.panel.transfer), display) for frame in loop.frames
        ]
        count = len(panels) if film.frames > 1 else STILL_VIEWS
        with progress_bar("observe") as progress:
            views = [
                api.observe(panels[k % len(panels)], _eye(k / count), window=window, device=device).radiance
                for k in report_each(range(count), progress)
            ]
        write_animation(out / f"drawn-{name}.gif", views, there_and_back=False)
        results[name] = {
            "frames": loop.played.frames,
            "pixels": len(panels) * display.panel.width_px * display.panel.height_px,
            "pixels_differ": loop.pixels_differ,
            "underflows": loop.played.underflows,
            "load_bytes": loop.loaded.wire_bytes,
            "bytes": loop.played.bytes,
            "most_bytes": loop.played.most_bytes,
        }
    return results


def _eye(turn: float) -> tuple[float, float, float]:
    """Return the place of an eye that goes from the left to the right and back in a turn, mm."""
    return -REACH_MM * math.cos(2.0 * math.pi * turn), 0.0, EYE_DISTANCE_MM

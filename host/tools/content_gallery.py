"""Scenes in other tools' files on a display: a picture of each kind, and the eye's view against the scene itself."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.base.images import Radiance, read_picture
from lippmann.base.tones import psnr_db
from lippmann.display.description import Display, load_display
from lippmann.eye.many_views import eyes_of
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.rendering.integral import RenderOptions, render_image
from lippmann.rendering.renderer import Settings
from lippmann.scenes.arrange import arranged
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Scene, load_scene

from tools.content_files import (
    Surface,
    write_depth_picture,
    write_meshes,
    write_quilt,
    write_splats,
    write_views,
)

#: Displays of the measurement and of the gallery.
DISPLAY, GALLERY = "vga-square", "paper-square"
#: Numbers of views that are compared, across and up.
VIEWS = ((4, 1), (8, 1), (16, 1), (32, 1), (64, 1), (8, 5), (16, 9))
#: Eyes that look, mm: in the middle, and aside by as much in x, y, and both.
EYES_MM = {"middle": (0.0, 0.0), "beside": (22.0, 0.0), "above": (0.0, 22.0), "corner": (22.0, 22.0)}
EYE_MM, EYE_SAMPLES, SAMPLES = 600.0, 64, 16
#: mm for each unit of the fish, for the small display.
SCALE = 0.25
#: Columns of the gallery's quilt.
COLUMNS = 8


def measure(folder: Path, scratch: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Measure views and a picture with depths of the fish against the fish.

    Columns: `source`, `across`, `down`, and the PSNR (dB) of the view of each eye of `EYES_MM`.
    """
    display = load_display(folder / f"displays/{DISPLAY}.toml")
    scene = load_scene(folder / "fish/fish.xml", Placement(SCALE))
    wanted = _seen(scene, display, seed)
    for across, down in VIEWS:
        made = write_views(scene, display, scratch / f"views-{across}x{down}", across, down, seed=seed)
        yield {"source": "views", "across": across, "down": down, **_decibels(made, display, wanted, seed)}
    made = write_depth_picture(scene, display, scratch, seed=seed)
    yield {"source": "depth picture", "across": 1, "down": 1, **_decibels(made, display, wanted, seed)}
    yield {"source": "the scene, another seed", "across": None, "down": None,
           **_apart(_seen(scene, display, seed + 1), wanted)}  # fmt: skip


def _seen(scene: Scene, display: Display, seed: int) -> dict[str, Radiance]:
    """Return what each eye sees of a scene on a display."""
    image = render_image(scene, display, RenderOptions(model="exact", settings=Settings(SAMPLES, seed=seed)))
    window = whole_window(display)
    return {
        name: observe(image.radiance, display, Eye((*place, EYE_MM)), window, EYE_SAMPLES).radiance
        for name, place in EYES_MM.items()
    }


def _decibels(path: Path, display: Display, wanted: dict[str, Radiance], seed: int) -> dict[str, float]:
    return _apart(_seen(_placed(path, display), display, seed), wanted)


def _apart(seen: dict[str, Radiance], wanted: dict[str, Radiance]) -> dict[str, float]:
    return {f"{name}_db": psnr_db(seen[name], view) for name, view in wanted.items()}


def _placed(path: Path, display: Display) -> Scene:
    scene = load_scene(path)
    return scene if scene.usual is None else arranged(scene, display, scene.usual)


def gallery(folder: Path, scratch: Path, seed: int) -> tuple[list[Radiance], list[str]]:
    """Return what an eye sees of each kind of content, and captions."""
    display = load_display(folder / f"displays/{GALLERY}.toml")
    knot = Surface.read(folder / "knot/knot.ply", folder / "knot/skin.png")
    fish = load_scene(folder / "fish/fish.xml")
    paths = [*write_meshes(knot, scratch), write_splats(knot, scratch / "splats.ply", seed)]
    views = write_views(fish, display, scratch / "views", 2 * COLUMNS, seed=seed)
    eyes = eyes_of(display, 2 * COLUMNS)
    window = whole_window(display)
    pictures = [read_picture(views / f"{number}.exr").radiance for number in range(len(eyes))]
    paths += [views, write_quilt(pictures, (window.width_mm, window.height_mm), eyes, scratch / "quilt.png", COLUMNS)]
    paths += [write_depth_picture(fish, display, scratch, seed=seed)]
    found, captions = [], []
    for path in paths:
        image = render_image(
            _placed(path, display), display, RenderOptions(model="pinhole", settings=Settings(4, seed=seed))
        )
        # One pixel for each lenslet, magnified.
        seen = observe(image.radiance, display, Eye((10.0, 5.0, EYE_MM)), window, 16).radiance
        found.append(np.kron(seen, np.ones((2, 2, 1), np.float32)))
        captions.append(path.name + "/" * path.is_dir())
    return found, captions

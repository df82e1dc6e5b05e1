"""`lippmann export quilt`, `views`, `focal-stack` and `depth`: what eyes see, as files of other tools."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from lippmann.base.files import make_folder, replacing
from lippmann.base.images import SUFFIXES, check_output, write_picture
from lippmann.base.progress import report_each
from lippmann.base.variant import start_mitsuba
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.observe import MAX_VIEW_PX
from lippmann.cli.options.common import DEVICE, DISPLAY, SEED, Finite, Point, Vector
from lippmann.cli.options.rendering import MOVED, Moved
from lippmann.cli.output import emit, log
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import Display, load_display
from lippmann.errors import InputError, input_error
from lippmann.eye.many_views import Sight, eyes_of, focus_depths, of_image, of_scene
from lippmann.eye.observer import Eye, whole_window
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.renderer import BASE_MEMORY_MB, MAX_SAMPLES, Settings, check_memory_mb, first_depths
from lippmann.rendering.sources import Window
from lippmann.scenes.arrange import load_placed
from lippmann.scenes.quilts import eyes_note, quilt_path, tiled
from lippmann.scenes.scene import Scene, check_scene_file
from lippmann.scenes.window_views import EYES, eyes_text


@dataclass(frozen=True)
class _Seen:
    """What is looked at: a scene, or the display that shows an image."""

    display: Display
    window: Window
    sight: Sight
    scene: Scene | None

    @property
    def middle(self) -> Point:
        """The middle eye, mm."""
        return eyes_of(self.display, 1)[0]


def _seen(
    source: str = argument("SOURCE"),
    display_path: str = DISPLAY,
    width: int = option("Width of a view, pixels.", 400, click.IntRange(1, MAX_VIEW_PX)),
    samples: int = option("Rays for each pixel of a view.", 16, click.IntRange(1, MAX_SAMPLES)),
    moved: Moved = MOVED,
    seed: int = SEED,
    device: str = DEVICE,
) -> _Seen:
    display = load_display(display_path)
    window = whole_window(display, width)
    if window.height_px > MAX_VIEW_PX:
        raise InputError(f"the views would be {window.height_px} pixels high; give a smaller --width")
    if Path(source).suffix.lower() in SUFFIXES:
        for name in moved.given:
            raise InputError(f"--{name.replace('_', '-')} is for scenes; leave it out with an image")
        image = IntegralImage.load(source, display)
        start_mitsuba(device)
        return _Seen(display, window, of_image(image, window, samples, seed), None)
    path = check_scene_file(source)
    start_mitsuba(device)
    scene = load_placed(path, display, moved.placement(path), moved.arrange(path), log)
    return _Seen(display, window, of_scene(scene, window, Settings(samples=samples, seed=seed)), scene)


#: The options of all views.
SEEN: Any = _seen
CONE = option(
    "Angle between the outermost eyes, degrees.  [default: the viewing zone]", None, Finite(0.0), flag="--cone"
)
DISTANCE = option("Distance of the eyes, mm.  [default: the display's]", None, Finite(0.0), flag="--distance")
MAX_VIEWS = 100
TILES = click.IntRange(1, MAX_VIEWS)


@make_command("quilt")
def quilt(
    seen: _Seen = SEEN,
    output: str = option("The quilt; the tiling is added to its name.", flag="-o", metavar="FILE.png"),
    columns: int = option("Views across.", 8, TILES),
    rows: int = option("Views up.", 6, TILES),
    cone: float | None = CONE,
    distance: float | None = DISTANCE,
) -> None:
    """Write a quilt, as Looking Glass displays and their tools read it: NAME_qs8x6a0.75.png.

    SOURCE is a scene, or an integral image, whose views are those through the display's lenslets. The first view, of
    the leftmost eye, is at the bottom left, the last one at the top right.

    Example: lippmann export quilt scenes/fish/fish.xml --display scenes/displays/vga-square.toml -o fish.png
    """
    window = seen.window
    path = check_output(quilt_path(Path(output), columns, rows, window.width_px / window.height_px))
    eyes = [Eye(at) for at in eyes_of(seen.display, columns * rows, 1, cone, distance)]
    check_memory_mb(
        BASE_MEMORY_MB + len(eyes) * window.width_px * window.height_px * 12 / 1e6,
        None,
        f"{len(eyes)} views of {window.width_px} x {window.height_px} pixels",
        "give a smaller --width or fewer views",
    )
    with progress_bar("views") as progress:
        picture = tiled(map(seen.sight, report_each(eyes, progress)), columns, rows)
    note = eyes_note((window.width_mm, window.height_mm), [eye.position_mm for eye in eyes])
    write_picture(path, picture, {"quilt": f"{columns}x{rows}", "display": seen.display.name, **note})
    result = {
        "output": str(path), "columns": columns, "rows": rows, "aspect": window.width_px / window.height_px,
        "width_px": picture.shape[1], "height_px": picture.shape[0], "view_width_px": window.width_px,
        "view_height_px": window.height_px, "eyes_mm": [list(eye.position_mm) for eye in eyes],
    }  # fmt: skip
    emit(result, f"{path}: {columns * rows} views of {window.width_px} x {window.height_px} pixels")


@make_command("views")
def views(
    seen: _Seen = SEEN,
    output: str = option("The views' folder; made when missing.", flag="-o", metavar="FOLDER"),
    across: int = option("Eyes from left to right.", 9, TILES),
    down: int = option("Rows of eyes, from the bottom.", 1, TILES),
    cone: float | None = CONE,
    distance: float | None = DISTANCE,
    linear: bool = option("EXR files of linear light instead of PNG.", False),
) -> None:
    """Write the views of a scene or an integral image, a file each, and views.json with their eyes.

    Example: lippmann export views fish.exr --display scenes/displays/paper-square.toml -o out/views
    """
    eyes = [Eye(at) for at in eyes_of(seen.display, across, down, cone, distance)]
    names = _write_folder(seen, eyes, Path(output), "view", linear)
    window = seen.window
    text = eyes_text(
        (window.width_mm, window.height_mm), names, [eye.position_mm for eye in eyes], width_px=window.width_px,
        height_px=window.height_px, across=across, down=down,
    )  # fmt: skip
    with replacing(Path(output) / EYES) as partial:
        partial.write_text(text)
    emit(
        {"folder": output, **json.loads(text)},
        f"{output}: {len(eyes)} views of {window.width_px} x {window.height_px} pixels",
    )


@make_command("focal-stack")
def focal_stack(
    seen: _Seen = SEEN,
    output: str = option("The pictures' folder; made when missing.", flag="-o", metavar="FOLDER"),
    eye: Point | None = option("Position of the eye, mm.  [default: the middle one]", None, Vector(3)),
    pupil: float = option("Diameter of its pupil, mm; a camera's lens is wider than an eye's.", 10.0, Finite(0.0)),
    depths: str | None = option("Depths z in focus, mm.  [default: five through the scene]", None, metavar="Z,Z,..."),
    count: int = option("Number of depths through the scene.", 5, TILES),
    linear: bool = option("EXR files of linear light instead of PNG.", False),
) -> None:
    """Write what one eye with a wide pupil sees, focused at one depth after the other, a file each.

    Example: lippmann export focal-stack scenes/fish/fish.xml --display scenes/displays/vga-square.toml -o out/focus
    """
    at = seen.middle if eye is None else eye
    if depths is not None:
        focus = list(_numbers("--depths", depths))
    elif seen.scene is not None:
        focus = focus_depths(seen.scene.depth_range_mm, count)
    else:
        raise InputError("an image does not tell the depths of its scene; give --depths")
    eyes = [Eye(at, pupil, z) for z in focus]
    names = _write_folder(seen, eyes, Path(output), "focus", linear)
    told = [{"file": name, "focus_mm": z} for name, z in zip(names, focus, strict=True)]
    emit(
        {"folder": output, "eye_mm": list(at), "pupil_mm": pupil, "pictures": told},
        [f"{output}: {len(eyes)} pictures, in focus at {', '.join(f'{z:.4g}' for z in focus)} mm"],
    )


@make_command("depth")
def depth(
    seen: _Seen = SEEN,
    output: str = option("Depths z: .tif in mm, or .png in 16 bits, the farthest 0.", flag="-o", metavar="FILE"),
    eye: Point | None = option("Position of the eye, mm.  [default: the middle one]", None, Vector(3)),
) -> None:
    """Write how far away a scene is in each pixel of an eye's view.

    Pixels without a surface are as far as the farthest.

    Example: lippmann export depth scenes/fish/fish.xml --display scenes/displays/vga-square.toml -o depth.tif
    """
    path = check_output(output, (".tif", ".tiff", ".png"))
    if seen.scene is None:
        raise InputError("an integral image does not tell depths; give the scene")
    at = Eye(seen.middle if eye is None else eye).position_mm
    found = first_depths(seen.scene, at, seen.window)
    there = np.isfinite(found)
    if not there.any():
        raise InputError("the eye sees no surface; give another --eye")
    far, near = float(found[there].min()), float(found[there].max())
    found[~there] = far
    told = {"depth": "z, mm, towards the viewer", "far_mm": repr(far), "near_mm": repr(near)}
    is_png = path.suffix.lower() == ".png"
    values = (found - far) / max(near - far, 1e-9) if is_png else found
    write_picture(path, np.repeat(values[..., None], 3, axis=2), told, "linear", 16)
    empty = float(1.0 - there.mean())
    result = {"output": str(path), "eye_mm": list(at), "far_mm": far, "near_mm": near, "empty_share": empty}
    emit(result, f"{path}: depths from {far:.4g} to {near:.4g} mm; {100 * empty:.1f} % of the pixels see no surface")


def _numbers(where: str, text: str) -> tuple[float, ...]:
    """Return the numbers of a list with commas."""
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if not found or not np.isfinite(found).all() or len(found) > MAX_VIEWS:
        raise InputError(f"{where}: '{text[:80]}' is no list of numbers; give such as -20,0,20")
    return found


def _write_folder(seen: _Seen, eyes: Sequence[Eye], folder: Path, stem: str, linear: bool) -> list[str]:
    """Write what eyes see into a folder, a file each; return their names. InputError when it holds others."""
    make_folder(folder, "choose another place with -o")
    names = [f"{stem}_{k:04d}.{'exr' if linear else 'png'}" for k in range(len(eyes))]
    others = sorted({path.name for path in folder.glob(f"{stem}_[0-9][0-9][0-9][0-9].*")} - set(names))
    if others:
        raise input_error(
            str(folder), f"holds {others[0]} of another export", "choose another -o, or remove the folder"
        )
    with progress_bar("views") as progress:
        for name, eye in zip(names, report_each(eyes, progress), strict=True):
            write_picture(folder / name, seen.sight(eye), {})
    return names

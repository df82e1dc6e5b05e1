"""Commands `lippmann export`."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from lippmann.base.files import make_folder, write_file
from lippmann.base.images import SUFFIXES, check_output, write_picture
from lippmann.base.variant import start_mitsuba
from lippmann.capturing.capture import check_placement, placement_before
from lippmann.capturing.capture_setup import load_setup
from lippmann.capturing.povray_export import POVRAY, export_display, write_folder
from lippmann.capturing.povray_optics import setup_view
from lippmann.cli.frame import Folder, Name, argument, flag_of, make_command, option
from lippmann.cli.observe import MAX_VIEW_PX
from lippmann.cli.options import DEVICE, DISPLAY, FOLDER, MAX_NUMBERS, SEED, Point, finite, vector
from lippmann.cli.options_rendering import MOVED, Moved
from lippmann.cli.output import emit
from lippmann.cli.progress_bar import with_progress
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error
from lippmann.eye.many_views import Viewer, eyes_of, focus_depths, image_viewer, scene_viewer
from lippmann.eye.observer import Eye, whole_window
from lippmann.optics.rays import Model
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.memory_estimate import BASE_MEMORY_MB, check_memory_mb
from lippmann.rendering.options import MAX_SAMPLES, Settings
from lippmann.rendering.sampling import Window, first_depths
from lippmann.scenes.formats import kind_of
from lippmann.scenes.quilts_and_views import EYES, eyes_note, eyes_text, quilt_path, tiled
from lippmann.scenes.scene import Scene, check_scene_file, load_scene


@click.group("export")
def command() -> None:
    """Write scenes and images in the formats of other tools.

    Example: lippmann export quilt scenes/fish/fish.xml --display
    scenes/displays/vga-square.toml -o fish.png
    """


@make_command("povray", command)
def povray(
    scene_path: Name = argument("SCENE"),
    display: Display | None = option("Display file (.toml); export the rays of its pixels."),
    setup_path: Path | None = option("Set-up file (.toml); export its camera and lenses."),
    output: Folder = FOLDER,
    model: Model | None = option("Lens model for the rays of --display.  [default: exact]"),
    device: str = DEVICE,
) -> None:
    """Write files from which POV-Ray 3.7 renders linear images.

    With --setup, the optics become objects in POV-Ray's scene; POV-Ray renders the
    image of `lippmann capture --no-rotate`. With --display, POV-Ray traces one ray per
    pixel.

    docs/reference/povray.md lists the scene elements that can be exported; other
    elements cause an error.

    Example: lippmann export povray scenes/fish/fish.xml --setup
    scenes/setups/fig8a.toml -o out/pov
    """
    if (display is None) == (setup_path is None):
        raise InputError("give either --display or --setup")
    if model and setup_path:
        raise InputError("--model is for --display; leave it out with --setup")
    path = check_scene_file(scene_path)
    make_folder(output, "choose another folder with -o")
    if kind_of(path) != "mitsuba":
        raise input_error(scene_path, "is not a Mitsuba scene", "give a Mitsuba .xml file")
    if setup_path:
        setup = load_setup(setup_path)
        view, panel = setup_view(setup), setup.display.panel
        start_mitsuba(device)
        scene = load_scene(path, placement_before(setup, path, setup_path))
        check_placement(scene, setup)
        exported = write_folder(scene, view, output)
    else:
        assert display is not None
        panel = display.panel
        start_mitsuba(device)
        exported = export_display(load_scene(path), display, model or "exact", output)
    program = POVRAY.find()
    size = {"width_px": panel.width_px, "height_px": panel.height_px}
    result = {"folder": output, **vars(exported), **size, "povray": program}
    line = f"cd {shlex.quote(str(output))} && povray {exported.ini.name}"
    lines = [f"{output}: {len(exported.files)} files; render: {line}"]
    if exported.spare_rows:
        lines.append(f"POV-Ray's image has {exported.spare_rows} row more than the panel: remove its top row")
    if program is None:
        lines.append(f"POV-Ray is not installed; {POVRAY.remedy}")
    emit(result, lines)


@dataclass(frozen=True)
class _Subject:
    """A scene or a displayed image, with a function that computes its views."""

    display: Display
    window: Window
    view_from: Viewer
    scene: Scene | None

    def place(self, eye: Point | None) -> Point:
        """Return `eye`, mm; None gives the middle eye's position."""
        return eyes_of(self.display, 1)[0] if eye is None else eye


def _subject(
    source: Name = argument("SOURCE"),
    display: Display = DISPLAY,
    width: int = option("Width of a view, pixels.", 400, click.IntRange(1, MAX_VIEW_PX)),
    samples: int = option("Rays per pixel.", 16, click.IntRange(1, MAX_SAMPLES)),
    moved: Moved = MOVED,
    seed: int = SEED,
    device: str = DEVICE,
) -> _Subject:
    window = whole_window(display, width)
    if window.height_px > MAX_VIEW_PX:
        raise InputError(f"the views would be {window.height_px} pixels high; give a smaller --width")
    if Path(source).suffix.lower() in SUFFIXES:
        for name in moved.changes:
            raise InputError(f"{flag_of(name)} is for scenes; leave it out with an image")
        image = IntegralImage.load(source, display)
        start_mitsuba(device)
        return _Subject(display, window, image_viewer(image, window, samples, seed), None)
    path = check_scene_file(source)
    start_mitsuba(device)
    scene = moved.load(path, display)
    return _Subject(display, window, scene_viewer(scene, window, Settings(samples=samples, seed=seed)), scene)


SUBJECT: Any = _subject
CONE = option("Angle between the outermost eyes, degrees.  [default: the viewing zone]", kind=finite(0.0))
DISTANCE = option("Distance of the eyes from the display, mm.  [default: the display's]", kind=finite(0.0))
EYE = option("Position of the eye, mm.  [default: the middle of the viewing zone]")
LINEAR = option("Write EXR files of linear light instead of PNG files.")
DEPTHS = vector("Z,Z,...", remedy="give a list of numbers such as -20,0,20")
TILES = click.IntRange(1, MAX_NUMBERS)


@make_command("quilt", command)
def quilt(
    subject: _Subject = SUBJECT,
    output: Path = option("Quilt file (.png, .tif, .exr); the tiling is added to its name."),
    columns: int = option("Number of views from left to right.", 8, TILES),
    rows: int = option("Number of views from bottom to top.", 6, TILES),
    cone: float | None = CONE,
    distance: float | None = DISTANCE,
) -> None:
    """Write a quilt for Looking Glass displays and their tools: NAME_qs8x6a0.75.png.

    SOURCE is a scene, or an integral image that is seen through the lenslets. The view
    of the leftmost eye is at the bottom left.

    Example: lippmann export quilt scenes/fish/fish.xml --display
    scenes/displays/vga-square.toml -o fish.png
    """
    window = subject.window
    aspect = window.width_px / window.height_px
    path = check_output(quilt_path(output, columns, rows, aspect))
    places = eyes_of(subject.display, columns * rows, 1, cone, distance)
    text = f"{len(places)} views of {window.width_px} x {window.height_px} pixels"
    needed_mb = BASE_MEMORY_MB + len(places) * window.width_px * window.height_px * 12 / 1e6
    check_memory_mb(needed_mb, None, text, "give a smaller --width or fewer views")
    eyes = [Eye(place) for place in places]
    picture = tiled(map(subject.view_from, with_progress("views", eyes)), columns, rows)
    metadata = eyes_note((window.width_mm, window.height_mm), places)
    write_picture(path, picture, {"quilt": f"{columns}x{rows}", "display": subject.display.name, **metadata})
    result = {
        "output": path,
        "columns": columns,
        "rows": rows,
        "aspect": aspect,
        "width_px": picture.shape[1],
        "height_px": picture.shape[0],
        "view_width_px": window.width_px,
        "view_height_px": window.height_px,
        "eyes_mm": places,
    }
    emit(result, f"{path}: {text}")


@make_command("views", command)
def views(
    subject: _Subject = SUBJECT,
    output: Folder = FOLDER,
    across: int = option("Number of eyes from left to right.", 9, TILES),
    down: int = option("Number of eyes from bottom to top.", 1, TILES),
    cone: float | None = CONE,
    distance: float | None = DISTANCE,
    linear: bool = LINEAR,
) -> None:
    """Write each view of a scene or image to a file, and the eye positions to views.json.

    Example: lippmann export views fish.exr --display scenes/displays/paper-square.toml
    -o out/views
    """
    places, window = eyes_of(subject.display, across, down, cone, distance), subject.window
    names = _write_folder(subject, [Eye(place) for place in places], output, "view", linear)
    counts = {"width_px": window.width_px, "height_px": window.height_px, "across": across, "down": down}
    text = eyes_text((window.width_mm, window.height_mm), names, places, **counts)
    write_file(output / EYES, text)
    summary = f"{output}: {len(places)} views of {window.width_px} x {window.height_px} pixels"
    emit({"folder": output, **json.loads(text)}, summary)


@make_command("focal-stack", command)
def focal_stack(
    subject: _Subject = SUBJECT,
    output: Folder = FOLDER,
    eye: Point | None = EYE,
    pupil: float = option("Diameter of the pupil or of a camera lens, mm.", 10.0, finite(0.0)),
    depths: tuple[float, ...] | None = option(
        "Depths z in focus, mm.  [default: five depths in the scene]", kind=DEPTHS
    ),
    count: int = option("Number of depths, if --depths is missing.", 5, TILES),
    linear: bool = LINEAR,
) -> None:
    """Write views of an eye with a wide pupil, one file for each depth in focus.

    Example: lippmann export focal-stack scenes/fish/fish.xml --display
    scenes/displays/vga-square.toml -o out/focus
    """
    at = subject.place(eye)
    if depths is not None:
        focus = list(depths)
    elif subject.scene is not None:
        focus = focus_depths(subject.scene.depth_range_mm, count)
    else:
        raise InputError("an image contains no depths; give --depths")
    eyes = [Eye(at, pupil, z) for z in focus]
    names = _write_folder(subject, eyes, output, "focus", linear)
    pictures = [{"file": name, "focus_mm": z} for name, z in zip(names, focus, strict=True)]
    result = {"folder": output, "eye_mm": list(at), "pupil_mm": pupil, "pictures": pictures}
    emit(result, f"{output}: {len(eyes)} pictures, in focus at {', '.join(f'{z:.4g}' for z in focus)} mm")


@make_command("depth", command)
def depth(
    subject: _Subject = SUBJECT,
    output: Path = option("Depth file: .tif in mm, or 16-bit .png with 0 for the farthest depth."),
    eye: Point | None = EYE,
) -> None:
    """Write the depth z of a scene at each pixel of an eye's view.

    Pixels without a surface get the farthest depth.

    Example: lippmann export depth scenes/fish/fish.xml --display
    scenes/displays/vga-square.toml -o depth.tif
    """
    path = check_output(output, (".tif", ".tiff", ".png"))
    if subject.scene is None:
        raise InputError("an integral image contains no depths; give the scene")
    at = Eye(subject.place(eye)).position_mm
    depths = first_depths(subject.scene, at, subject.window)
    hit = np.isfinite(depths)
    if not hit.any():
        raise InputError("the eye sees no surface; give another --eye")
    far, near = float(depths[hit].min()), float(depths[hit].max())
    depths[~hit] = far
    metadata = {"depth": "z, mm, towards the viewer", "far_mm": repr(far), "near_mm": repr(near)}
    is_png = path.suffix.lower() == ".png"
    values = (depths - far) / max(near - far, 1e-9) if is_png else depths
    write_picture(path, np.repeat(values[..., None], 3, axis=2), metadata, "linear", 16)
    empty = float(1.0 - hit.mean())
    result = {"output": path, "eye_mm": list(at), "far_mm": far, "near_mm": near, "empty_share": empty}
    emit(result, f"{path}: depths from {far:.4g} to {near:.4g} mm; {100 * empty:.1f} % of the pixels see no surface")


def _write_folder(subject: _Subject, eyes: list[Eye], folder: Path, stem: str, linear: bool) -> list[str]:
    make_folder(folder, "choose another folder with -o")
    names = [f"{stem}_{k:04d}.{'exr' if linear else 'png'}" for k in range(len(eyes))]
    others = sorted({path.name for path in folder.glob(f"{stem}_[0-9][0-9][0-9][0-9].*")} - set(names))
    if others:
        raise input_error(folder, f"contains {others[0]} of another export", "choose another folder with -o")
    for name, eye in zip(names, with_progress("views", eyes), strict=True):
        write_picture(folder / name, subject.view_from(eye), {})
    return names

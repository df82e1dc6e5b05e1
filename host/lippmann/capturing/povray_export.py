"""Writes a folder of files that POV-Ray 3.7 renders to a linear OpenEXR image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lippmann.base import interrupts
from lippmann.base.files import make_folder, moved, not_written, partial_folder
from lippmann.capturing.povray_scene import write_scene
from lippmann.capturing.povray_text import SPARE_ROWS, plain, write_rays
from lippmann.display.description import Display
from lippmann.engines import trace
from lippmann.errors import InputError, input_error
from lippmann.optics.rays import Floats, Model, gets_through
from lippmann.scenes.scene import Scene
from lippmann.simulation.toolchain import Tool

POVRAY = Tool("povray", "renders what `export povray` writes", "run sudo apt-get install -y povray, or see povray.org")
#: Maximum pixels of a display export, which writes a triangle for each.
MAX_RAYS = 1 << 20
#: Maximum scene surfaces that a ray meets, as in `lippmann render`.
MAX_DEPTH = 4

HEADER = """#version 3.7;
// Written by lippmann export povray. Render it with: povray {name}.ini
global_settings {{ assumed_gamma 1.0 max_trace_level {levels} adc_bailout 0 }}
"""


@dataclass(frozen=True)
class Exported:
    """An exported folder: the path of POV-Ray's .ini file, and the names of all files."""

    ini: Path
    files: tuple[str, ...]
    #: Surplus rows at the top of POV-Ray's image.
    spare_rows: int = 0


@dataclass(frozen=True)
class View:
    """Camera and optics as POV-Ray text, and the image's size in pixels."""

    camera: str
    width_px: int
    height_px: int
    optics: str = ""
    #: Maximum refracting faces that a ray meets in the optics.
    faces: int = 0
    #: Origins (mm) and unit directions, (N, 3) each, of one ray per pixel, or None.
    rays: tuple[Floats, Floats] | None = None


def write_folder(scene: Scene, view: View, folder: Path) -> Exported:
    """Write all files, or none, to `folder`, which is created if missing.

    Raises InputError for a scene that POV-Ray cannot express, and errors of `not_written`.
    """
    make_folder(folder.parent)
    name = plain(scene.path.stem)
    spare_rows = 0 if view.rays is None else SPARE_ROWS
    try:
        with partial_folder(folder) as partial:
            write_scene(scene.path, scene.placement, partial)
            if view.rays is not None:
                write_rays(partial / "rays.inc", *view.rays)
            parts = {file: text for file, text in (("camera.inc", view.camera), ("optics.inc", view.optics)) if text}
            for file, text in parts.items():
                (partial / file).write_text(text + "\n")
            head = HEADER.format(name=name, levels=MAX_DEPTH + view.faces)
            head += "".join(f'#include "{file}"\n' for file in (*parts, "scene.inc"))
            (partial / f"{name}.pov").write_text(head)
            (partial / f"{name}.ini").write_text(
                f"Input_File_Name={name}.pov\nOutput_File_Name={name}.exr\nOutput_File_Type=E\n"
                f"Width={view.width_px}\nHeight={view.height_px + spare_rows}\n"
                "Antialias=off\nDisplay=off\nPause_When_Done=off\n"
            )
            files = sorted(file.name for file in partial.iterdir())
            for file in files:
                if (folder / file).is_dir():
                    raise input_error(folder / file, "is a folder", "choose another folder for the export")
            folder.mkdir(exist_ok=True)
            with interrupts.hold_signals():
                for file in files:
                    moved(partial / file, folder / file)
    except OSError as error:
        raise not_written(folder, error) from None
    return Exported(folder / f"{name}.ini", tuple(files), spare_rows)


def export_display(scene: Scene, display: Display, model: Model, folder: Path) -> Exported:
    """Write the scene, and a camera whose rays are the golden engine's exit rays, one per pixel.

    POV-Ray traces rays from in front of the scene to the display. Raises InputError for
    sub-pixels, too many pixels, and scene parts that POV-Ray cannot express.
    """
    panel, name = display.panel, f"display '{display.name}'"
    if panel.subpixels != "none":
        raise InputError(f"{name} has colour sub-pixels, but the export has one ray per pixel; set subpixels to none")
    if panel.width_px * panel.height_px > MAX_RAYS:
        size = f"{panel.width_px} x {panel.height_px} pixels"
        raise InputError(f"{name} has {size}; give a panel of at most {MAX_RAYS} pixels")
    row, column = np.mgrid[0 : panel.height_px, 0 : panel.width_px]
    rays = trace(display, np.stack([column.ravel() + 0.5, row.ravel() + 0.5], axis=1), None, model)
    _, near = scene.depth_range_mm
    t = (near - rays.origin_mm[:, 2]) / rays.direction[:, 2]
    origin = rays.origin_mm + t[:, None] * rays.direction
    active = gets_through(rays.status)
    # A ray that the lenslets block must be black, so point the ray away from the scene.
    direction = np.where(active[:, None], -rays.direction, [0.0, 0.0, 1.0])
    origin[~active] = (0.0, 0.0, near)
    view = View('#include "rays.inc"', *panel.size_px, rays=(origin, direction))
    return write_folder(scene, view, folder)

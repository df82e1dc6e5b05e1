"""`lippmann export povray`: scene and optics for another ray tracer."""

from __future__ import annotations

import shlex
from pathlib import Path

from lippmann.base.variant import start_mitsuba
from lippmann.capturing.capture import check_placement, placement_before
from lippmann.capturing.povray_export import Exported, check_folder, export_display, write_folder
from lippmann.capturing.povray_optics import setup_view
from lippmann.capturing.povray_program import POVRAY
from lippmann.capturing.setup import load_setup
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.options.common import DEVICE
from lippmann.cli.output import emit
from lippmann.display.description import load_display
from lippmann.errors import InputError, input_error
from lippmann.optics.rays import Model
from lippmann.scenes.formats import kind_of
from lippmann.scenes.scene import check_scene_file, load_scene


@make_command("povray")
def povray(
    scene_path: str = argument("SCENE"),
    display_path: str | None = option(
        "Display file (.toml): the rays of its pixels.", None, flag="--display", metavar="FILE"
    ),
    setup_path: str | None = option(
        "Set-up file (.toml): camera, lenslets and imaging lens.", None, flag="--setup", metavar="FILE"
    ),
    output: str = option("The files' folder; made when missing.", flag="-o", metavar="FOLDER"),
    model: Model | None = option("Lens model of a display's rays.  [default: exact]", None),
    device: str = DEVICE,
) -> None:
    """Write files that POV-Ray 3.7 renders to linear images.

    With a set-up, its camera, lenslets and imaging lens are objects in POV-Ray's scene, which renders the image of
    `lippmann capture --no-rotate`. With a display, POV-Ray traces one ray for each of its pixels.

    A scene may contain spheres, rectangles, ply and obj meshes; diffuse, plastic, mirror and dielectric materials;
    bitmaps; point lights. Anything else is an error.

    Example: lippmann export povray scenes/fish/fish.xml --setup scenes/setups/fig8a.toml -o out/pov
    """
    if (display_path is None) == (setup_path is None):
        raise InputError("give one of --display and --setup, which POV-Ray shall render through")
    if model is not None and setup_path is not None:
        raise InputError("--model is for --display: a set-up's lenslets are objects in POV-Ray's scene; leave it out")
    folder = check_folder(Path(output))
    path = check_scene_file(scene_path)
    if kind_of(path) != "mitsuba":
        raise input_error(scene_path, "is no Mitsuba scene", "give an .xml: POV-Ray's export takes only those")
    exported: Exported
    if setup_path is not None:
        setup = load_setup(setup_path)
        view = setup_view(setup)
        panel = setup.display.panel
        start_mitsuba(device)
        scene = load_scene(path, placement_before(setup, path, setup_path))
        check_placement(scene, setup)
        exported = write_folder(scene, view, folder)
    else:
        assert display_path is not None
        display = load_display(display_path)
        panel = display.panel
        start_mitsuba(device)
        exported = export_display(load_scene(path), display, model or "exact", folder)
    at = POVRAY.find()
    result = {
        "folder": str(folder),
        "ini": str(exported.ini),
        "files": list(exported.files),
        "width_px": panel.width_px,
        "height_px": panel.height_px,
        "spare_rows": exported.spare_rows,
        "povray": None if at is None else str(at),
    }

    lines = [f"{folder}: {len(exported.files)} files; render: cd {shlex.quote(output)} && povray {exported.ini.name}"]
    if exported.spare_rows:
        lines.append(f"POV-Ray's image has {exported.spare_rows} row more than the panel: remove the top row")
    if at is None:
        lines.append(f"POV-Ray is not installed; {POVRAY.remedy}")
    emit(result, lines)

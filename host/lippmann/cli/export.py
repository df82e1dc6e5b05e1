"""`lippmann export`: scenes and optics for other people's ray tracers."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import click

from lippmann.cli.common import device_option, display_option, emit, json_option
from lippmann.display import load_display
from lippmann.optics.trace import MODELS, Model
from lippmann.povray.export import check_folder, export_display
from lippmann.povray.program import POVRAY
from lippmann.render.scene import check_scene_file, load_scene
from lippmann.render.variant import start_mitsuba


@click.group("export")
def command() -> None:
    """Write scene and optics for another ray tracer.

    Example: lippmann export povray scenes/fish/fish.xml --display scenes/displays/vga-square.toml -o out/pov
    """


@command.command("povray")
@click.argument("scene_path", metavar="SCENE")
@display_option
@click.option("-o", "output", required=True, metavar="FOLDER", help="Where the files go; made when missing.")
@click.option(
    "--model", type=click.Choice(MODELS), default="exact", show_default=True, help="Lens model of a display's rays."
)
@device_option
@json_option
def povray(scene_path: str, display_path: str, output: str, model: str, device: str, as_json: bool) -> None:
    """Write files that POV-Ray 3.7 renders, linear as Lippmann renders.

    With a display, POV-Ray follows the rays of its pixels, one each. What a scene may hold: spheres, rectangles, ply
    and obj meshes; diffuse, plastic, mirror and dielectric; bitmaps; point lights. Anything else is refused by name.

    Example: lippmann export povray scenes/fish/fish.xml --display scenes/displays/vga-square.toml -o out/pov
    """
    folder = check_folder(Path(output))
    display = load_display(display_path)
    check_scene_file(scene_path)
    mi = start_mitsuba(device)
    scene = load_scene(mi, scene_path)
    exported = export_display(mi, scene, display, cast(Model, model), folder)
    result = {
        "folder": str(folder),
        "ini": str(exported.ini),
        "files": exported.files,
        "width_px": display.panel.width_px,
        "height_px": display.panel.height_px,
        "spare_rows": exported.spare_rows,
        "povray": None if POVRAY.find() is None else str(POVRAY.find()),
    }

    def text() -> None:
        click.echo(
            f"{folder}: {len(exported.files)} files; render them with: cd {folder} && povray {exported.ini.name}"
        )
        if exported.spare_rows:
            click.echo(f"the picture has {exported.spare_rows} row more than the panel, on top: take it off")
        if result["povray"] is None:
            click.echo(f"POV-Ray is not here; {POVRAY.remedy}")

    emit(result, as_json, text)

"""`lippmann render`: the integral image of a scene for a display."""

from __future__ import annotations

from typing import Any

import click

from lippmann import api
from lippmann.cli.options.common import device_option, display_option, json_option, seed_option
from lippmann.cli.options.placement import placement_of, placement_options
from lippmann.cli.options.rendering import render_options
from lippmann.cli.output import emit, log, progress_bar
from lippmann.images import check_output
from lippmann.rendering.integral import RenderOptions
from lippmann.rendering.renderer import peak_memory_mb
from lippmann.rendering.scene import check_scene_file
from lippmann.variant import current_device


@click.command("render")
@click.argument("scene_path", metavar="SCENE")
@display_option
@click.option("-o", "output", required=True, metavar="OUT", help=".exr or .tif linear, .png for the panel.")
@render_options
@placement_options
@seed_option
@device_option
@json_option
def command(
    scene_path: str,
    display_path: str,
    output: str,
    options: RenderOptions,
    moved: dict[str, Any],
    device: str,
    as_json: bool,
) -> None:
    """Render the integral image of a Mitsuba scene for a display.

    Example: lippmann render scenes/fish/fish.xml --display scenes/displays/paper-square.toml -o fish.exr
    """
    path = check_output(output)
    placement = placement_of(check_scene_file(scene_path), moved)
    with progress_bar("render", quiet=as_json) as progress:
        image = api.render_with(options, scene_path, display_path, placement, device, progress, log)
    image.save(path)
    display = image.display
    result = {
        "output": str(path),
        "display": display.name,
        "identity": display.identity,
        "width_px": display.panel.width_px,
        "height_px": display.panel.height_px,
        "model": image.metadata["model"],
        "engine": options.engine,
        "integrator": options.settings.integrator,
        "samples": options.settings.samples,
        "seed": options.settings.seed,
        "device": current_device(),
        **image.measured,
        "peak_memory_mb": peak_memory_mb(),
    }

    def text() -> None:
        click.echo(
            f"{path}: {display.panel.width_px} x {display.panel.height_px}, model {image.metadata['model']}, "
            f"{image.measured['seconds']:.2f} s ({image.measured['samples_per_second'] / 1e6:.2f} M samples/s), "
            f"peak memory {peak_memory_mb():.0f} MB"
        )

    emit(result, as_json, text)

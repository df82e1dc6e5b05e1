"""`lippmann render`: a scene and a display file make an integral image."""

from __future__ import annotations

from typing import Any, cast

import click

from lippmann.cli.options.common import device_option, display_option, json_option, seed_option
from lippmann.cli.options.placement import placement_of, placement_options
from lippmann.cli.options.rendering import check_fraction_bits, render_options
from lippmann.cli.output import emit, log, progress_bar
from lippmann.display import Display, load_display
from lippmann.errors import InputError
from lippmann.images import check_output, write_picture
from lippmann.optics.rays import Engine, Model
from lippmann.rendering.metadata import image_metadata
from lippmann.rendering.renderer import Settings, check_memory, peak_memory_mb, render_integral
from lippmann.rendering.scene import Scene, check_scene_file, load_scene
from lippmann.rendering.sources import Aperture
from lippmann.select.model import choose_model
from lippmann.variant import current_device, start_mitsuba

#: Widths of a scene, in widths of the panel, that raise no question.
SIZE_SHARE = (0.02, 1000.0)


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
    model: str,
    tolerance: float,
    engine: Engine,
    fraction_bits: int | None,
    samples: int,
    aperture: str,
    integrator: str,
    max_depth: int,
    memory_mb: float | None,
    seed: int,
    device: str,
    as_json: bool,
    **stand: Any,
) -> None:
    """Render the integral image of a Mitsuba scene for a display.

    Example: lippmann render scenes/fish/fish.xml --display scenes/displays/paper-square.toml -o fish.exr
    """
    path = check_output(output)
    check_fraction_bits(engine, fraction_bits)
    display = load_display(display_path)
    settings = Settings(
        samples=samples,
        aperture=cast(Aperture, aperture),
        integrator=integrator,
        max_depth=max_depth,
        seed=seed,
        memory_mb=memory_mb,
    )
    try:
        check_memory(display.panel.width_px, display.panel.height_px, settings)
    except InputError as error:
        raise InputError(f"{display_path}: panel.width_px, panel.height_px: {error}") from None
    check_scene_file(scene_path)
    placement = placement_of(scene_path, **stand)
    start_mitsuba(device)
    scene = load_scene(scene_path, placement)
    _note_odd_size(scene, display)
    if model == "auto":
        choice = choose_model(display, scene.depth_range_mm, aperture, tolerance)
        log(str(choice))
        chosen = choice.model
    else:
        chosen = cast(Model, model)
    with progress_bar("render", quiet=as_json) as progress:
        rendered = render_integral(scene, display, chosen, settings, progress, engine, fraction_bits)
    write_picture(
        path,
        rendered.radiance,
        image_metadata(display, chosen, settings, scene_path, engine, fraction_bits),
        display.panel.transfer,
        display.panel.bits,
    )
    result = {
        "output": str(path),
        "display": display.name,
        "identity": display.identity,
        "width_px": display.panel.width_px,
        "height_px": display.panel.height_px,
        "model": chosen,
        "engine": engine,
        "integrator": integrator,
        "samples": samples,
        "seed": seed,
        "device": current_device(),
        "seconds": rendered.seconds,
        "prepare_seconds": rendered.prepare_seconds,
        "samples_per_second": rendered.samples_per_second,
        "peak_memory_mb": peak_memory_mb(),
    }

    def text() -> None:
        click.echo(
            f"{path}: {display.panel.width_px} x {display.panel.height_px}, model {chosen}, "
            f"{rendered.seconds:.2f} s ({rendered.samples_per_second / 1e6:.2f} M samples/s), "
            f"peak memory {peak_memory_mb():.0f} MB"
        )

    emit(result, as_json, text)


def _note_odd_size(scene: Scene, display: Display) -> None:
    """Warn of a scene whose size suggests that its units are not what its placement says."""
    width = scene.width_mm
    share = width / display.panel.width_mm
    if width > 0.0 and not SIZE_SHARE[0] <= share <= SIZE_SHARE[1]:
        log(
            f"note: the scene is {width:.3g} mm wide before a panel of {display.panel.width_mm:.4g} mm; "
            "if its units are not millimetres give --scale, such as 1000 for metres"
        )

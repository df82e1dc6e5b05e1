"""`lippmann capture`: a scene through imaging lens and microlens array, as a camera behind them sees it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import click
import numpy as np

from lippmann.capturing.capture import capture, stand_of
from lippmann.capturing.depths import shown
from lippmann.capturing.setup import Pickup, Setup, load_setup
from lippmann.cli.options.common import device_option, json_option, seed_option
from lippmann.cli.output import emit, log, progress_bar
from lippmann.display import display_text
from lippmann.errors import InputError, input_error
from lippmann.images import check_output, replacing, write_picture
from lippmann.rendering.metadata import image_metadata
from lippmann.rendering.renderer import Settings, check_memory, peak_memory_mb
from lippmann.rendering.scene import Scene, check_scene_file, load_scene
from lippmann.rendering.sources import APERTURES, Aperture
from lippmann.variant import current_device, start_mitsuba

#: Vignetting that is mentioned, per cent.
NOTED_PERCENT = 1.0


@click.command("capture")
@click.argument("scene_path", metavar="SCENE")
@click.option("--setup", "setup_path", required=True, metavar="FILE", help="Set-up file (.toml).")
@click.option("-o", "output", required=True, metavar="OUT", help=".exr or .tif linear, .png for the panel.")
@click.option(
    "--rotate/--no-rotate",
    default=None,
    help="Turn each elemental image by 180 degrees, so that depths come out right.  [default: --rotate, for concave "
    "lenslets --no-rotate]",
)
@click.option("--size", type=int, help="Pixels across the same window.  [default: the display's]")
@click.option("--display-out", metavar="FILE", help="Write the display file that shows the picture (.toml).")
@click.option("--samples", default=4, show_default=True, help="Samples for each pixel, 1 to 65536.")
@click.option(
    "--aperture",
    type=click.Choice(APERTURES),
    help="Of a pickup: rays over the whole lenslet, or chief rays.  [default: full]",
)
@click.option(
    "--integrator",
    default="lights",
    show_default=True,
    help="lights, any of Mitsuba's (direct, path, ...), or scene for the file's own.",
)
@click.option("--max-depth", default=4, show_default=True, help="Surfaces that a ray may meet, 1 to 1000.")
@click.option("--memory-mb", type=float, help="Memory limit.  [default: four fifths of what is free]")
@seed_option
@device_option
@json_option
def command(
    scene_path: str,
    setup_path: str,
    output: str,
    rotate: bool | None,
    size: int | None,
    display_out: str | None,
    samples: int,
    aperture: str | None,
    integrator: str,
    max_depth: int,
    memory_mb: float | None,
    seed: int,
    device: str,
    as_json: bool,
) -> None:
    """Capture a Mitsuba scene through an imaging lens and a microlens array: an integral image for a display.

    Example: lippmann capture scenes/fish/fish.xml --setup scenes/setups/fig8a.toml -o fish.exr
    """
    path = check_output(output)
    setup = load_setup(setup_path)
    if size is not None:
        setup = setup.resized(size)
    if display_out is not None:
        _check_display_out(check_output(display_out, (".toml",)), setup)
    if aperture is not None and not isinstance(setup.pickup, Pickup):
        raise InputError("--aperture is for a [pickup]: a camera's pinhole leaves no choice; leave it out")
    if rotate is None:
        rotate = not setup.concave
    settings = Settings(samples, cast(Aperture, aperture or "full"), integrator, max_depth, seed, memory_mb)
    panel = setup.display.panel
    check_memory(panel.width_px, panel.height_px, settings)
    placement = stand_of(check_scene_file(scene_path), setup, setup_path)
    start_mitsuba(device)
    scene = load_scene(scene_path, placement)
    with progress_bar("capture", quiet=as_json) as progress:
        captured = capture(scene, setup, settings, rotate, progress)
    lost = captured.vignetting
    if lost.lens_percent > NOTED_PERCENT:
        log(
            f"note: the lens's aperture cuts off {lost.lens_percent:.1f} % of the rays (black in the picture); "
            "a larger lens.aperture_mm lets them in"
        )
    if lost.array_percent > NOTED_PERCENT:
        log(
            f"note: {lost.array_percent:.1f} % of the rays are lost in the array (black in the picture): the lenslets' "
            "rims reflect them; a longer focal length lets them out"
        )
    result = _result(setup, scene, rotate)
    rendered = captured.rendered
    metadata = image_metadata(setup.display, "exact", settings, scene_path)
    metadata |= {"setup": setup.name, "rotated": str(rotate), "array_position_mm": repr(setup.position_mm)}
    write_picture(path, rendered.radiance, metadata, panel.transfer, panel.bits)
    if display_out is not None:
        with replacing(Path(display_out)) as partial:
            partial.write_text(display_text(setup.display))
    result |= {
        "output": str(path),
        "display_out": display_out,
        "vignetting_percent": lost.lens_percent,
        "array_loss_percent": lost.array_percent,
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
        low, high = result["shown_depth_mm"]
        click.echo(
            f"{path}: {panel.width_px} x {panel.height_px}, {result['image']} {result['relief']} image from "
            f"{low:.1f} to {high:.1f} mm on '{setup.display.name}', vignetting {lost.lens_percent:.2f} %, "
            f"lost in the array {lost.array_percent:.2f} %, "
            f"{rendered.seconds:.2f} s ({rendered.samples_per_second / 1e6:.2f} M samples/s)"
        )

    emit(result, as_json, text)


def _check_display_out(path: Path, setup: Setup) -> None:
    """Refuse to write a display over a file that holds anything else."""
    if path.exists() and path.read_bytes() != display_text(setup.display).encode():
        raise input_error(str(path), "exists already and is not the display of this picture", "give another name")


def _result(setup: Setup, scene: Scene, rotated: bool) -> dict[str, Any]:
    """Return what the lens equations say of a capture."""
    far, near = scene.depth_range_mm
    depth = shown(setup, [far, near], rotated).depth_mm
    image = "real" if depth.min() >= 0.0 else "virtual" if depth.max() <= 0.0 else "real and virtual"
    panel, lens = setup.display.panel, setup.lens
    return {
        "setup": setup.name,
        "display": setup.display.name,
        "identity": setup.display.identity,
        "width_px": panel.width_px,
        "height_px": panel.height_px,
        "elemental_image_px": setup.array.pitch_mm / panel.pixel_pitch_mm,
        "focal_length_mm": None if lens is None else lens.focal_length_mm,
        "image_distance_mm": setup.image_distance_mm,
        "magnification": setup.magnification,
        "array_position_mm": setup.position_mm,
        "array_distance_mm": setup.array_distance_mm,
        "camera_distance_mm": setup.camera_distance_mm,
        "pickup_gap_mm": setup.pickup.gap_mm if isinstance(setup.pickup, Pickup) else None,
        "rotated": rotated,
        "image": image,
        "relief": "orthoscopic" if depth[1] > depth[0] else "pseudoscopic",
        "shown_depth_mm": [float(x) for x in np.sort(depth)],
    }

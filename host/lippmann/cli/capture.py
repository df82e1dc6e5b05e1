"""Command `lippmann capture`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lippmann import api
from lippmann.base.files import write_file
from lippmann.base.images import check_output
from lippmann.base.machine import peak_memory_mb
from lippmann.base.variant import current_device
from lippmann.capturing.capture import placement_before, shown_depth
from lippmann.capturing.capture_setup import Pickup, Setup, load_setup
from lippmann.cli.frame import Name, argument, make_command, option
from lippmann.cli.options import DEVICE, PICTURE, SEED
from lippmann.cli.options_rendering import SETTINGS
from lippmann.cli.output import emit
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import display_text
from lippmann.errors import input_error
from lippmann.rendering.options import Settings
from lippmann.rendering.sampling import Aperture
from lippmann.scenes.placement import warn_if_unplaced
from lippmann.scenes.scene import Scene, check_scene_file

#: Fields of `Settings` that are parameters of `lippmann.capture`.
CAPTURE_SETTINGS = ("samples", "integrator", "max_depth", "seed", "memory_mb", "shading")


@make_command("capture")
def command(
    scene_path: Name = argument("SCENE"),
    setup_path: Path = option("Set-up file (.toml)."),
    output: Path = PICTURE,
    rotate: bool | None = option(
        "Rotate elemental images by 180 degrees for correct depth.  [default: yes, except for concave lenslets]",
        flag="--rotate/--no-rotate",
    ),
    size: int | None = option("Width of the image, pixels, for the same panel size.  [default: the display's]"),
    display_out: Path | None = option("Also write the display file (.toml) for the image."),
    aperture: Aperture | None = option("Rays of a pickup: over the full lenslet, or chief rays.  [default: full]"),
    settings: Settings = SETTINGS,
    seed: int = SEED,
    device: str = DEVICE,
) -> None:
    """Capture a scene through a lens and a microlens array, as an integral image for a display.

    Example: lippmann capture scenes/fish/fish.xml --setup scenes/setups/fig8a.toml -o
    fish.exr
    """
    path, setup = check_output(output), load_setup(setup_path)
    setup = setup if size is None else setup.resized(size)
    if display_out:
        check_output(display_out, (".toml",))
        if display_out.exists() and display_out.read_bytes() != display_text(setup.display).encode():
            raise input_error(display_out, "exists, and is not this image's display file", "give another name")
    rotate = not setup.concave if rotate is None else rotate
    scene_file = check_scene_file(scene_path)
    warn_if_unplaced(scene_file)
    scene = api.load_scene(scene_file, placement_before(setup, scene_file, setup_path), device)
    values = {name: getattr(settings, name) for name in CAPTURE_SETTINGS}
    with progress_bar("capture") as progress:
        image = api.capture(scene, setup, rotate=rotate, aperture=aperture, progress=progress, **values)
    image.save(path)
    if display_out:
        write_file(display_out, display_text(setup.display))
    result = {
        **_geometry(setup, scene, rotate),
        "output": path,
        "display_out": display_out,
        **image.measured,
        "integrator": settings.integrator,
        "samples": settings.samples,
        "shading": image.metadata["shading"],
        "seed": seed,
        "device": current_device(),
        "peak_memory_mb": peak_memory_mb(),
    }
    emit(result, _text(result), setup.display)


def _text(result: dict[str, Any]) -> str:
    low, high = result["shown_depth_mm"]
    light = "irradiance cache, " if result["shading"] == "shared" else ""
    form = (
        "{output}: {width_px} x {height_px}, {light}{image} {relief} image from {low:.1f} to {high:.1f} mm on "
        "'{display}', vignetting {vignetting_percent:.2f} %, lost in the array {array_loss_percent:.2f} %, "
        "{seconds:.2f} s ({rate:.2f} M samples/s)"
    )
    return form.format(**result, light=light, low=low, high=high, rate=result["samples_per_second"] / 1e6)


def _geometry(setup: Setup, scene: Scene, rotated: bool) -> dict[str, Any]:
    far, near = scene.depth_range_mm
    depth = shown_depth(setup, [far, near], rotated)
    image = "real" if depth.min() >= 0.0 else "virtual" if depth.max() <= 0.0 else "real and virtual"
    panel, lens = setup.display.panel, setup.lens
    distances = ("image_distance_mm", "magnification", "array_distance_mm", "camera_distance_mm")
    return {
        "setup": setup.name,
        "display": setup.display.name,
        "width_px": panel.width_px,
        "height_px": panel.height_px,
        "elemental_image_px": setup.array.finest_mm / panel.coarsest_mm,
        "focal_length_mm": None if lens is None else lens.focal_length_mm,
        **{name: getattr(setup, name) for name in distances},
        "array_position_mm": setup.position_mm,
        "pickup_gap_mm": setup.pickup.gap_mm if isinstance(setup.pickup, Pickup) else None,
        "rotated": rotated,
        "image": image,
        "relief": "orthoscopic" if depth[1] > depth[0] else "pseudoscopic",
        "shown_depth_mm": [float(x) for x in np.sort(depth)],
    }

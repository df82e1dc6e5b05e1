"""`lippmann capture`: the integral image that an imaging lens, a microlens array and a camera capture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lippmann import api
from lippmann.base.files import replacing
from lippmann.base.images import check_output
from lippmann.base.machine import peak_memory_mb
from lippmann.base.variant import current_device
from lippmann.capturing.capture import placement_before, shown_depth
from lippmann.capturing.capture_setup import Pickup, Setup, load_setup
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.options_common import DEVICE, SEED
from lippmann.cli.options_rendering import INTEGRATOR, MAX_DEPTH, MEMORY_MB, SAMPLES, SHADING
from lippmann.cli.output import emit
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import display_text
from lippmann.errors import input_error
from lippmann.rendering.options import Shading
from lippmann.rendering.sampling import Aperture
from lippmann.scenes.placement import warn_if_unplaced
from lippmann.scenes.scene import Scene, check_scene_file


@make_command("capture")
def command(
    scene_path: str = argument("SCENE"),
    setup_path: str = option("Set-up file (.toml).", flag="--setup", metavar="FILE"),
    output: str = option(".exr or .tif linear, .png for the panel.", flag="-o", metavar="OUT"),
    rotate: bool | None = option(
        "Rotate each elemental image by 180 degrees, so that depth comes out right.  [default: --rotate, for "
        "concave lenslets --no-rotate]",
        None,
        flag="--rotate/--no-rotate",
    ),
    size: int | None = option("Width of the image in pixels, for the same window.  [default: the display's]", None),
    display_out: str | None = option(
        "Write the file of the display that shows the image (.toml).", None, metavar="FILE"
    ),
    samples: int = SAMPLES,
    aperture: Aperture | None = option(
        "For a pickup: rays over the whole lenslet, or chief rays.  [default: full]", None
    ),
    integrator: str = INTEGRATOR,
    max_depth: int = MAX_DEPTH,
    memory_mb: float | None = MEMORY_MB,
    shading: Shading = SHADING,
    seed: int = SEED,
    device: str = DEVICE,
) -> None:
    """Capture a scene through an imaging lens and a microlens array.

    The result is an integral image for a display.

    Example: lippmann capture scenes/fish/fish.xml --setup scenes/setups/fig8a.toml -o fish.exr
    """
    path, setup = check_output(output), load_setup(setup_path)
    setup = setup if size is None else setup.resized(size)
    if display_out is not None:
        _check_display_out(check_output(display_out, (".toml",)), setup)
    rotate = not setup.concave if rotate is None else rotate
    scene_file = check_scene_file(scene_path)
    warn_if_unplaced(scene_file)
    scene = api.load_scene(scene_file, placement_before(setup, scene_file, setup_path), device)
    with progress_bar("capture") as progress:
        image = api.capture(
            scene, setup, samples, rotate=rotate, aperture=aperture, integrator=integrator, max_depth=max_depth,
            seed=seed, memory_mb=memory_mb, shading=shading, progress=progress,
        )  # fmt: skip
    image.save(path)
    if display_out is not None:
        _write_display(Path(display_out), setup)
    result = {
        **_geometry(setup, scene, rotate),
        "output": str(path),
        "display_out": display_out,
        **image.measured,
        "integrator": integrator,
        "samples": samples,
        "shading": image.metadata["shading"],
        "seed": seed,
        "device": current_device(),
        "peak_memory_mb": peak_memory_mb(),
    }
    emit(result, _text(result))


def _text(result: Mapping[str, Any]) -> str:
    low, high = result["shown_depth_mm"]
    shading = "shared light, " if result["shading"] == "shared" else ""
    return (
        f"{result['output']}: {result['width_px']} x {result['height_px']}, {shading}"
        f"{result['image']} {result['relief']} image from "
        f"{low:.1f} to {high:.1f} mm on '{result['display']}', vignetting {result['vignetting_percent']:.2f} %, "
        f"lost in the array {result['array_loss_percent']:.2f} %, "
        f"{result['seconds']:.2f} s ({result['samples_per_second'] / 1e6:.2f} M samples/s)"
    )


def _check_display_out(path: Path, setup: Setup) -> None:
    """Refuse to overwrite any file but this display's own."""
    if path.exists() and path.read_bytes() != display_text(setup.display).encode():
        raise input_error(str(path), "exists already and is not the display of this image", "give another name")


def _write_display(path: Path, setup: Setup) -> None:
    with replacing(path) as partial:
        partial.write_text(display_text(setup.display), encoding="utf-8")


def _geometry(setup: Setup, scene: Scene, rotated: bool) -> dict[str, Any]:
    """Return the distances of a capture by the lens equations, for the result."""
    far, near = scene.depth_range_mm
    depth = shown_depth(setup, [far, near], rotated)
    image = "real" if depth.min() >= 0.0 else "virtual" if depth.max() <= 0.0 else "real and virtual"
    panel, lens = setup.display.panel, setup.lens
    return {
        "setup": setup.name,
        "display": setup.display.name,
        "identity": setup.display.identity,
        "width_px": panel.width_px,
        "height_px": panel.height_px,
        "elemental_image_px": setup.array.finest_mm / panel.coarsest_mm,
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

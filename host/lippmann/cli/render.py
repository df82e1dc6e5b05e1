"""`lippmann render`: the integral image of a scene for a display."""

from __future__ import annotations

from lippmann import api
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.options.common import DEVICE, DISPLAY, SEED
from lippmann.cli.options.rendering import MOVED, RENDERING, Moved
from lippmann.cli.output import emit, log, progress_bar
from lippmann.images import check_output
from lippmann.rendering.integral import RenderOptions
from lippmann.rendering.renderer import peak_memory_mb
from lippmann.rendering.scene import check_scene_file
from lippmann.variant import current_device


@make_command("render")
def command(
    scene_path: str = argument("SCENE"),
    display_path: str = DISPLAY,
    output: str = option(".exr or .tif linear, .png for the panel.", flag="-o", metavar="OUT"),
    options: RenderOptions = RENDERING,
    moved: Moved = MOVED,
    seed: int = SEED,
    device: str = DEVICE,
) -> None:
    """Render the integral image of a Mitsuba scene for a display.

    Example: lippmann render scenes/fish/fish.xml --display scenes/displays/paper-square.toml -o fish.exr
    """
    path, arrange = check_output(output), moved.arrange
    placement = moved.placement(check_scene_file(scene_path))
    with progress_bar("render") as progress:
        image = api.render_with(options, scene_path, display_path, placement, arrange, device, progress, log)
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
        "seed": seed,
        "device": current_device(),
        **image.measured,
        "peak_memory_mb": peak_memory_mb(),
    }

    text = (
        f"{path}: {display.panel.width_px} x {display.panel.height_px}, model {image.metadata['model']}, "
        f"{image.measured['seconds']:.2f} s ({image.measured['samples_per_second'] / 1e6:.2f} M samples/s), "
        f"peak memory {peak_memory_mb():.0f} MB"
    )
    emit(result, text)

"""`lippmann render`: the integral image of a scene for a display."""

from __future__ import annotations

import time

import click
from click.core import ParameterSource

from lippmann import api
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.options.common import DEVICE, DISPLAY, SEED
from lippmann.cli.options.rendering import MOVED, RENDERING, Moved
from lippmann.cli.output import emit, log, progress_bar
from lippmann.display import load_display
from lippmann.errors import InputError
from lippmann.images import check_output
from lippmann.integral_image import IntegralImage
from lippmann.layers.drawing import Filter
from lippmann.layers.folder import check_depth, is_layers, load_named_layers
from lippmann.layers.remarks import depth_remarks
from lippmann.rendering.integral import RenderOptions
from lippmann.rendering.renderer import peak_memory_mb, process_seconds
from lippmann.rendering.scene import check_scene_file
from lippmann.variant import current_device

#: Options that only scenes have.
OF_SCENES = ("aperture", "integrator", "max_depth", "tolerance", "memory_mb", "device")


@make_command("render")
def command(
    scene_path: str = argument("SCENE"),
    display_path: str = DISPLAY,
    output: str = option(".exr or .tif linear, .png for the panel.", flag="-o", metavar="OUT"),
    options: RenderOptions = RENDERING,
    moved: Moved = MOVED,
    seed: int = SEED,
    filter: Filter = option("Of a folder of layers: nearest texel, or bilinear between four.", "nearest"),
    device: str = DEVICE,
) -> None:
    """Render the integral image of a Mitsuba scene, or of a folder of layers, for a display.

    Layers take --engine golden (their default), twin or rtl, --samples 1, 2 or 4, --scale and --offset.

    Example: lippmann render scenes/fish/fish.xml --display scenes/displays/paper-square.toml -o fish.exr
    """
    path = check_output(output)
    start_seconds, begun = process_seconds(), time.perf_counter()
    if is_layers(scene_path):
        image = _drawn(scene_path, display_path, options, moved, filter)
    else:
        if _given("filter"):
            raise InputError("--filter is for layers; leave it out with a scene")
        placement, arrange = moved.placement(check_scene_file(scene_path)), moved.arrange
        with progress_bar("render") as progress:
            image = api.render_with(options, scene_path, display_path, placement, arrange, device, progress, log)
    rendered = time.perf_counter()
    image.save(path)
    written = time.perf_counter()
    display = image.display
    result = {
        "output": str(path),
        "display": display.name,
        "identity": display.identity,
        "width_px": display.panel.width_px,
        "height_px": display.panel.height_px,
        "model": image.metadata["model"],
        "engine": image.metadata["engine"],
        "integrator": options.settings.integrator,
        "samples": options.settings.samples,
        "seed": seed,
        "device": None if is_layers(scene_path) else current_device(),
        **image.measured,
        # With the two above, the whole process: before the command, scene and remarks, and the file.
        "start_seconds": start_seconds,
        "load_seconds": rendered - begun - image.measured["seconds"] - image.measured.get("prepare_seconds", 0.0),
        "write_seconds": written - rendered,
        "peak_memory_mb": peak_memory_mb(),
    }

    text = (
        f"{path}: {display.panel.width_px} x {display.panel.height_px}, model {image.metadata['model']}, "
        f"{image.measured['seconds']:.2f} s ({image.measured['samples_per_second'] / 1e6:.2f} M samples/s), "
        f"peak memory {peak_memory_mb():.0f} MB"
    )
    emit(result, text)


def _given(name: str) -> bool:
    return click.get_current_context().get_parameter_source(name) is not ParameterSource.DEFAULT


def _drawn(path: str, display_path: str, options: RenderOptions, moved: Moved, filter: Filter) -> IntegralImage:
    """Return the picture of a folder of layers; refuse options that only scenes have."""
    for name in moved.given.keys() - {"scale", "offset"} | {name for name in OF_SCENES if _given(name)}:
        raise InputError(f"--{name.replace('_', '-')} is for scenes; leave it out with layers")
    display = load_display(display_path)
    named = load_named_layers(path)
    scale = 1.0 if moved.scale is None else moved.scale
    try:
        stack = named.stack.moved(scale, moved.offset or (0.0, 0.0, 0.0))
        for name, layer in zip(named.names, stack.layers, strict=True):
            check_depth(layer.depth_mm, display, f"layer '{name}': depth")
        image = api.draw(
            stack,
            display,
            filter=filter,
            samples=options.settings.samples,
            model="exact" if options.model == "auto" else options.model,
            engine=options.engine if _given("engine") else "golden",
            fraction_bits=options.fraction_bits,
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    depths = [(name, layer.depth_mm) for name, layer in zip(named.names, stack.layers, strict=True)]
    for remark in depth_remarks(depths, display):
        log(remark)
    return image

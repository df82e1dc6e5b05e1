"""Command `lippmann render`."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

from lippmann.base.images import check_output
from lippmann.base.machine import peak_memory_mb, process_seconds
from lippmann.base.variant import current_device
from lippmann.cli.frame import Name, argument, flag_of, make_command, option
from lippmann.cli.options import DEVICE, DISPLAY, PICTURE, SEED, is_given
from lippmann.cli.options_rendering import MOVED, RENDERING, SCHEDULER, WORKERS, Moved
from lippmann.cli.output import emit
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import Display, load_display
from lippmann.errors import InputError, located
from lippmann.layers.layer_drawing import Filter, plan_layers
from lippmann.layers.layers_and_pictures import check_depth, is_layers, load_named_layers, warn_of_depths
from lippmann.rendering.executors import choose_executor, render_here
from lippmann.rendering.memory_estimate import check_display_memory, is_long_render
from lippmann.rendering.options import RenderOptions
from lippmann.rendering.plan import Job, Plan, open_scene
from lippmann.rendering.sinks import KeptBands, MemorySink, bands_folder, log_remaining_bands, render_into
from lippmann.scenes.scene import check_scene_file

SCENE_OPTIONS = ("aperture", "integrator", "max_depth", "tolerance", "shading", "memory_mb", "device")


@make_command("render")
def command(
    scene_path: Name = argument("SCENE"),
    display_path: Path = DISPLAY,
    output: Path = PICTURE,
    options: RenderOptions = RENDERING,
    moved: Moved = MOVED,
    seed: int = SEED,
    filter: Filter = option("Texture filter for layers.", "nearest"),
    workers: int | None = WORKERS,
    scheduler: str | None = SCHEDULER,
    device: str = DEVICE,
) -> None:
    """Render the integral image of a scene, or of a folder of layers, for a display.

    SCENE is a Mitsuba .xml, a mesh, splats, a quilt, a folder of views, or a .toml that
    names a picture and its depths. Layers accept --engine golden (default), twin or
    rtl, --samples 1, 2 or 4, --scale and --offset.

    Large, long and distributed renders store finished bands in OUT.bands. After an
    interruption, the same command continues the render.

    Example: lippmann render scenes/fish/fish.xml --display
    scenes/displays/paper-square.toml -o fish.exr
    """
    path = check_output(output)
    start_seconds, started = process_seconds(), time.perf_counter()
    executor = choose_executor(workers, scheduler, device)
    scene_file = None if is_layers(scene_path) else check_scene_file(scene_path)
    display = load_display(display_path)
    keeps_bands = executor is not render_here or is_long_render(options.settings, display)
    if scene_file is None:
        opened = _open_layers(scene_path, display, options, moved, filter)
    else:
        if not keeps_bands:
            check_display_memory(display, options.settings, str(display_path))
        opened = _open_scene(scene_file, display, options, moved, device, keeps_bands)
    with progress_bar("render") as progress, opened as plan:
        sink: KeptBands | MemorySink = KeptBands(bands_folder(path), plan) if keeps_bands else MemorySink(plan)
        times, write_started = render_into(sink, executor, progress), time.perf_counter()
        sink.write(path)
        metadata = sink.metadata
    write_seconds = time.perf_counter() - write_started
    log_remaining_bands(path)
    measured = times.measured(keeps_bands)
    load_seconds = time.perf_counter() - started - write_seconds - times.seconds - times.prepare_seconds
    result = {
        "output": path, "width_px": display.panel.width_px, "height_px": display.panel.height_px,
        "model": metadata["model"], "engine": metadata["engine"], "integrator": options.settings.integrator,
        "samples": options.settings.samples, "seed": seed, "shading": metadata.get("shading"),
        "device": None if scene_file is None else current_device(), **measured,
        # Start, load, write and `measured` times add up to the run time of the process.
        "start_seconds": start_seconds, "load_seconds": load_seconds, "write_seconds": write_seconds,
        "peak_memory_mb": peak_memory_mb(),
    }  # fmt: skip
    emit(result, _summary(path, display, metadata, measured), display)


def _summary(path: Path, display: Display, metadata: dict[str, str], measured: dict[str, float]) -> str:
    cached = measured.get("bands_kept")
    before = f", {cached} of {measured['bands']} bands from before" if cached else ""
    what = f"{display.panel.width_px} x {display.panel.height_px}, model {metadata['model']}"
    light = ", irradiance cache" if metadata.get("shading") == "shared" else ""
    speed = f"{measured['seconds']:.2f} s ({measured['samples_per_second'] / 1e6:.2f} M samples/s{before})"
    return f"{path}: {what}{light}, {speed}, peak memory {peak_memory_mb():.0f} MB"


@contextlib.contextmanager
def _open_scene(
    path: Path, display: Display, options: RenderOptions, moved: Moved, device: str, keeps_bands: bool
) -> Iterator[Plan]:
    if is_given("filter"):
        raise InputError("--filter is for layers; leave it out with a scene")
    with open_scene(path, moved.placement(path), device) as scene:
        yield Job(scene, display, options, moved.arrange(path)).plan(portable=keeps_bands)


@contextlib.contextmanager
def _open_layers(path: str, display: Display, options: RenderOptions, moved: Moved, filter: Filter) -> Iterator[Plan]:
    for name in moved.changes.keys() - {"scale", "offset"} | {one for one in SCENE_OPTIONS if is_given(one)}:
        raise InputError(f"{flag_of(name)} is for scenes; leave it out with layers")
    stack, names = load_named_layers(path)
    scale = 1.0 if moved.scale is None else moved.scale
    with located(path):
        stack = stack.moved(scale, moved.offset or (0.0, 0.0, 0.0))
        depths = [(name, layer.depth_mm) for name, layer in zip(names, stack.layers, strict=True)]
        for name, depth in depths:
            check_depth(depth, display, f"layer '{name}': depth")
        model = "exact" if options.model == "auto" else options.model
        engine = options.engine if is_given("engine") else "golden"
        plan = plan_layers(stack, display, filter, options.settings.samples, model, engine, options.fraction_bits)
        warn_of_depths(depths, display)
        yield plan

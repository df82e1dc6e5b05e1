"""`lippmann render`: the integral image of a scene for a display."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import click
from click.core import ParameterSource

from lippmann import api
from lippmann.base.images import check_output
from lippmann.base.machine import peak_memory_mb, process_seconds
from lippmann.base.progress import Progress
from lippmann.base.variant import current_device, start_mitsuba
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.options.common import DEVICE, DISPLAY, SEED
from lippmann.cli.options.rendering import MOVED, RENDERING, Moved
from lippmann.cli.output import emit, log
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import Display, load_display
from lippmann.errors import InputError
from lippmann.layers.layer_drawing import Filter
from lippmann.layers.layers_folder import check_depth, depth_remarks, is_layers, load_named_layers
from lippmann.rendering.bands import (
    Band,
    Rendered,
    Still,
    Work,
    check_band_memory,
    here,
    is_kept,
    left_over,
    render_bands,
    still_of,
    write_still,
)
from lippmann.rendering.cluster import check_scheduler, local_workers, render_on_cluster
from lippmann.rendering.integral import RenderOptions
from lippmann.rendering.integral_image import IntegralImage
from lippmann.scenes.scene import Scene, check_scene_file

#: Options that only scenes have.
OF_SCENES = (
    "aperture", "integrator", "max_depth", "tolerance", "shading", "memory_mb", "workers", "scheduler", "device",
)  # fmt: skip


@make_command("render")
def command(
    scene_path: str = argument("SCENE"),
    display_path: str = DISPLAY,
    output: str = option(".exr or .tif linear, .png for the panel.", flag="-o", metavar="OUT"),
    options: RenderOptions = RENDERING,
    moved: Moved = MOVED,
    seed: int = SEED,
    filter: Filter = option("Of a folder of layers: nearest texel, or bilinear between four.", "nearest"),
    workers: int | None = option("Processes on this machine that share the render.", None, click.IntRange(1, 64)),
    scheduler: str | None = option(
        "Render on the workers of this Dask scheduler: tcp://HOST:8786.", None, metavar="ADDRESS"
    ),
    device: str = DEVICE,
) -> None:
    """Render the integral image of a scene, or of a folder of layers, for a display.

    SCENE is Mitsuba's .xml, a mesh, splats, a quilt, a folder of views, or a .toml of a picture and its depths.

    Layers take --engine golden (their default), twin or rtl, --samples 1, 2 or 4, --scale and --offset.

    A large or long render, and one by workers, keeps its finished bands in OUT.bands: after an interruption the same
    command goes on.

    Example: lippmann render scenes/fish/fish.xml --display scenes/displays/paper-square.toml -o fish.exr
    """
    path = check_output(output)
    start_seconds, begun = process_seconds(), time.perf_counter()
    if workers is not None and scheduler is not None:
        raise InputError("--workers and --scheduler both say who renders; leave one out")
    if is_layers(scene_path):
        made = _saved(_drawn(scene_path, display_path, options, moved, filter), path)
    else:
        if _given("filter"):
            raise InputError("--filter is for layers; leave it out with a scene")
        checked = check_scene_file(scene_path)
        placement, arrange = moved.placement(checked), moved.arrange(checked)
        shared = workers is not None or scheduler is not None
        if scheduler is not None:
            check_scheduler(scheduler)
        with progress_bar("render") as progress:
            display = load_display(display_path)
            if shared or is_kept(options, display):
                start_mitsuba(device)
                still, scene = still_of(options, Path(scene_path), display, placement, arrange, log)
                with _work(still, scene, workers, scheduler, device) as work:
                    made = _written(path, still, work, progress)
            else:
                image = api.render_with(options, scene_path, display_path, placement, arrange, device, progress, log)
                made = _saved(image, path)
    if (said := left_over(path)) is not None:
        log(said)
    panel = made.display.panel
    seconds = made.measured["seconds"]
    rest = time.perf_counter() - begun - seconds - made.measured.get("prepare_seconds", 0.0) - made.write_seconds
    result = {
        "output": str(path),
        "display": made.display.name,
        "identity": made.display.identity,
        "width_px": panel.width_px,
        "height_px": panel.height_px,
        "model": made.metadata["model"],
        "engine": made.metadata["engine"],
        "integrator": options.settings.integrator,
        "samples": options.settings.samples,
        "shading": made.metadata.get("shading"),
        "seed": seed,
        "device": None if is_layers(scene_path) else current_device(),
        **made.measured,
        # With the two above, the whole process: before the command, scene and remarks, and the file.
        "start_seconds": start_seconds,
        "load_seconds": rest,
        "write_seconds": made.write_seconds,
        "peak_memory_mb": peak_memory_mb(),
    }

    text = (
        f"{path}: {panel.width_px} x {panel.height_px}, model {made.metadata['model']}, "
        f"{'shared light, ' if result['shading'] == 'shared' else ''}"
        f"{seconds:.2f} s ({made.measured['samples_per_second'] / 1e6:.2f} M samples/s"
        f"{_before(made.measured)}), peak memory {peak_memory_mb():.0f} MB"
    )
    emit(result, text)


@dataclass(frozen=True)
class _Made:
    """A picture that is on disk."""

    display: Display
    metadata: Mapping[str, str]
    measured: Mapping[str, float]
    write_seconds: float


def _saved(image: IntegralImage, path: Path) -> _Made:
    started = time.perf_counter()
    image.save(path)
    return _Made(image.display, image.metadata, image.measured, time.perf_counter() - started)


def _written(path: Path, still: Still, work: Work, progress: Progress) -> _Made:
    """Render a picture by bands, and write it."""
    started = time.perf_counter()
    kept, rendered = render_bands(path, still, work, progress, log)
    between = time.perf_counter()
    write_still(path, still, kept, log)
    panel, bands = still.display.panel, len(still.bands)
    pixels = sum(len(still.bands[number]) for number in rendered) * panel.width_px
    measured = {
        "seconds": between - started,
        "samples_per_second": pixels * still.rays / max(between - started, 1e-9),
        "bands": bands,
        "bands_kept": bands - len(rendered),
    }
    return _Made(still.display, still.metadata, measured, time.perf_counter() - between)


@contextlib.contextmanager
def _work(still: Still, scene: Scene, workers: int | None, scheduler: str | None, device: str) -> Iterator[Work]:
    """Give what renders bands: this process, workers that it starts, or those of a scheduler."""
    if workers is not None:
        with contextlib.ExitStack() as ended:

            def by_own(bands: Sequence[Band], _: Callable[[int], None]) -> Iterable[tuple[Band, Rendered]]:
                count = min(workers, len(bands))  # none where only the file is to be written
                if not count:
                    return ()
                check_band_memory(still, count)
                address, security = ended.enter_context(local_workers(count))
                return render_on_cluster(address, device, bands, log, security)

            yield by_own
    elif scheduler is not None:
        yield lambda bands, _: render_on_cluster(scheduler, device, bands, log)
    else:
        yield here(still, scene)


def _before(measured: Mapping[str, float]) -> str:
    """Return what is said of the bands that an earlier command has rendered."""
    kept = measured.get("bands_kept")
    return f", after {kept} of {measured['bands']} bands of before" if kept else ""


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

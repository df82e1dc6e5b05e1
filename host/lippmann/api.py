"""Public Python functions; the command line calls them too.

Each function sets Mitsuba's variant for its device, then restores the user's variant.
"""

from __future__ import annotations

import math
import tempfile
import webbrowser
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.base.files import write_file
from lippmann.base.images import check_output
from lippmann.base.progress_protocol import Progress, check_progress
from lippmann.base.variant import check_device, own_variant
from lippmann.capturing.capture import capture as capture_scene
from lippmann.capturing.capture import placement_before, report_losses
from lippmann.capturing.capture_setup import Pickup, Setup, load_setup
from lippmann.display.description import MAX_SIDE_PX, Display, display_at
from lippmann.errors import InputError, as_number, check_flags, check_type, whole_number
from lippmann.eye.many_views import render_directs
from lippmann.eye.notebook import HEIGHT_PX, Sweep, Widget
from lippmann.eye.observer import Eye, View, whole_window
from lippmann.eye.observer import observe as observe_window
from lippmann.eye.viewer_page import FRAMES_PER_SECOND, Direct, page_html
from lippmann.layers.layer_drawing import Filter, plan_layers
from lippmann.layers.layers_and_pictures import load_named_layers
from lippmann.layers.stack import LayerStack
from lippmann.optics.model_choice import TOLERANCE
from lippmann.optics.rays import Engine, Model
from lippmann.rendering.diagnostics import warn_of_unused_parts
from lippmann.rendering.executors import choose_executor, render_here
from lippmann.rendering.integral_image import IntegralImage, check_image
from lippmann.rendering.memory_estimate import check_display_memory, check_memory
from lippmann.rendering.options import ModelOption, RenderOptions, Settings, Shading
from lippmann.rendering.plan import Job, SceneSource, image_metadata, open_scene, place_scene
from lippmann.rendering.sampling import Aperture, Window
from lippmann.rendering.sinks import render_picture
from lippmann.scenes.placement import Arrange, Placement
from lippmann.scenes.scene import Scene, check_scene_file
from lippmann.scenes.scene import load_scene as load_scene_file

VIEW_PX = 600
PAGE_SUFFIXES = (".html", ".htm")


def load_scene(path: str | Path, placement: Placement | None = None, device: str = "auto") -> Scene:
    """Load a scene for several calls of `render`, `capture` or `view`; refuse an invalid file.

    Parameters
    ----------
    path
        Mitsuba XML, or a file of another tool (see `lippmann.scenes.formats`).
    placement
        Position of the scene relative to the display. `None` reads the placement file
        in the scene's folder. If that file is missing, a scene unit is 1 mm, and
        `render` automatically places a scene of another tool.
    device
        See `render`.
    """
    with own_variant(device):
        return load_scene_file(path, placement)


def render(
    scene: SceneSource,
    display: str | Path | Display,
    samples: int = 4,
    model: ModelOption = "auto",
    *,
    aperture: Aperture = "chief",
    integrator: str = "lights",
    max_depth: int = 4,
    seed: int = 0,
    engine: Engine = "fast",
    fraction_bits: int | None = None,
    tolerance: float = TOLERANCE,
    placement: Placement | None = None,
    arrange: Arrange | None = None,
    memory_mb: float | None = None,
    device: str = "auto",
    progress: Progress | None = None,
    shading: Shading = "auto",
    kept: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> IntegralImage:
    """Render the integral image of a scene for a display; the logger "lippmann" reports what "auto" chose.

    Raises InputError for an invalid file or value, and for an image that exceeds the
    memory limit. Raises DeviceError if the scheduler or all local workers are lost.
    Raises MissingLibraryError if Mitsuba, Dask or a tool of the engine is missing.

    Parameters
    ----------
    scene, display, placement
        Scene: a path with a placement (see `load_scene`), a result of `load_scene`, a
        `mitsuba.Scene`, or a dictionary for `mitsuba.load_dict`. Display: see `draw`.
    samples, aperture, integrator, max_depth, seed, memory_mb, shading
        See `lippmann.rendering.options.Settings`.
    model, tolerance, engine, fraction_bits
        See `lippmann.rendering.options.RenderOptions`.
    arrange
        "fit" scales and moves the scene into the display's depth range. "camera" puts
        the eye at the camera of the scene's file. `None` uses `placement`.
    device, progress
        The device is "llvm" (CPU), "cuda" (GPU) or "auto". The function `progress` is
        called with (finished rows, all rows).
    kept
        Folder that stores finished bands, so that an interrupted render can continue.
        A different render removes the stored bands.
    workers, scheduler
        Number of local processes, or a Dask scheduler's address ("tcp://127.0.0.1:8786").
    """
    check_progress(progress)
    settings = Settings(samples, aperture, integrator, max_depth, seed, memory_mb, shading)
    options = RenderOptions(model, tolerance, engine, fraction_bits, settings)
    executor, built = choose_executor(workers, scheduler, device), display_at(display)
    where = f"display '{built.name}'" if isinstance(display, Display) else str(display)
    check_display_memory(built, settings, where)
    with open_scene(scene, placement, device) as loaded:
        portable = kept is not None or executor is not render_here
        plan = Job(loaded, built, options, arrange).plan(portable=portable)
        return render_picture(plan, executor, kept, progress)


def load_layers(path: str | Path) -> LayerStack:
    """Read a folder of layers that `lippmann layers` wrote, or its `layers.toml`.

    Raises InputError for invalid keys, and for pictures that are not palette PNGs.
    """
    return load_named_layers(path)[0]


def draw(
    layers: str | Path | LayerStack,
    display: str | Path | Display,
    *,
    filter: Filter = "nearest",
    samples: int = 1,
    model: Model = "exact",
    engine: Engine = "golden",
    fraction_bits: int | None = None,
    kept: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> IntegralImage:
    """Draw layers for a display by the method of an FPGA that has no frame memory.

    The engines twin and rtl round light to panel values; golden does not. Raises
    InputError for an invalid file or value, and for layers at or behind the eyes.

    Parameters
    ----------
    layers, display
        Layers: a folder or a result of `load_layers`. Display: a file or a result of
        `load_display`.
    filter, samples
        Texture filter, "nearest" or "bilinear", and 1, 2 or 4 samples per pixel.
    model, engine, fraction_bits
        Lens model. Engine: "golden" (float64), "twin" (the RTL's integers) or "rtl" (a
        simulation of the RTL). Fraction bits of twin and rtl; `None` means the maximum.
    kept, workers, scheduler
        See `render`.
    """
    built = display_at(display)
    stack = layers if isinstance(layers, LayerStack) else load_layers(layers)
    where = "layers" if isinstance(layers, LayerStack) else str(layers)
    plan = plan_layers(stack, built, filter, samples, model, engine, fraction_bits, where)
    return render_picture(plan, choose_executor(workers, scheduler), kept)


def capture(
    scene: SceneSource,
    setup: str | Path | Setup,
    samples: int = 4,
    *,
    rotate: bool | None = None,
    aperture: Aperture | None = None,
    integrator: str = "lights",
    max_depth: int = 4,
    seed: int = 0,
    memory_mb: float | None = None,
    device: str = "auto",
    progress: Progress | None = None,
    shading: Shading = "auto",
) -> IntegralImage:
    """Render a scene as captured by an imaging lens, a microlens array and a camera.

    The image is for the set-up's display; `measured` contains `vignetting_percent` and
    `array_loss_percent`. Raises InputError for an invalid file or value, a scene that
    cannot be captured, or an image that exceeds the memory limit.

    Parameters
    ----------
    scene, setup
        Scene: Mitsuba XML, or a scene loaded with the placement of
        `lippmann.capturing.capture.placement_before`. Set-up: a file or a result of
        `load_setup`.
    samples, integrator, max_depth, seed, memory_mb, shading
        See `lippmann.rendering.options.Settings`.
    rotate
        Whether each elemental image is rotated by 180 degrees, which makes the depth on
        the display correct. `None` means yes, except for concave lenslets.
    aperture
        "full" (default): rays of a pickup sensor pass the whole lenslet. "chief": rays
        pass only the lenslet's centre.
    device, progress
        See `render`.
    """
    check_progress(progress)
    built = setup if isinstance(setup, Setup) else load_setup(setup)
    if aperture is not None and not isinstance(built.pickup, Pickup):
        raise InputError("aperture applies only to a [pickup] (a camera has a pinhole); leave it out")
    if rotate is not None:
        check_flags(rotate=rotate)
    rotated = not built.concave if rotate is None else rotate
    settings = Settings(samples, aperture or "full", integrator, max_depth, seed, memory_mb, shading)
    check_memory(*built.display.panel.size_px, settings, colours=1)
    placement, path = None, None if isinstance(setup, Setup) else setup
    if isinstance(scene, str | Path):
        placement = placement_before(built, check_scene_file(scene), path)
    with open_scene(scene, placement, device) as loaded:
        warn_of_unused_parts(loaded, settings)
        captured = capture_scene(loaded, built, settings, rotated, progress)
    settings = replace(settings, shading=captured.shading)
    metadata = image_metadata(RenderOptions("exact", settings=settings), loaded.path)
    metadata |= {"setup": built.name, "rotated": str(rotated), "array_position_mm": repr(float(built.position_mm))}
    measured = {**report_losses(*captured.lost_percent), **captured.measured}
    return IntegralImage(captured.radiance, built.display, metadata, measured)


def observe(
    image: IntegralImage,
    eye: tuple[float, float, float] = (0.0, 0.0, 600.0),
    pupil_mm: float = 0.0,
    focus_z_mm: float = 0.0,
    width_px: int = VIEW_PX,
    samples: int = 16,
    *,
    display: str | Path | Display | None = None,
    window: Window | None = None,
    model: Model = "exact",
    crosstalk: bool = True,
    seed: int = 0,
    device: str = "auto",
) -> View:
    """Return an eye's view of a displayed image; raises InputError for a value out of range.

    Parameters
    ----------
    image, eye
        The image, and the centre of the pupil: x right, y up, z towards the viewer, mm.
        The display is at z = 0.
    pupil_mm, focus_z_mm
        Diameter of the pupil (0 is a pinhole), and the depth z in focus.
    width_px, samples
        Width of the view, and number of rays per pixel of the view.
    display
        The display as built, such as `image.display.misaligned(rotation_deg=0.1)`.
        `None` means the image's display.
    window
        The part of the plane z = 0 that the view shows; `None` means the whole panel, in `width_px` columns.
    model, crosstalk, seed
        Lens model, crosstalk (`False` shows crosstalk as black), and random seed.
    device
        See `render`.
    """
    check_image(image)
    built = image.display if display is None else display_at(display)
    looking = Eye(eye, pupil_mm, focus_z_mm)
    check_type("window", window, (Window, type(None)), "a rendering.sampling.Window or None")
    window = window or whole_window(image.display, whole_number("width_px", width_px, 1, MAX_SIDE_PX))
    with own_variant(device):
        view = observe_window(image.radiance, built, looking, window, samples, model, seed, crosstalk)
    position = tuple(float(x) for x in looking.position_mm)
    return replace(view, metadata={"display": image.display.name, "eye_mm": str(position)})


def view(
    image: IntegralImage,
    path: str | Path | None = None,
    scene: SceneSource | None = None,
    *,
    later: Sequence[IntegralImage] = (),
    frames_per_second: float = FRAMES_PER_SECOND,
    title: str = "Integral image",
    placement: Placement | None = None,
    arrange: Arrange | None = None,
    seed: int = 0,
    device: str = "auto",
) -> Path:
    """Write a page that shows an image through its lenslets (needs WebGL 2); return its path.

    Raises InputError if the page cannot be written or the scene is invalid.

    Parameters
    ----------
    image, title
        The image, and the heading of the page.
    path
        Path of the page (.html). `None` writes a temporary file and opens a browser.
    scene
        Scene for direct views on the page: Mitsuba XML or a result of `load_scene`.
    later, frames_per_second
        Further frames of a film that begins with `image`, and the film's frame rate.
    placement, arrange
        See `render`.
    seed, device
        Random seed and device (see `render`) of the direct views.
    """
    target = Path(tempfile.mkdtemp(prefix="lippmann-")) / "view.html" if path is None else path
    target = check_output(target, PAGE_SUFFIXES)
    page = view_page(
        image,
        scene,
        later=later,
        frames_per_second=frames_per_second,
        title=title,
        placement=placement,
        arrange=arrange,
        seed=seed,
        device=device,
    )
    write_file(target, page)
    if path is None:
        webbrowser.open(target.as_uri())
    return target


def widget(
    image: IntegralImage,
    scene: SceneSource | None = None,
    *,
    height_px: int = HEIGHT_PX,
    title: str = "Integral image",
    placement: Placement | None = None,
    arrange: Arrange | None = None,
    seed: int = 0,
    device: str = "auto",
) -> Widget:
    """Return a notebook widget, `height_px` pixels high, that contains the page of `view`.

    The parameters and errors are those of `view`.
    """
    page = view_page(image, scene, title=title, placement=placement, arrange=arrange, seed=seed, device=device)
    return Widget(page.decode("utf-8"), whole_number("height_px", height_px, 1, MAX_SIDE_PX))


def sweep(
    image: IntegralImage,
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    count: int = 21,
    **options: Any,
) -> Sweep:
    """Return `count` views of an eye that moves from `start` to `end` (x, y, z; mm) in equal steps.

    `options` are further parameters of `observe`. Raises the errors of `observe`.
    """
    count = whole_number("count", count, 2, 1000)
    for name, place in (("start", start), ("end", end)):
        if np.array(place, object).shape != (3,):
            raise InputError(f"sweep: {name} {place!r} is not a position; give (x, y, z) in mm")
    places = np.linspace(start, end, count).tolist()
    return Sweep([observe(image, (x, y, z), **options) for x, y, z in places])


def view_page(
    image: IntegralImage,
    scene: SceneSource | None = None,
    directs: Sequence[Direct] = (),
    *,
    later: Sequence[IntegralImage] = (),
    frames_per_second: float = FRAMES_PER_SECOND,
    title: str = "Integral image",
    placement: Placement | None = None,
    arrange: Arrange | None = None,
    seed: int = 0,
    device: str = "auto",
    progress: Progress | None = None,
) -> bytes:
    """Return the HTML page that `view` writes; `directs` are rendered direct views."""
    check_progress(progress)
    check_type("later", later, Sequence, "a list of lippmann.IntegralImage")
    for frame in (image, *later):
        check_image(frame)
    check_type("title", title, str, "text")
    if not 0.1 <= as_number(frames_per_second) < math.inf:
        raise InputError(f"frames_per_second {frames_per_second} is out of range; give a finite number, 0.1 or more")
    if scene is None and (placement is not None or arrange is not None):
        raise InputError("placement and arrange need a scene; give scene too, or leave out both")
    check_device(device)
    seed = whole_number("seed", seed, 0, 2**32 - 1)
    if scene is not None:
        with open_scene(scene, placement, device) as loaded:
            placed = place_scene(loaded, image.display, arrange)
            directs = [*directs, *render_directs(placed, image.display, seed, progress)]
    others = [frame.radiance for frame in later]
    return page_html(image.display, image.radiance, title, directs, others, frames_per_second).encode("utf-8")

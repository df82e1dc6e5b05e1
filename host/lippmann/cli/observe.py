"""Command `lippmann observe`."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from lippmann import api
from lippmann.base.animation import ANIMATION_SUFFIXES, FRAME_MS, write_contact_sheet
from lippmann.base.images import SUFFIXES, check_output
from lippmann.cli.frame import Name, argument, make_command, option
from lippmann.cli.options import DEVICE, DISPLAY, FORCE, LENS_MODEL, SEED, Point, vector
from lippmann.cli.output import emit, log
from lippmann.cli.progress_bar import with_progress
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error
from lippmann.eye.observer import Eye, View, whole_window
from lippmann.motion.video import VIEW_SUFFIXES, even_window, write_views
from lippmann.optics.rays import Model
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.memory_estimate import BASE_MEMORY_MB, check_memory_mb
from lippmann.rendering.options import MAX_SAMPLES
from lippmann.rendering.sampling import Window

MAX_VIEW_PX = 16384
SWEEP_FRAMES = 21
#: Panel size in pixels above which views read only needed rows of the file.
STORED_PX = 1 << 26


@make_command("observe")
def command(
    image_path: Name = argument("IMAGE"),
    display: Display = DISPLAY,
    eye: Point = option("Position of the eye, mm; the display is at z = 0, viewers at z > 0."),
    output: Path = option("Output file: .png, .exr or .tif; with --sweep, .mp4, .gif or .png.", metavar="VIEW"),
    width: int = option("Width of the view, pixels.", api.VIEW_PX, click.IntRange(1, MAX_VIEW_PX)),
    samples: int = option("Rays per pixel of the view.", 16, click.IntRange(1, MAX_SAMPLES)),
    pupil: float = option("Diameter of the pupil, mm.", 0.0),
    focus: float = option("Depth z at which the eye focuses, mm.", 0.0),
    model: Model = LENS_MODEL,
    no_crosstalk: bool = option("Show crosstalk as black."),
    rotation_error: float = option("Rotation error of the array, degrees.", 0.0),
    offset_error: tuple[float, float] = option("Offset error of the array, mm.", (0.0, 0.0), vector("X,Y")),
    gap_error: float = option("Error of the gap, mm.", 0.0),
    pitch_scale: float = option("Scale factor of the array's pitch.", 1.0),
    sweep: tuple[float, float] | None = option("Animate an eye that moves from x = X0 to X1.", kind=vector("X0,X1")),
    frames: int | None = option(
        f"Number of views in a sweep.  [default: {SWEEP_FRAMES}]", kind=click.IntRange(2, 1000)
    ),
    sheet: Path | None = option("Also write a contact sheet of the sweep.", metavar="SHEET.png"),
    force: bool = FORCE,
    seed: int = SEED,
    device: str = DEVICE,
) -> None:
    """Compute the view of an eye through the lenslets, including crosstalk.

    The options --...-error and --pitch-scale misalign the array.

    Example: lippmann observe fish.exr --display scenes/displays/paper-square.toml --eye
    50,0,600 -o view.png
    """
    path = _check_files(image_path, output, sheet, frames, sweep is not None)
    xs = [eye[0]] if sweep is None else np.linspace(*sweep, frames or SWEEP_FRAMES).tolist()
    eyes = [Eye((x, eye[1], eye[2]), pupil, focus) for x in xs]
    window = whole_window(display, width)
    if path.suffix.lower() in VIEW_SUFFIXES:
        window = even_window(window)
    if window.height_px > MAX_VIEW_PX:
        raise InputError(f"the view would be {window.height_px} pixels high; give a smaller --width")
    built = display.misaligned(rotation_error, offset_error, gap_error, pitch_scale)
    image = _load_image(image_path, display, force, len(eyes), window)
    views = [
        api.observe(
            image, one.position_mm, pupil, focus, samples=samples, display=built, window=window, model=model,
            crosstalk=not no_crosstalk, seed=seed, device=device,
        )
        for one in with_progress("observe", eyes)
    ]  # fmt: skip
    if sweep is None:
        views[0].metadata["view_of"] = Path(image_path).name
        views[0].save(path)
    else:
        write_views(path, [view.radiance for view in views], window, 1000.0 / FRAME_MS, there_and_back=True)
    if sheet:
        numbers = np.linspace(0, len(xs) - 1, min(len(xs), 9)).round().astype(int)
        captions = [f"eye x = {xs[k]:+.0f} mm" for k in numbers]
        write_contact_sheet(sheet, [views[k].radiance for k in numbers], captions)
    _emit_result(path, sheet, window, eyes, views, built)


def _load_image(path: str, display: Display, force: bool, count: int, window: Window) -> IntegralImage:
    panel_px = display.panel.width_px * display.panel.height_px
    # Both the panel's light and each view are stored twice, on host and device.
    values = 2 * min(STORED_PX, panel_px) + 2 * count * window.width_px * window.height_px
    what = f"{count} views of {window.width_px} x {window.height_px} pixels"
    needed_mb = BASE_MEMORY_MB + 3 * 4 * values / 1e6
    check_memory_mb(needed_mb, None, what, "give a smaller --width or fewer --frames")
    return IntegralImage.load(path, display, force, panel_px > STORED_PX)


def _emit_result(
    path: Path, sheet: Path | None, window: Window, eyes: list[Eye], views: list[View], built: Display
) -> None:
    dark = max(view.status_share["blocked"] for view in views)
    if dark > 0.02:
        where = "outside the panel" if built.array.extent_mm is None else "outside the panel or on the array's mount"
        log(f"note: up to {100 * dark:.1f} % of the rays end {where}: the view has a dark border")
    shares = [view.status_share for view in views]
    rows = [{"eye_mm": eye.position_mm, "status_share": share} for eye, share in zip(eyes, shares, strict=True)]
    size = {"width_px": window.width_px, "height_px": window.height_px}
    crosstalk = 100 * np.mean([share["crosstalk"] for share in shares])
    text = f"{path}: {window.width_px} x {window.height_px}, crosstalk in {crosstalk:.2f} % of the rays"
    emit({"output": path, "sheet": sheet, **size, "views": rows}, text)


def _check_files(image: str, output: Path, sheet: Path | None, frames: int | None, moves: bool) -> Path:
    if not moves and output.suffix.lower() in {*VIEW_SUFFIXES, *ANIMATION_SUFFIXES}.difference(SUFFIXES):
        remedy = f"give --sweep X0,X1 too, or choose from {', '.join(SUFFIXES)}"
        raise input_error(output, "is an animation file", remedy)
    path = check_output(output, VIEW_SUFFIXES + ANIMATION_SUFFIXES if moves else SUFFIXES)
    for flag, value in (("--sheet", sheet), ("--frames", frames)):
        if value is not None and not moves:
            raise InputError(f"{flag} is for a sweep; give --sweep X0,X1 too")
    for written in filter(None, (output, sheet)):
        if written.exists() and Path(image).exists() and written.samefile(image):
            raise InputError(f"{written}: is the input image; give the output another name")
    if sheet:
        if sheet.resolve() == path.resolve():
            raise InputError(f"{sheet}: is also the animation; give the sheet another name")
        check_output(sheet, (".png",))
    return path

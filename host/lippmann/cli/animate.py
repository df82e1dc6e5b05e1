"""Command `lippmann animate`."""

from __future__ import annotations

import time
from dataclasses import replace

import click

from lippmann import api
from lippmann.base.animation import ANIMATION_SUFFIXES, FRAME_BYTES
from lippmann.base.images import check_output
from lippmann.base.tones import encoded_values
from lippmann.base.variant import start_mitsuba
from lippmann.cli.frame import Folder, Name, argument, make_command, option
from lippmann.cli.options import DEVICE, DISPLAY, FOLDER, SEED, Point
from lippmann.cli.options_rendering import RENDERING, SCHEDULER, WORKERS
from lippmann.cli.output import emit
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.motion.film import Film, load_film
from lippmann.motion.film_frames import FrameFolder, choose_shading, lock_folder, plan_film, warn_of_frame
from lippmann.motion.video import LOSSLESS_SUFFIXES, VIEW_SUFFIXES, even_window, write_video, write_views
from lippmann.rendering.executors import choose_executor, render_here
from lippmann.rendering.memory_estimate import BASE_MEMORY_MB, check_display_memory, check_memory_mb
from lippmann.rendering.options import RenderOptions, Settings
from lippmann.rendering.sampling import Window
from lippmann.rendering.sinks import render_into
from lippmann.scenes.placement import SCALE_RANGE, warn_if_unplaced
from lippmann.scenes.scene import check_scene_file

MAX_VIEW_PX = 4096
#: Maximum frame rate of a GIF, Hz; viewers show each frame for at least 20 ms.
GIF_SPEED = 50.0


@make_command("animate")
def command(
    film_path: Name = argument("FILM"),
    display: Display = DISPLAY,
    output: Folder = FOLDER,
    scale: float = option("Scale of the film about the display's centre.", 1.0, click.FloatRange(*SCALE_RANGE)),
    fit: bool = option("Fit the film into the display's depth range."),
    options: RenderOptions = RENDERING,
    video: Name | None = option("Also write a lossless video of the panel's frames.", metavar="FILE.mkv"),
    view: Name | None = option("Also write an eye's view: .mp4, .gif or .png."),
    eye: Point | None = option("Position of the eye of --view, mm."),
    width: int | None = option(f"Width of --view.  [default: {api.VIEW_PX} px]", kind=click.IntRange(2, MAX_VIEW_PX)),
    workers: int | None = WORKERS,
    scheduler: str | None = replace(SCHEDULER, flag="--scheduler --cluster"),
    seed: int = SEED,
    device: str = DEVICE,
) -> None:
    """Render a film, frame by frame, for a display.

    After an interruption, the same command continues, because it keeps up-to-date frames.

    Example: lippmann animate scenes/films/swim.toml --display scenes/displays/paper-square.toml -o out/swim
    """
    if (view is None) != (eye is None) or (width and view is None):
        raise InputError("--view needs --eye, and --width needs both; give --view and --eye")
    if fit and scale != 1.0:
        raise InputError("--scale and --fit both place the film; leave one out")
    executor = choose_executor(workers, scheduler, device)
    film, panel = load_film(film_path), display.panel
    check_display_memory(display, options.settings, f"display '{display.name}'")
    scene_path = check_scene_file(film.scene)
    if not fit:
        warn_if_unplaced(scene_path)
    lock = lock_folder(output, film.frames)
    if video:
        check_output(video, LOSSLESS_SUFFIXES)
    window = None if view is None else _view_window(view, film, display, width or api.VIEW_PX, options.settings)
    start_mitsuba(device)
    plans = choose_shading(plan_film(film, display, options, None if fit else scale))
    started = time.perf_counter()
    frames = FrameFolder(output, lock, plans)
    if frames.missing_plans and executor is render_here:
        warn_of_frame(frames.missing_plans[0])
    with progress_bar("frames") as progress:
        render_into(frames, executor, progress)
    seconds, rendered = time.perf_counter() - started, len(frames.missing_plans)
    if video:
        values = (encoded_values(image.radiance, panel.transfer, min(panel.bits, 8)) for image in frames.images())
        write_video(video, values, *panel.size_px, film.frames_per_second)
    if view and window and eye:
        with progress_bar("view") as progress:
            views = (observe(one.radiance, display, Eye(eye), window).radiance for one in frames.images(progress))
            write_views(view, views, window, film.frames_per_second)
    videos = [f"{path}: {film.frames / film.frames_per_second:.3g} s" for path in (video, view) if path]
    cached = f", {film.frames - rendered} kept" if rendered < film.frames else ""
    size = f"{film.frames} frames of {panel.width_px} x {panel.height_px}"
    result = {
        "folder": output, "film": film.name, "frames": film.frames, "frames_per_second": film.frames_per_second,
        "rendered": rendered, "kept": film.frames - rendered, "seconds": seconds, "video": video, "view": view,
    }  # fmt: skip
    emit(result, [f"{output}: {size}, {rendered} rendered in {seconds:.1f} s{cached}", *videos], display)


def _view_window(path: Name, film: Film, display: Display, width_px: int, settings: Settings) -> Window:
    suffix = check_output(path, VIEW_SUFFIXES + ANIMATION_SUFFIXES).suffix.lower()
    if suffix == ".gif" and film.frames_per_second > GIF_SPEED:
        raise InputError(f"{path}: a GIF shows at most {GIF_SPEED:g} frames a second; choose .mp4, .png or .apng")
    window = even_window(whole_window(display, width_px))
    count = film.frames if suffix in ANIMATION_SUFFIXES else 1
    needed_mb = BASE_MEMORY_MB + count * window.width_px * window.height_px * FRAME_BYTES / 1e6
    what = f"{path}: {count} frames of {window.width_px} x {window.height_px} pixels in memory"
    check_memory_mb(needed_mb, settings.memory_mb, what, "give a smaller --width, or an .mp4 file")
    return window

"""`lippmann animate`: the frames of a film for a display, and videos of them."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from lippmann import api
from lippmann.animation import ANIMATION_SUFFIXES, animation_mb, write_animation
from lippmann.board.frames import panel_values
from lippmann.cli.options.common import Vector, device_option, display_option, json_option, seed_option
from lippmann.cli.options.rendering import render_options
from lippmann.cli.output import emit, log, progress_bar
from lippmann.display import Display, load_display
from lippmann.errors import InputError
from lippmann.film.cluster import render_on_cluster
from lippmann.film.film import Film, load_film
from lippmann.film.frames import check_folder, frame_path, write_frames
from lippmann.film.shot import Shot, render_shot, shots_of
from lippmann.film.video import LOSSLESS_SUFFIXES, VIEW_SUFFIXES, write_video
from lippmann.images import Radiance, check_output, encoded_values
from lippmann.integral_image import IntegralImage
from lippmann.observer import Eye, observe, whole_window
from lippmann.rendering.integral import RenderOptions
from lippmann.rendering.placement import SCALE_RANGE
from lippmann.rendering.renderer import BASE_MEMORY_MB, check_memory, check_memory_mb
from lippmann.rendering.scene import check_scene_file
from lippmann.rendering.sources import Window
from lippmann.variant import start_mitsuba

MAX_VIEW_PX = 4096
#: Most frames a second of a GIF: viewers show each for at least 20 ms.
GIF_SPEED = 50.0


@click.command("animate")
@click.argument("film_path", metavar="FILM")
@display_option
@click.option("-o", "output", required=True, metavar="FOLDER", help="The frames' folder; made when missing.")
@click.option(
    "--scale",
    type=click.FloatRange(*SCALE_RANGE),
    default=1.0,
    show_default=True,
    help="Factor on the whole film, about the display's centre.",
)
@render_options
@click.option("--video", metavar="FILE.mkv", help="The panel's frames as a lossless video.")
@click.option("--view", metavar="FILE", help="What an eye sees of the film: .mp4, .gif or .png.")
@click.option("--eye", type=Vector(3), help="The eye of --view, mm; the display is at z = 0.")
@click.option("--width", type=click.IntRange(2, MAX_VIEW_PX), help=f"Pixels of --view.  [default: {api.VIEW_PX}]")
@click.option("--cluster", metavar="ADDRESS", help="Render on the workers of this Dask scheduler: tcp://HOST:8786.")
@seed_option
@device_option
@json_option
def command(
    film_path: str,
    display_path: str,
    output: str,
    scale: float,
    options: RenderOptions,
    video: str | None,
    view: str | None,
    eye: tuple[float, float, float] | None,
    width: int | None,
    cluster: str | None,
    device: str,
    as_json: bool,
) -> None:
    """Render a film, frame by frame, for a display.

    Existing frames of the same scene, display and options are kept: after an interruption the same command continues.

    Example: lippmann animate scenes/films/swim.toml --display scenes/displays/paper-square.toml -o out/swim
    """
    if (view is None) != (eye is None):
        raise InputError("--view and --eye belong together; give both or neither")
    if width is not None and view is None:
        raise InputError("--width belongs to --view; give both or neither")
    film = load_film(film_path)
    display = load_display(display_path)
    looker = None if eye is None else Eye(eye)
    check_memory(display.panel.width_px, display.panel.height_px, options.settings)
    check_scene_file(film.scene)
    folder = Path(output)
    check_folder(folder, film.frames)
    if video is not None:
        check_output(video, LOSSLESS_SUFFIXES)
    if view is not None:
        suffix = check_output(view, VIEW_SUFFIXES + ANIMATION_SUFFIXES).suffix.lower()
        if suffix == ".gif" and film.frames_per_second > GIF_SPEED:
            raise InputError(f"{view}: a GIF shows at most {GIF_SPEED:g} frames a second; choose .mp4, .png or .apng")
        seen = _view_window(display, width)
        kept = film.frames if suffix in ANIMATION_SUFFIXES else 1
        check_memory_mb(
            BASE_MEMORY_MB + animation_mb(kept, seen.width_px, seen.height_px),
            options.settings.memory_mb,
            f"{view}: {kept} frames of {seen.width_px} x {seen.height_px} pixels in memory",
            "give a smaller --width, or an .mp4 file",
        )
    start_mitsuba(device)
    shots = shots_of(film, display, options, scale)

    def render(missing: Sequence[Shot]) -> Iterator[tuple[Shot, IntegralImage]]:
        if cluster is not None:
            return render_on_cluster(cluster, device, missing, log)
        return ((shot, render_shot(shot)) for shot in missing)

    started = time.perf_counter()
    with progress_bar("frames", quiet=as_json) as progress:
        rendered = write_frames(folder, shots, render, progress)
    seconds = time.perf_counter() - started
    if video is not None:
        _write_panel(folder, film, display, video)
    if view is not None and looker is not None:
        with progress_bar("view", quiet=as_json) as progress:
            _write_view(folder, film, display, looker, seen, view, progress)
    result = {
        "folder": str(folder),
        "film": film.name,
        "display": display.name,
        "identity": display.identity,
        "frames": film.frames,
        "frames_per_second": film.frames_per_second,
        "rendered": rendered,
        "kept": film.frames - rendered,
        "seconds": seconds,
        "video": video,
        "view": view,
    }

    def text() -> None:
        kept = f", {film.frames - rendered} kept" if rendered < film.frames else ""
        click.echo(
            f"{folder}: {film.frames} frames of {display.panel.width_px} x {display.panel.height_px}, "
            f"{rendered} rendered in {seconds:.1f} s{kept}"
        )
        for written in filter(None, (video, view)):
            click.echo(f"{written}: {film.frames / film.frames_per_second:.3g} s")

    emit(result, as_json, text)


def _images(folder: Path, film: Film, display: Display) -> Iterator[IntegralImage]:
    for frame in range(film.frames):
        yield IntegralImage.load(frame_path(folder, frame), display)


def _write_panel(folder: Path, film: Film, display: Display, path: str) -> None:
    """Write the panel's values as a video."""
    panel = display.panel
    frames = (panel_values(image.radiance, panel.transfer, panel.bits) for image in _images(folder, film, display))
    write_video(path, frames, panel.width_px, panel.height_px, film.frames_per_second)


def _view_window(display: Display, width: int | None) -> Window:
    """Return the window of --view; videos need even sides."""
    window = whole_window(display, width or api.VIEW_PX)
    return replace(window, width_px=_even(window.width_px), height_px=_even(window.height_px))


def _even(size: int) -> int:
    return size + size % 2


def _write_view(folder: Path, film: Film, display: Display, eye: Eye, window: Window, path: str, progress: Any) -> None:
    """Write what an eye sees of the film as a video or an animation."""

    def views() -> Iterable[Radiance]:
        for frame, image in enumerate(_images(folder, film, display)):
            yield observe(image.radiance, display, eye, window).radiance
            if progress is not None:
                progress(frame + 1, film.frames)

    if Path(path).suffix.lower() in VIEW_SUFFIXES:
        frames = (encoded_values(view, "srgb", 8) for view in views())
        write_video(path, frames, window.width_px, window.height_px, film.frames_per_second)
    else:
        write_animation(path, views(), there_and_back=False, frame_ms=1000.0 / film.frames_per_second)

"""Command `lippmann view`."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path

import click

from lippmann import api
from lippmann.base import interrupts
from lippmann.base.files import write_file
from lippmann.base.images import SUFFIXES, check_output, read_picture
from lippmann.cli.frame import KINDS, Name, argument, flag_of, make_command, option
from lippmann.cli.options import DEVICE, DISPLAY, FORCE, SEED, Point, finite
from lippmann.cli.options_rendering import MOVED, Moved
from lippmann.cli.output import emit, log
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error, located
from lippmann.eye.many_views import grid_of_eyes
from lippmann.eye.observer import Eye
from lippmann.eye.page_server import PageServer
from lippmann.eye.viewer_page import FRAMES_PER_SECOND, Direct, check_direct
from lippmann.motion.film_frames import FRAME_STEM
from lippmann.rendering.integral_image import IntegralImage
from lippmann.scenes.scene import check_scene_file


@make_command("view")
def command(
    image_path: Name = argument("IMAGE"),
    display: Display = DISPLAY,
    output: Path | None = option("Output page.  [default: IMAGE with .html]", metavar="PAGE.html"),
    direct: tuple[tuple[Point, Name], ...] = option(
        "Position of an eye, mm, and a picture rendered from there; can be repeated.",
        (),
        (KINDS[Point], KINDS[Name]),
        multiple=True,
        metavar="X,Y,Z PICTURE",
    ),
    scene_path: Path | None = option("Also show this scene's direct views from a grid of eyes.", metavar="SCENE"),
    moved: Moved = MOVED,
    frames_per_second: float = option("Frame rate of a film.", FRAMES_PER_SECOND, finite(0.1)),
    title: str | None = option("Heading of the page.  [default: the image's name]"),
    serve: bool = option("Serve the page until Ctrl-C instead of writing a file."),
    tcp_port: int = option("TCP port of --serve; 0 selects a free port.", 0, click.IntRange(0, 65535)),
    force: bool = FORCE,
    seed: int = SEED,
    device: str = DEVICE,
) -> None:
    """Create a browser page that shows an integral image.

    The page shows an eye's view through the lenslets. The page is one file, and needs
    WebGL 2 but no network. IMAGE can be a folder of frames from `lippmann animate`,
    which the page plays.

    Example: lippmann view fish.png --display scenes/displays/paper-square.toml -o
    fish.html
    """
    if moved.changes and scene_path is None:
        raise InputError(f"{flag_of(next(iter(moved.changes)))} belongs to --scene; give both or neither")
    path = _page_path(image_path, output, serve, tcp_port)
    scene = scene_path and check_scene_file(scene_path)
    image, *later = (IntegralImage.load(one, display, force) for one in frames_of(image_path))
    directs = [_read_direct(eye, path, display) for eye, path in direct]
    with progress_bar("direct views") if scene else nullcontext() as progress:
        placement, arrange = (moved.placement(scene), moved.arrange(scene)) if scene else (None, None)
        page = api.view_page(
            image, scene, directs, later=later, frames_per_second=frames_per_second,
            title=title or Path(image_path).stem, placement=placement, arrange=arrange, seed=seed, device=device,
            progress=progress,
        )  # fmt: skip
    count = len(directs) + (len(grid_of_eyes(display)) if scene else 0)
    result = {"bytes": len(page), "direct_views": count}
    if path is None:
        with PageServer(page, tcp_port) as server:
            emit({"url": server.url, **result}, f"{server.url} (Ctrl-C ends it)", display)
            sys.stdout.flush()
            try:
                server.serve_forever(poll_interval=0.1)
            except KeyboardInterrupt:
                interrupts.received.clear()
        log("the page is no longer served")
        return
    write_file(path, page)
    text = f"{path}: {len(page) / 1e6:.1f} MB, {count} direct views; open it in a browser"
    emit({"output": path, **result}, text, display)


def _page_path(image_path: str, output: Path | None, serve: bool, tcp_port: int) -> Path | None:
    if serve and output:
        raise InputError("--serve writes no file; leave out -o or --serve")
    if tcp_port and not serve:
        raise InputError("--tcp-port belongs to --serve; give both or neither")
    if serve:
        return None
    image = Path(image_path)
    default_path = (image.resolve() if image.is_dir() else image).with_suffix(".html")
    return check_output(output or default_path, api.PAGE_SUFFIXES)


def frames_of(path: str) -> list[str | Path]:
    """Return the paths of a film's frames in order, or the path of a single image."""
    if not Path(path).is_dir():
        return [path]
    files = sorted(Path(path).glob(f"{FRAME_STEM}*"))
    frames = [one for one in files if one.suffix.lower() in SUFFIXES]
    if not frames:
        what = f"is a folder without frames ({FRAME_STEM}0000.exr ...)"
        raise input_error(path, what, "render the frames with lippmann animate")
    return list(frames)


def _read_direct(eye: Point, path: str, display: Display) -> Direct:
    direct = Direct(Eye(eye).position_mm, read_picture(path).radiance)
    with located(path):
        check_direct(direct, display)
    return direct

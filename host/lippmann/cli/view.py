"""`lippmann view`: a page that shows an integral image through its lenslets, in a browser."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Any

import click

from lippmann import api, interrupts
from lippmann.cli.options.common import Vector, device_option, display_option, json_option, seed_option
from lippmann.cli.options.placement import placement_of, placement_options
from lippmann.cli.output import emit, log, progress_bar
from lippmann.display import Display, load_display
from lippmann.errors import InputError, LippmannError
from lippmann.images import check_output, read_picture, replacing
from lippmann.integral_image import IntegralImage
from lippmann.observer import Eye
from lippmann.rendering.scene import check_scene_file
from lippmann.viewer.direct import grid_of_eyes
from lippmann.viewer.page import Direct, check_direct
from lippmann.viewer.serve import page_server


@click.command("view")
@click.argument("image_path", metavar="IMAGE")
@display_option
@click.option("-o", "output", metavar="PAGE.html", help="The page.  [default: beside the image, named after it]")
@click.option(
    "--direct",
    "direct_paths",
    type=(Vector(3), str),
    multiple=True,
    metavar="X,Y,Z PICTURE",
    help="A direct render of the scene from that eye, through the panel's window; may be repeated.",
)
@click.option("--scene", "scene_path", metavar="SCENE", help="Render direct views of this scene from a grid of eyes.")
@placement_options
@click.option("--title", help="Heading of the page.  [default: the image's name]")
@click.option("--serve", is_flag=True, help="Serve the page on loopback until Ctrl-C, instead of writing it.")
@click.option("--tcp-port", type=click.IntRange(0, 65535), default=0, help="Port of --serve; 0: any free port.")
@click.option("--force", is_flag=True, help="Accept an image that was made for another display.")
@seed_option
@device_option
@json_option
def command(
    image_path: str,
    display_path: str,
    output: str | None,
    direct_paths: tuple[tuple[tuple[float, float, float], str], ...],
    scene_path: str | None,
    title: str | None,
    serve: bool,
    tcp_port: int,
    force: bool,
    seed: int,
    device: str,
    as_json: bool,
    moved: dict[str, Any],
) -> None:
    """Make a browser page that shows an integral image.

    The page shows what an eye sees through the lenslets. It is one file, and needs WebGL 2 but no network.

    Example: lippmann view fish.png --display scenes/displays/paper-square.toml -o fish.html
    """
    if serve and output is not None:
        raise InputError("--serve keeps the page in memory; leave out -o or --serve")
    if tcp_port and not serve:
        raise InputError("--tcp-port belongs to --serve; give both or neither")
    if moved and scene_path is None:
        raise InputError(f"--{next(iter(moved))} belongs to --scene; give both or neither")
    path = None if serve else check_output(output or str(Path(image_path).with_suffix(".html")), api.PAGE_SUFFIXES)
    display = load_display(display_path)
    scene = None if scene_path is None else check_scene_file(scene_path)
    image = IntegralImage.load(image_path, display, force)
    directs = [_read_direct(eye, place, display) for eye, place in direct_paths]
    with progress_bar("direct views", quiet=as_json or scene is None) as progress:
        placement = None if scene is None else placement_of(scene, moved)
        page = api.view_page(
            image, scene, directs, title=title or Path(image_path).stem, placement=placement, seed=seed, device=device,
            progress=progress,
        )  # fmt: skip
    count = len(directs) + (0 if scene is None else len(grid_of_eyes(display)))
    result = {"display": display.name, "identity": display.identity, "bytes": len(page), "direct_views": count}
    if path is None:
        _serve(page, tcp_port, result, as_json)
        return
    with replacing(path) as partial:
        partial.write_bytes(page)

    def text() -> None:
        click.echo(f"{path}: {len(page) / 1e6:.1f} MB, {count} direct views; open it in a browser")

    emit({"output": str(path), **result}, as_json, text)


def _read_direct(eye: tuple[float, float, float], path: str, display: Display) -> Direct:
    """Read a direct render; errors name its file."""
    position = Eye(eye).position_mm
    direct = Direct(position, read_picture(path).radiance)
    try:
        check_direct(direct, display)
    except LippmannError as error:
        raise InputError(f"{path}: {error}") from None
    return direct


def _serve(page: bytes, tcp_port: int, result: dict[str, object], as_json: bool) -> None:
    """Serve until Ctrl-C or SIGTERM."""
    signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGINT))
    with page_server(page, tcp_port) as server:
        url = f"http://{server.server_address[0]!s}:{server.server_address[1]}/"
        emit({"url": url, **result}, as_json, lambda: click.echo(f"{url} (Ctrl-C ends it)"))
        sys.stdout.flush()
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:
            interrupts.received.clear()
    log("the page is no longer served")

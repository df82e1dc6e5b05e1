"""`lippmann demo`: the whole product in one go, from the fish to the light that reaches the eye."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
import numpy as np
import numpy.typing as npt

from lippmann.animation import write_animation, write_contact_sheet
from lippmann.board.closed_loop import run_on_virtual_board
from lippmann.board.frames import panel_values
from lippmann.cli.options.common import device_option, json_option
from lippmann.cli.output import emit, log, progress_bar
from lippmann.display import Display, load_display
from lippmann.errors import DeviceError, InputError
from lippmann.images import decode, psnr_db, replacing, write_picture
from lippmann.observer import Eye, observe, whole_window
from lippmann.rendering.metadata import image_metadata
from lippmann.rendering.renderer import Settings, render_integral, render_view
from lippmann.rendering.scene import load_scene
from lippmann.variant import start_mitsuba
from lippmann.viewer.page import Direct, page_html

SCENE = "fish/fish.xml"
DISPLAY = "displays/paper-square.toml"
EYE_DISTANCE_MM = 600.0
#: How far the eye goes to each side, mm: the display's edges leave their viewing zone beyond.
REACH_MM = 30.0
FRAMES = 15
VIEW_WIDTH_PX = 500
VIEW_SAMPLES = 64
#: Side of the region in the panel's middle whose rays are compared, pixels.
REGION_PX = 512


@click.command("demo")
@click.option("--scenes", default="scenes", show_default=True, help="The project's folder of scenes.")
@click.option("-o", "output", default="out/demo", show_default=True, help="Folder for the results.")
@device_option
@json_option
def command(scenes: str, output: str, device: str, as_json: bool) -> None:
    """Render the fish, stream it to a virtual board, and look at what its panel shows.

    Example: lippmann demo
    """
    folder, out = Path(scenes), Path(output)
    if not (folder / SCENE).is_file():
        raise InputError(f"{folder / SCENE}: no such scene; run in the project's top folder, or give --scenes")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be made ({error.strerror}); choose another folder with -o") from None
    display = load_display(folder / DISPLAY)
    panel = display.panel
    start_mitsuba(device)
    scene = load_scene(folder / SCENE)
    settings = Settings(samples=4)
    with progress_bar("render", quiet=as_json) as progress:
        rendered = render_integral(scene, display, "exact", settings, progress)
    metadata = image_metadata(display, "exact", settings, SCENE)
    write_picture(out / "fish.exr", rendered.radiance, metadata)

    frame = panel_values(rendered.radiance, panel)
    columns, rows = _middle(panel.width_px), _middle(panel.height_px)
    with progress_bar("stream", quiet=as_json) as progress:
        loop = run_on_virtual_board(display, frame, columns, rows, progress, log)
    differ = int((loop.panel_frame != frame).sum())
    # From here on only what left for the panel is looked at.
    scanned = decode(loop.panel_frame / np.float32(255.0), panel.transfer).astype(np.float32)
    write_picture(out / "panel.png", scanned, metadata, panel.transfer, panel.bits)

    directs, decibels = _looked_at(scene, display, scanned, out, as_json)
    page = page_html(display, scanned, "The fish, as the virtual board's panel shows it", directs)
    with replacing(out / "index.html") as partial:
        partial.write_text(page, encoding="utf-8")
    result = {
        "display": display.name,
        "render_seconds": rendered.seconds,
        "rays_compared": loop.check.rays,
        "rays_equal": loop.check.equal,
        "stream_seconds": loop.sent.seconds,
        "bytes_per_second": loop.sent.rate,
        "resends": loop.sent.resends,
        "bytes": frame.size,
        "bytes_differ": differ,
        "crc_equal": loop.panel_crc == loop.sent.crc,
        "clocks": loop.clocks,
        "views": [{"eye_mm": direct.eye_mm, "psnr_db": psnr} for direct, psnr in zip(directs, decibels, strict=True)],
    }
    with replacing(out / "demo.json") as partial:
        partial.write_text(json.dumps(result, indent=2) + "\n")
    if not (loop.check.equal and differ == 0 and loop.panel_crc == loop.sent.crc):
        raise DeviceError(f"{out / 'demo.json'}: the board did not show what was rendered; please report this")

    def text() -> None:
        shares = ", ".join(f"{psnr:.1f}" for psnr in decibels)
        for what, where in (
            (f"rendered {panel.width_px} x {panel.height_px} pixels in {rendered.seconds:.1f} s", "fish.exr"),
            (f"the board traced {loop.check.rays} rays: every word is the integer twin's", ""),
            (f"streamed {frame.size / 1e6:.1f} MB in {loop.sent.seconds:.1f} s, {loop.sent.resends} tiles twice", ""),
            ("the panel shows it: 0 bytes differ, CRC-32 equal", "panel.png"),
            (f"three eyes see it through the lenslets, {shares} dB from the scene itself", "views.png"),
            ("the eye moves", "views.gif"),
            ("look yourself: open it in a browser, and move the eye with the mouse", "index.html"),
        ):
            click.echo(f"{what:<85}{out / where if where else ''}".rstrip())

    emit(result, as_json, text)


def _middle(size: int) -> tuple[int, int]:
    """Return first and last pixel of a region in the middle of a panel's side."""
    width = min(REGION_PX, size)
    first = (size - width) // 2
    return first, first + width - 1


def _looked_at(
    scene: Any, display: Display, radiance: npt.NDArray[np.float32], out: Path, quiet: bool
) -> tuple[list[Direct], list[float]]:
    """Write what eyes see of a panel, moving and beside the scene itself.

    Return the direct renders of three eyes, and the PSNR of their views, dB.
    """
    window = whole_window(display, VIEW_WIDTH_PX)
    eyes = [(float(x), 0.0, EYE_DISTANCE_MM) for x in np.linspace(-REACH_MM, REACH_MM, FRAMES)]
    views = []
    with progress_bar("observe", quiet=quiet) as progress:
        for k, eye in enumerate(eyes):
            views.append(observe(radiance, display, Eye(eye), window).radiance)
            if progress is not None:
                progress(k + 1, FRAMES)
    write_animation(out / "views.gif", views)
    chosen = range(0, FRAMES, (FRAMES - 1) // 2)
    direct = [render_view(scene, eyes[k], window, Settings(samples=4)).radiance for k in chosen]
    captions = [f"through the lenslets, eye at x = {eyes[k][0]:+.0f} mm" for k in chosen]
    write_contact_sheet(out / "views.png", [views[k] for k in chosen] + direct, captions + ["the scene itself"] * 3)
    # A view has no more detail than one pixel a lenslet.
    coarse = whole_window(display)
    decibels = []
    for k in chosen:
        seen = observe(radiance, display, Eye(eyes[k]), coarse, VIEW_SAMPLES).radiance
        itself = render_view(scene, eyes[k], coarse, Settings(samples=VIEW_SAMPLES)).radiance
        decibels.append(psnr_db(seen, itself))
    return [Direct(eyes[k], radiance) for k, radiance in zip(chosen, direct, strict=True)], decibels

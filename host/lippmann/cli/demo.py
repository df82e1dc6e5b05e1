"""`lippmann demo`: the whole product at once, from a scene to the light that reaches the eye."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from lippmann import api
from lippmann.base.animation import write_animation, write_contact_sheet
from lippmann.base.files import make_folder, replacing
from lippmann.base.images import Radiance
from lippmann.base.progress import report_each
from lippmann.base.tones import decode, psnr_db
from lippmann.board.panel_frames import panel_values
from lippmann.board.virtual_loop import run_on_virtual_board
from lippmann.cli.demo_drawn import EYE_DISTANCE_MM, REACH_MM, draw_films
from lippmann.cli.frame import make_command, option
from lippmann.cli.options.common import DEVICE, SCENES, Point
from lippmann.cli.output import emit
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import load_display
from lippmann.errors import DeviceError, InputError
from lippmann.eye.observer import whole_window
from lippmann.eye.viewer_page import Direct, page_html
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.renderer import Settings, render_view
from lippmann.rendering.sources import Window
from lippmann.scenes.scene import Scene

SCENE = "fish/fish.xml"
DISPLAY = "displays/paper-square.toml"
FRAMES = 15
VIEW_WIDTH_PX = 500
VIEW_SAMPLES = 64
#: Side of the region in the panel's centre whose rays are compared, pixels.
REGION_PX = 512


@make_command("demo")
def command(
    scenes: str = SCENES,
    output: str = option("Folder for the results.", "out/demo", flag="-o"),
    device: str = DEVICE,
) -> None:
    """Run the main steps once: render, stream, draw, observe.

    Renders the fish and streams it to a virtual board. A second board draws films of layers by itself. Computes what an
    eye sees of both panels.

    Example: lippmann demo
    """
    folder, out = Path(scenes), Path(output)
    if not (folder / SCENE).is_file():
        raise InputError(f"{folder / SCENE}: no such scene; run in the project's top folder, or give --scenes")
    make_folder(out, "choose another folder with -o")
    display = load_display(folder / DISPLAY)
    panel = display.panel
    scene = api.load_scene(folder / SCENE, device=device)
    with progress_bar("render") as progress:
        image = api.render(scene, display, model="exact", device=device, progress=progress)
    image.save(out / "fish.exr")

    frame = panel_values(image.radiance, panel.transfer, panel.bits)
    columns, rows = _middle(panel.width_px), _middle(panel.height_px)
    with progress_bar("stream") as progress:
        loop = run_on_virtual_board(display, frame, columns, rows, progress)
    differ = int((loop.panel_frame != frame).sum())
    # From here on only the frame that was scanned out counts.
    scanned = replace(image, radiance=decode(loop.panel_frame / np.float32(255.0), panel.transfer))
    scanned.save(out / "panel.png")

    directs, decibels = _views(scene, scanned, out, device)
    drawn = draw_films(folder, out, device)
    page = page_html(display, scanned.radiance, "The fish, as the virtual board's panel shows it", directs)
    with replacing(out / "index.html") as partial:
        partial.write_text(page, encoding="utf-8")
    result = {
        "display": display.name,
        "render_seconds": image.measured["seconds"],
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
        "drawn": drawn,
    }
    with replacing(out / "demo.json") as partial:
        partial.write_text(json.dumps(result, indent=2) + "\n")
    if not (loop.check.equal and differ == 0 and loop.panel_crc == loop.sent.crc):
        raise DeviceError(f"{out / 'demo.json'}: the board did not show what was rendered; please report this")
    if any(film["pixels_differ"] or film["underflows"] for film in drawn.values()):
        raise DeviceError(f"{out / 'demo.json'}: the board did not draw what the twin draws; please report this")

    shares = ", ".join(f"{psnr:.1f}" for psnr in decibels)
    steps = (
        (f"rendered {panel.width_px} x {panel.height_px} pixels in {image.measured['seconds']:.1f} s", "fish.exr"),
        (f"the board traced {loop.check.rays} rays: every word equals the integer twin's", ""),
        (f"streamed {frame.size / 1e6:.1f} MB in {loop.sent.seconds:.1f} s, {loop.sent.resends} tiles twice", ""),
        ("the panel shows it: 0 bytes differ, CRC-32 equal", "panel.png"),
        (f"three eyes see it through the lenslets, {shares} dB from the scene itself", "views.png"),
        ("the eye moves", "views.gif"),
        *(
            (
                f"a board drew the {name} by itself: 0 of {film['pixels'] / 1e6:.1f} M pixels differ from the twin's",
                f"drawn-{name}.gif",
            )
            for name, film in drawn.items()
        ),
        ("open it in a browser and move the eye with the mouse", "index.html"),
    )
    emit(result, (f"{what:<85}{out / where if where else ''}".rstrip() for what, where in steps))


def _middle(size: int) -> tuple[int, int]:
    """Return first and last pixel of a region in the middle of a panel's side."""
    width = min(REGION_PX, size)
    first = (size - width) // 2
    return first, first + width - 1


def _views(scene: Scene, image: IntegralImage, out: Path, device: str) -> tuple[list[Direct], list[float]]:
    """Write what eyes see of a panel: an animation, and three views beside direct renders of the scene.

    Return the direct renders, and the PSNR of the three views against them, dB.
    """
    window, coarse = whole_window(image.display, VIEW_WIDTH_PX), whole_window(image.display)

    def seen(eye: Point, window: Window, samples: int = 16) -> Radiance:
        return api.observe(image, eye, window=window, samples=samples, device=device).radiance

    def direct(eye: Point, window: Window, samples: int) -> Radiance:
        return render_view(scene, eye, window, Settings(samples=samples)).radiance

    eyes = [(float(x), 0.0, EYE_DISTANCE_MM) for x in np.linspace(-REACH_MM, REACH_MM, FRAMES)]
    with progress_bar("observe") as progress:
        views = [seen(eye, window) for eye in report_each(eyes, progress)]
    write_animation(out / "views.gif", views)
    chosen = range(0, FRAMES, (FRAMES - 1) // 2)
    directs = [Direct(eyes[k], direct(eyes[k], window, 4)) for k in chosen]
    captions = [f"through the lenslets, eye at x = {eyes[k][0]:+.0f} mm" for k in chosen]
    pictures = [views[k] for k in chosen] + [one.radiance for one in directs]
    write_contact_sheet(out / "views.png", pictures, captions + ["the scene itself"] * 3)
    # The view's resolution is one pixel for each lenslet.
    decibels = [psnr_db(seen(eyes[k], coarse, VIEW_SAMPLES), direct(eyes[k], coarse, VIEW_SAMPLES)) for k in chosen]
    return directs, decibels

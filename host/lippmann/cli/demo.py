"""Command `lippmann demo`."""

from __future__ import annotations

import contextlib
import json
import math
import threading
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lippmann import api
from lippmann.base.animation import write_animation, write_contact_sheet
from lippmann.base.files import make_folder, write_file
from lippmann.base.progress_protocol import Progress
from lippmann.base.tones import decode, psnr_db
from lippmann.board.board import check_rays
from lippmann.board.drawn_scene import SceneBoard
from lippmann.board.film_player import load_textures, play_film
from lippmann.board.panel_frames import panel_values
from lippmann.board.streaming import send_frame
from lippmann.board.virtual_loop import capturing, frames_differ
from lippmann.cli.frame import Folder, make_command, option
from lippmann.cli.options import DEVICE, SCENES
from lippmann.cli.output import emit, log
from lippmann.cli.progress_bar import progress_bar, with_progress
from lippmann.display.description import Display, Panel, load_display
from lippmann.errors import DeviceError, InputError
from lippmann.eye.many_views import image_viewer, scene_viewer
from lippmann.eye.observer import Eye, whole_window
from lippmann.eye.viewer_page import Direct, page_html
from lippmann.fixed.drawn_frame import draw
from lippmann.fixed.scene_build import SceneBuild
from lippmann.motion.layer_film import LayerFilm, load_layer_film
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.options import Settings
from lippmann.scenes.scene import Scene
from lippmann.simulation.virtual_board import board_build, compile_board

SCENE = "fish/fish.xml"
DISPLAY = "displays/paper-square.toml"
DRAWN_DISPLAY = "displays/vga-square.toml"
#: Files that the board draws, keyed by name: a film of layers, and static layers.
FILMS = {"fish": "films/swim-layers.toml", "chart": "layers/chart"}
EYE_DISTANCE_MM = 600.0
#: Maximum movement of the eye to each side, mm.
REACH_MM = 30.0
FRAMES = 15
#: Number of views of static layers; a film has one view per frame.
STILL_VIEWS = 16
VIEW_WIDTH_PX, DRAWN_VIEW_WIDTH_PX = 500, 400
VIEW_SAMPLES = 64
#: Side length of the central region of compared rays, pixels.
REGION_PX = 512

#: Frames that a board drew, and figures of the drawing; keyed by film.
Drawn = dict[str, tuple[list[IntegralImage], dict[str, Any]]]


@make_command("demo")
def command(
    scenes: str = SCENES,
    output: Folder = option("Output folder for the results.", Path("out/demo")),
    device: str = DEVICE,
) -> None:
    """Run the main steps once: render, stream, draw and observe.

    The rendered fish is streamed to a virtual board. A second board draws layers by
    itself. An eye observes both panels.

    Example: lippmann demo
    """
    folder, out = Path(scenes), output
    if not (folder / SCENE).is_file():
        raise InputError(f"{folder / SCENE}: no such scene; run in the project's top folder, or give --scenes")
    make_folder(out, "choose another folder with -o")
    display = load_display(folder / DISPLAY)
    panel = display.panel
    scene = api.load_scene(folder / SCENE, device=device)
    with _draw_in_background(display, folder) as films:
        image = _render(scene, display, out, device)
        frame = panel_values(image.radiance, panel.transfer, panel.bits)
        columns, rows = _middle(panel.width_px), _middle(panel.height_px)
        log("starting the virtual board (first start: half a minute) ...")
        with progress_bar("stream") as progress, capturing(display) as captured:
            check = check_rays(captured.board, display, columns, rows)
            transfer = send_frame(captured.board, frame, progress)
            crc_equal = captured.board.panel_crc() == transfer.crc
        # The views show the scanned-out frame.
        pixels = captured.frames[-1]
        scanned = replace(image, radiance=decode(pixels / np.float32(255.0), panel.transfer))
        scanned.save(out / "panel.png")
        directs, decibels = _views(scene, scanned, out)
        log("waiting for the virtual board that draws ...")
        drawn = films.result()
    _film_views(drawn, out)
    page = page_html(display, scanned.radiance, "The fish, as the virtual board's panel shows it", directs)
    write_file(out / "index.html", page)
    result = {
        "display": display.name,
        "render_seconds": image.measured["seconds"],
        "rays_compared": check.rays,
        "rays_equal": check.equal,
        "stream_seconds": transfer.seconds,
        "bytes_per_second": transfer.rate,
        "resends": transfer.resends,
        "bytes": frame.size,
        "bytes_differ": int((pixels != frame).sum()),
        "crc_equal": crc_equal,
        "clocks": captured.counts["clocks"],
        "views": [{"eye_mm": direct.eye_mm, "psnr_db": psnr} for direct, psnr in zip(directs, decibels, strict=True)],
        "drawn": {name: film for name, (_, film) in drawn.items()},
    }
    write_file(out / "demo.json", json.dumps(result, indent=2) + "\n")
    if not (result["rays_equal"] and result["bytes_differ"] == 0 and result["crc_equal"]):
        raise DeviceError(f"{out / 'demo.json'}: the board's frame differs from the render; please report this")
    if any(film["pixels_differ"] or film["underflows"] for film in result["drawn"].values()):
        raise DeviceError(f"{out / 'demo.json'}: board and twin drew different frames; please report this")
    emit(result, (f"{what:<85}{out / where if where else ''}".rstrip() for what, where in _steps(result, panel)))


def _render(scene: Scene, display: Display, out: Path, device: str) -> IntegralImage:
    with progress_bar("render") as progress:
        image = api.render(scene, display, model="exact", device=device, progress=progress)
    image.save(out / "fish.exr")
    image.save(out / "fish.png")
    log(f"the first picture is ready: {out / 'fish.png'} (zoom in to see the lenslets)")
    return image


@contextlib.contextmanager
def _draw_in_background(streamed: Display, scenes: Path) -> Iterator[Future[Drawn]]:
    """Compile the board for display `streamed`, then draw the films, while the `with` block runs."""
    over = threading.Event()

    def stop_if_over(steps: int, total: int) -> None:
        if over.is_set():
            raise CancelledError

    with ThreadPoolExecutor(1) as background:
        background.submit(compile_board, streamed)
        films = background.submit(_draw_films, scenes, stop_if_over)
        try:
            yield films
        finally:
            over.set()
            films.cancel()


def _steps(result: dict[str, Any], panel: Panel) -> Iterator[tuple[str, str]]:
    yield f"rendered {panel.width_px} x {panel.height_px} pixels in {result['render_seconds']:.1f} s", "fish.png"
    yield "the same in linear radiance", "fish.exr"
    yield f"the board traced {result['rays_compared']} rays: every word equals the integer twin's", ""
    rate = f"{result['bytes'] / 1e6:.1f} MB in {result['stream_seconds']:.1f} s"
    yield f"streamed {rate}, {result['resends']} tiles twice", ""
    yield "the panel shows it: 0 bytes differ, CRC-32 equal", "panel.png"
    decibels = ", ".join(f"{view['psnr_db']:.1f}" for view in result["views"])
    yield f"three eyes see it through the lenslets, {decibels} dB from the scene itself", "views.png"
    yield "the eye moves", "views.gif"
    for name, film in result["drawn"].items():
        pixels = f"0 of {film['pixels'] / 1e6:.1f} M pixels differ from the twin's"
        yield f"a board drew the {name} by itself: {pixels}", f"drawn-{name}.gif"
    yield "open it in a browser and move the eye with the mouse", "index.html"


def _middle(size: int) -> tuple[int, int]:
    width = min(REGION_PX, size)
    first = (size - width) // 2
    return first, first + width - 1


def _views(scene: Scene, image: IntegralImage, out: Path) -> tuple[list[Direct], list[float]]:
    window, coarse = whole_window(image.display, VIEW_WIDTH_PX), whole_window(image.display)
    eyes = [Eye((float(x), 0.0, EYE_DISTANCE_MM)) for x in np.linspace(-REACH_MM, REACH_MM, FRAMES)]
    views = list(map(image_viewer(image, window, 16), with_progress("observe", eyes)))
    write_animation(out / "views.gif", views)
    three = slice(0, FRAMES, (FRAMES - 1) // 2)
    view = scene_viewer(scene, window, Settings(samples=4))
    directs = [Direct(eye.position_mm, view(eye)) for eye in eyes[three]]
    captions = [f"through the lenslets, eye at x = {eye.position_mm[0]:+.0f} mm" for eye in eyes[three]]
    pictures = views[three] + [direct.radiance for direct in directs]
    write_contact_sheet(out / "views.png", pictures, captions + ["the scene itself"] * 3)
    # The PSNR compares views with one pixel per lenslet.
    panel_views = map(image_viewer(image, coarse, VIEW_SAMPLES), eyes[three])
    scene_views = map(scene_viewer(scene, coarse, Settings(samples=VIEW_SAMPLES)), eyes[three])
    return directs, list(map(psnr_db, panel_views, scene_views))


def _draw_films(scenes: Path, progress: Progress) -> Drawn:
    display = load_display(scenes / DRAWN_DISPLAY)
    return {name: _draw(display, load_layer_film(scenes / path), progress) for name, path in FILMS.items()}


def _film_views(drawn: Drawn, out: Path) -> None:
    for name, (panels, _) in drawn.items():
        window = whole_window(panels[0].display, DRAWN_VIEW_WIDTH_PX)
        count = len(panels) if len(panels) > 1 else STILL_VIEWS
        # Move the eye from left to right and back.
        eyes = [Eye((-REACH_MM * math.cos(math.tau * k / count), 0.0, EYE_DISTANCE_MM)) for k in range(count)]
        viewers = [image_viewer(panel, window, 16) for panel in panels]
        views = [viewers[k % len(panels)](eye) for k, eye in enumerate(with_progress("observe", eyes))]
        write_animation(out / f"drawn-{name}.gif", views, there_and_back=False)


def _draw(display: Display, film: LayerFilm, progress: Progress) -> tuple[list[IntegralImage], dict[str, Any]]:
    build = SceneBuild()
    with capturing(display, build) as captured:
        captured.board.panel_crc()  # wait until a black frame was scanned out
        scene = SceneBoard(captured.board)
        loaded, slots = load_textures(scene, display, film, progress)
        played = play_film(scene, display, film, slots, every_frame=True, progress=progress)
        captured.board.panel_crc()  # wait until the last frame was scanned out
    optics, frames = board_build(display, build), captured.frames[1:]
    drawn = [draw(display, optics, film.at(frame)[0], build) for frame in range(film.frames)]
    # Successive equal frames are captured only once.
    expected = [np.zeros_like(drawn[0])]
    expected += [one for one, before in zip(drawn, [*expected, *drawn], strict=False) if (one != before).any()]
    panels = [IntegralImage(decode(frame / np.float32(255.0), display.panel.transfer), display) for frame in frames]
    return panels, {
        "frames": played.frames,
        "pixels": len(frames) * display.panel.width_px * display.panel.height_px,
        "pixels_differ": frames_differ(captured.frames, expected),
        "underflows": played.underflows,
        "load_bytes": loaded.wire_bytes,
        "bytes": played.bytes,
        "most_bytes": played.most_bytes,
    }

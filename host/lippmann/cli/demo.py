"""`lippmann demo`: the whole product at once, from a scene to the light that reaches the eye."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lippmann import api
from lippmann.base.animation import write_animation, write_contact_sheet
from lippmann.base.files import make_folder, write_file
from lippmann.base.images import Radiance
from lippmann.base.progress import Progress
from lippmann.base.tones import decode, psnr_db
from lippmann.board.board import check_rays
from lippmann.board.drawn_scene import SceneBoard
from lippmann.board.film_player import load_textures, play_film
from lippmann.board.panel_frames import panel_values
from lippmann.board.streaming import send_frame
from lippmann.board.tiles import Pixels
from lippmann.board.virtual_loop import capturing, frames_differ
from lippmann.cli.frame import Folder, make_command, option
from lippmann.cli.options import DEVICE, SCENES, Point
from lippmann.cli.output import emit, log
from lippmann.cli.progress_bar import progress_bar, with_progress
from lippmann.display.description import Display, Panel, load_display
from lippmann.errors import DeviceError, InputError
from lippmann.eye.observer import whole_window
from lippmann.eye.viewer_page import Direct, page_html
from lippmann.fixed.drawn_frame import draw
from lippmann.fixed.scene_build import SceneBuild
from lippmann.motion.layer_film import LayerFilm, load_layer_film
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_view
from lippmann.rendering.sampling import Window
from lippmann.scenes.scene import Scene
from lippmann.simulation.virtual_board import board_build, compile_board

SCENE = "fish/fish.xml"
DISPLAY = "displays/paper-square.toml"
#: Display of the board that draws.
DRAWN_DISPLAY = "displays/vga-square.toml"
#: What is drawn, by the name of its results: a film of layers, and a folder of layers, which stands still.
FILMS = {"fish": "films/swim-layers.toml", "chart": "layers/chart"}
EYE_DISTANCE_MM = 600.0
#: Travel of the eye to each side, mm.
REACH_MM = 30.0
FRAMES = 15
#: Views of a film that stands still; of another one each frame is seen once.
STILL_VIEWS = 16
VIEW_WIDTH_PX, DRAWN_VIEW_WIDTH_PX = 500, 400
VIEW_SAMPLES = 64
#: Side of the region in the panel's centre whose rays are compared, pixels.
REGION_PX = 512


@make_command("demo")
def command(
    scenes: str = SCENES,
    output: Folder = option("Folder for the results.", Path("out/demo")),
    device: str = DEVICE,
) -> None:
    """Run the main steps once: render, stream, draw, observe.

    Renders the fish and streams it to a virtual board. A second board draws films of layers by itself. Computes what an
    eye sees of both panels.

    Example: lippmann demo
    """
    folder, out = Path(scenes), output
    if not (folder / SCENE).is_file():
        raise InputError(f"{folder / SCENE}: no such scene; run in the project's top folder, or give --scenes")
    make_folder(out, "choose another folder with -o")
    display = load_display(folder / DISPLAY)
    panel = display.panel
    scene = api.load_scene(folder / SCENE, device=device)
    with _boards_compile_meanwhile(display, load_display(folder / DRAWN_DISPLAY)):
        image = _render(scene, display, out, device)
        frame = panel_values(image.radiance, panel.transfer, panel.bits)
        columns, rows = _middle(panel.width_px), _middle(panel.height_px)
        log("starting the virtual board (compiled once, half a minute) ...")
        with progress_bar("stream") as progress, capturing(display) as captured:
            check = check_rays(captured.board, display, columns, rows)
            sent = send_frame(captured.board, frame, progress)
            crc_equal = captured.board.panel_crc() == sent.crc
        # From here on only the frame that was scanned out counts.
        shown = captured.frames[-1]
        scanned = replace(image, radiance=decode(shown / np.float32(255.0), panel.transfer))
        scanned.save(out / "panel.png")
        directs, decibels = _views(scene, scanned, out, device)
        drawn = _draw_films(folder, out, device)
    page = page_html(display, scanned.radiance, "The fish, as the virtual board's panel shows it", directs)
    write_file(out / "index.html", page)
    result = {
        "display": display.name,
        "render_seconds": image.measured["seconds"],
        "rays_compared": check.rays,
        "rays_equal": check.equal,
        "stream_seconds": sent.seconds,
        "bytes_per_second": sent.rate,
        "resends": sent.resends,
        "bytes": frame.size,
        "bytes_differ": int((shown != frame).sum()),
        "crc_equal": crc_equal,
        "clocks": captured.counts["clocks"],
        "views": [{"eye_mm": direct.eye_mm, "psnr_db": psnr} for direct, psnr in zip(directs, decibels, strict=True)],
        "drawn": drawn,
    }
    write_file(out / "demo.json", json.dumps(result, indent=2) + "\n")
    if not (result["rays_equal"] and result["bytes_differ"] == 0 and result["crc_equal"]):
        raise DeviceError(f"{out / 'demo.json'}: the board did not show what was rendered; please report this")
    if any(film["pixels_differ"] or film["underflows"] for film in drawn.values()):
        raise DeviceError(f"{out / 'demo.json'}: the board did not draw what the twin draws; please report this")
    emit(result, (f"{what:<85}{out / where if where else ''}".rstrip() for what, where in _steps(result, panel)))


def _render(scene: Scene, display: Display, out: Path, device: str) -> IntegralImage:
    """Render the scene, and write the first pictures that a user can look at."""
    with progress_bar("render") as progress:
        image = api.render(scene, display, model="exact", device=device, progress=progress)
    image.save(out / "fish.exr")
    image.save(out / "fish.png")
    log(f"the first picture is there: {out / 'fish.png'} (zoom in to find the lenslets)")
    return image


@contextlib.contextmanager
def _boards_compile_meanwhile(streamed: Display, drawn: Display) -> Iterator[None]:
    """Compile both virtual boards, one after the other, beside the work of the block.

    A board that is started meanwhile waits for its program, and raises the error of a compilation that failed.
    """
    with ThreadPoolExecutor(1) as background:
        boards = [background.submit(compile_board, streamed), background.submit(compile_board, drawn, SceneBuild())]
        try:
            yield
        finally:
            for board in boards:
                board.cancel()


def _steps(result: Mapping[str, Any], panel: Panel) -> Iterator[tuple[str, str]]:
    """Yield what the demo did, a sentence a step, and the file that shows it."""
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
    views = [seen(eye, window) for eye in with_progress("observe", eyes)]
    write_animation(out / "views.gif", views)
    chosen = range(0, FRAMES, (FRAMES - 1) // 2)
    directs = [Direct(eyes[k], direct(eyes[k], window, 4)) for k in chosen]
    captions = [f"through the lenslets, eye at x = {eyes[k][0]:+.0f} mm" for k in chosen]
    pictures = [views[k] for k in chosen] + [one.radiance for one in directs]
    write_contact_sheet(out / "views.png", pictures, captions + ["the scene itself"] * 3)
    # The view's resolution is one pixel for each lenslet.
    decibels = [psnr_db(seen(eyes[k], coarse, VIEW_SAMPLES), direct(eyes[k], coarse, VIEW_SAMPLES)) for k in chosen]
    return directs, decibels


def _draw_films(scenes: Path, out: Path, device: str) -> dict[str, dict[str, Any]]:
    """Have a virtual board draw the films, and write an animation of each, `drawn-NAME.gif`; return their figures.

    `scenes` is the folder of the scenes that ship, `out` that of the results.
    """
    display = load_display(scenes / DRAWN_DISPLAY)
    window = whole_window(display, DRAWN_VIEW_WIDTH_PX)
    log("starting a virtual board that draws (compiled once, half a minute) ...")
    results = {}
    for name, path in FILMS.items():
        film = load_layer_film(scenes / path)
        with progress_bar(f"draw the {name}") as progress:
            frames, results[name] = _draw(display, film, progress)
        panels = [IntegralImage(decode(frame / np.float32(255.0), display.panel.transfer), display) for frame in frames]
        count = len(panels) if film.frames > 1 else STILL_VIEWS
        # The eye goes from the left to the right and back.
        eyes = [(-REACH_MM * math.cos(2.0 * math.pi * k / count), 0.0, EYE_DISTANCE_MM) for k in range(count)]
        views = [
            api.observe(panels[k % len(panels)], eye, window=window, device=device).radiance
            for k, eye in enumerate(with_progress("observe", eyes))
        ]
        write_animation(out / f"drawn-{name}.gif", views, there_and_back=False)
    return results


def _draw(display: Display, film: LayerFilm, progress: Progress) -> tuple[list[Pixels], dict[str, Any]]:
    """Have a virtual board draw a film until its panel has shown every frame; return the frames, and their figures."""
    build = SceneBuild()
    with capturing(display, build) as captured:
        captured.board.panel_crc()  # a black frame has been scanned out
        scene = SceneBoard(captured.board)
        loaded, slots = load_textures(scene, display, film)
        played = play_film(scene, display, film, slots, every_frame=True, progress=progress)
        captured.board.panel_crc()  # and the last one
    optics, frames = board_build(display, build), captured.frames[1:]
    drawn = [draw(display, optics, film.at(frame)[0], build) for frame in range(film.frames)]
    # A frame like the one before it is captured once.
    expected = [np.zeros_like(drawn[0])]
    expected += [one for one, before in zip(drawn, [*expected, *drawn], strict=False) if (one != before).any()]
    return frames, {
        "frames": played.frames,
        "pixels": len(frames) * display.panel.width_px * display.panel.height_px,
        "pixels_differ": frames_differ(captured.frames, expected),
        "underflows": played.underflows,
        "load_bytes": loaded.wire_bytes,
        "bytes": played.bytes,
        "most_bytes": played.most_bytes,
    }

"""Command `lippmann live`."""

from __future__ import annotations

import contextlib
import time
from dataclasses import asdict

import click
import numpy as np

from lippmann.base.machine import peak_memory_mb
from lippmann.base.variant import start_mitsuba
from lippmann.board.streaming import Sender
from lippmann.cli.frame import Name, argument, flag_of, make_command, option
from lippmann.cli.options import DEVICE, DISPLAY, SEED, Point, finite
from lippmann.cli.options_port import BAUD, FORCE_BOARD, opened_board
from lippmann.cli.options_rendering import LIGHT, MOVED, Moved
from lippmann.cli.output import emit
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error
from lippmann.eye.observer import Eye, whole_window
from lippmann.layers.layers_and_pictures import is_layers
from lippmann.motion.film import Film, is_film, load_film
from lippmann.motion.film_frames import Reel, plan_film
from lippmann.motion.live_picture import MAX_SAMPLES, PANEL, VIEW, EyeView, LivePicture, LiveShow, Played
from lippmann.motion.live_windows import Hand, Screens, check_screens, screens
from lippmann.rendering.memory_estimate import check_display_memory
from lippmann.rendering.options import ModelOption, RenderOptions, Settings
from lippmann.rendering.plan import report_and_choose_model
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import check_scene_file

#: Width of the view for --eye, pixels.
VIEW_PX = 480


@make_command("live")
def command(
    scene_path: Name = argument("SCENE"),
    display: Display = DISPLAY,
    monitor: int | None = option("Number of the panel's monitor.  [default: a window]", kind=click.IntRange(0)),
    window: bool | None = option(
        "Show a window; --no-window uses only the board of --port.  [default: --window]", flag="--window/--no-window"
    ),
    port: str | None = option("Port of a board that also shows the picture.", metavar="URL"),
    baud: int | None = BAUD,
    force: bool = FORCE_BOARD,
    eye: Point | None = option("Position of an eye, mm; a second window shows its view."),
    turn: float = option("Rotate the scene, degrees per second.", 0.0),
    turn_seconds: float | None = option("Duration of the rotation, s.  [default: to the end]", kind=finite(0.0)),
    seconds: float | None = option("End after this time, s, with a complete picture.", kind=finite(0.0)),
    samples: int = option("Samples per pixel of a complete picture.", MAX_SAMPLES, click.IntRange(1)),
    model: ModelOption = option("Lens model; auto chooses the cheapest model at the start.", "auto"),
    settings: Settings = LIGHT,
    moved: Moved = MOVED,
    seed: int = SEED,
    device: str = DEVICE,
) -> None:
    """Show a scene on a display, and move the scene with mouse and keyboard.

    Drag to rotate; drag with the right button to shift; scroll to scale. Arrow keys
    rotate, or shift with the Shift key. PageUp moves the scene nearer, + and - scale, r
    resets, q or Escape ends. While the scene rests, the picture gains samples. Space
    stops a film; comma and full stop step through its frames.

    Example: lippmann live scenes/fish/fish.xml --display scenes/displays/vga-square.toml --eye 0,0,600
    """
    film, panel = _load_film(scene_path), display.panel
    path = check_scene_file(scene_path if film is None else film.scene)
    view = None if eye is None else EyeView(display, Eye(eye), whole_window(display, VIEW_PX))
    check_display_memory(display, settings, f"display '{display.name}'")
    _check_panels(display, monitor, port, window, eye)
    turn_seconds = seconds if (turn or film) and turn_seconds is None else turn_seconds
    start_mitsuba(device)
    options = RenderOptions(model=model, settings=settings)
    reel = None if film is None else Reel(plan_film(film, display, options, _film_scale(moved)), film.frames_per_second)
    scene = moved.load(path, display) if reel is None else reel.plans[0].load()
    lens_model = report_and_choose_model(scene, display, options)
    picture = LivePicture(scene, display, lens_model, settings)
    if view is not None:
        view.draw(np.zeros(panel.shape, np.float32), moving=True)  # compile the view
    hand = Hand(scene.placement, picture.middle_mm, panel.width_mm / panel.width_px)
    with contextlib.ExitStack() as stack:
        sender, checked = None, None if force else display
        if port is not None:
            sender = Sender(stack.enter_context(opened_board(port, baud, checked, "show it", True)))
        windows = Screens() if window is False else stack.enter_context(screens())
        opened = time.perf_counter()
        windows.open(PANEL, panel.size_px, monitor)
        if view is not None:
            windows.open(VIEW, (view.window.width_px, view.window.height_px))
        show = LiveShow(picture, hand, windows, view, None if sender is None else sender.send, reel)
        played = show.run(turn_deg=turn, moving_s=turn_seconds, seconds=seconds, samples=samples, opened=opened)
        if sender is not None:
            sender.finish()
    _emit_result(scene_path, display, lens_model, played, hand, port, sender)


def _emit_result(
    scene: str, display: Display, model: str, played: Played, hand: Hand, port: str | None, sender: Sender | None
) -> None:
    board = None
    if sender is not None:
        board = {"port": port, "frames": sender.frames, "tiles": sender.tiles, "wire_bytes": sender.wire_bytes}
    placement = str(hand.placement())
    result = {"scene": scene, "model": model, **asdict(played), "board": board, "placement": placement}
    moving = f"{played.frames} frames at {played.frames_per_second:.1f} a second, " if played.frames else ""
    end = f"{moving}{played.samples} samples at the end; final placement {placement}"
    text = f"first picture after {played.first_s:.2f} s; {end}"
    emit({**result, "peak_memory_mb": peak_memory_mb()}, text, display)


def _load_film(path: str) -> Film | None:
    if is_layers(path):
        raise input_error(path, "is a folder of layers", "play it on a board: lippmann play")
    return load_film(path) if is_film(path) else None


def _check_panels(
    display: Display, monitor: int | None, port: str | None, window: bool | None, eye: Point | None
) -> None:
    if monitor is not None and port is not None:
        raise InputError("--monitor and --port both name a panel; leave one out")
    if window is not None and monitor is not None:
        raise InputError("--monitor excludes --window and --no-window; leave one out")
    if window is False and (port is None or eye is not None):
        raise InputError("--no-window uses only a board; give --port, and leave out --eye")
    if window is not False:
        check_screens(display.panel.size_px, monitor)


def _film_scale(moved: Moved) -> float | None:
    for name in moved.changes.keys() - {"scale", "fit"}:
        raise InputError(f"{flag_of(name)} cannot place a film; use --scale, --fit, or the film's [world]")
    if moved.fit and moved.scale is not None:
        raise InputError("--scale and --fit both place the film; leave one out")
    scale = 1.0 if moved.scale is None else moved.scale
    return None if moved.fit else Placement(scale).scale  # `Placement` checks the scale's range

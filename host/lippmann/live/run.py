"""The loop of a live picture: obey, draw, show; refine while nothing moves."""

from __future__ import annotations

import statistics
import time
from collections import deque
from dataclasses import dataclass
from typing import Annotated

from lippmann import interrupts
from lippmann.display import Display
from lippmann.images import encoded_values
from lippmann.live.hand import Hand
from lippmann.live.picture import LivePicture
from lippmann.live.screens import Screens
from lippmann.live.sender import Sender
from lippmann.observer import Eye, observe
from lippmann.rendering.sources import Window
from lippmann.toml import documented, key

#: Samples at which a resting picture is done.
MOST_SAMPLES = 64
#: Names of the windows.
PANEL, VIEW = "panel", "eye's view"
#: Pause between two looks at mouse and keys while there is nothing to do, s.
LOOK_S = 0.01
#: Rays for each pixel of the eye's view, while the scene moves and while it rests.
VIEW_SAMPLES = (1, 8)


@dataclass(frozen=True)
class EyeView:
    """What is seen in the second window."""

    eye: Eye
    window: Window


@documented
@dataclass
class Played:
    """What a live picture came to."""

    first_s: Annotated[float, key("from the open window to its first picture")] = 0.0
    frames: Annotated[int, key("pictures of the moving scene")] = 0
    frames_per_second: Annotated[float, key("of the moving scene, from the median frame; 0 without one")] = 0.0
    slowest_s: Annotated[float, key("its slowest frame")] = 0.0
    block: Annotated[int, key("side of the blocks of pixels that get one ray while it moves")] = 1
    samples: Annotated[int, key("for each pixel of the last picture")] = 0
    seconds: Annotated[float, key("from the first picture to the end")] = 0.0


def run_live(
    picture: LivePicture,
    hand: Hand,
    screens: Screens,
    display: Display,
    *,
    view: EyeView | None = None,
    sender: Sender | None = None,
    turn_deg: float = 0.0,
    moving_s: float | None = None,
    seconds: float | None = None,
    most: int = MOST_SAMPLES,
    opened: float | None = None,
) -> Played:
    """Show a scene until the user ends it, or for some seconds.

    With `turn_deg` it turns by itself, degrees a second, for `moving_s` seconds (None: to the end). `seconds` of None
    waits for the user; else the picture is refined to `most` samples before the end. `opened` is when the window was
    opened, by time.perf_counter.
    """
    played = Played(block=picture.block)
    began = last = time.perf_counter()
    opened = began if opened is None else opened
    times: deque[float] = deque(maxlen=1000)
    shown: object = None

    def present(moving: bool) -> None:
        pixels = picture.values
        rate = f"{1.0 / max(times[-1], 1e-3):.0f} frames/s" if moving and times else "at rest"
        rays = (
            f"1 ray for {picture.block} x {picture.block} pixels"
            if moving and picture.block > 1
            else (f"{max(picture.samples, 1)} sample{'s' * (picture.samples > 1)}")
        )
        title = f"Lippmann: {rate}, {rays}"
        screens.show(PANEL, pixels, title)
        if view is not None:
            seen = observe(picture.radiance, display, view.eye, view.window, VIEW_SAMPLES[not moving])
            screens.show(VIEW, encoded_values(seen.radiance, "srgb", 8).astype("uint8"), title)
        if sender is not None:
            sender.send(pixels)

    while screens.obey(hand):
        interrupts.check()
        now = time.perf_counter()
        if turn_deg and (moving_s is None or now - began < moving_s):
            hand.turn(turn_deg * (now - last))
        last, placement = now, hand.placement()
        done = picture.samples >= most
        if placement != shown:
            started = time.perf_counter()
            picture.quick(placement)
            present(True)
            taken = time.perf_counter() - started
            if shown is None:
                played.first_s = time.perf_counter() - opened
            else:
                played.frames += 1
                times.append(taken)
            shown = placement
        elif not done:
            if picture.finer(screens.waiting):
                present(False)
        elif seconds is not None and now - began >= seconds:
            break
        else:
            time.sleep(LOOK_S)
    played.seconds, played.samples = time.perf_counter() - began, picture.samples
    if times:
        played.frames_per_second = 1.0 / statistics.median(times)
        played.slowest_s = max(times)
    return played

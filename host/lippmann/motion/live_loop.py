"""The loop of a live picture: obey, draw, show; refine while nothing moves."""

from __future__ import annotations

import statistics
import time
from collections import deque
from dataclasses import dataclass
from typing import Annotated, Protocol

from lippmann.base import interrupts
from lippmann.base.fullscreen import Pixels
from lippmann.base.toml import documented, key
from lippmann.base.tones import encoded_values
from lippmann.display.description import Display
from lippmann.eye.observer import Eye, observe
from lippmann.motion.film_frames import Reel
from lippmann.motion.live_picture import LivePicture
from lippmann.motion.screens import Hand, Screens
from lippmann.rendering.sampling import Window

#: Samples at which a resting picture is done.
MOST_SAMPLES = 64
#: A film's frame, and what the hand has done.
Moment = tuple[int, tuple[float, ...]]
#: Most memory for pictures of a film's frames.
KEPT_BYTES = 1 << 30
#: Names of the windows.
PANEL, VIEW = "panel", "eye's view"
#: Pause between two looks at mouse and keys while there is nothing to do, s.
LOOK_S = 0.01
#: Rays for each pixel of the eye's view, while the scene moves and while it rests.
VIEW_SAMPLES = (1, 8)


class FrameSender(Protocol):
    """Whoever shows the panel's pictures elsewhere, such as on a board."""

    def send(self, pixels: Pixels) -> None:
        """Show a picture (height, width, 3) uint8."""


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
    frames: Annotated[int, key("pictures of the moving scene, or of the film")] = 0
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
    sender: FrameSender | None = None,
    reel: Reel | None = None,
    turn_deg: float = 0.0,
    moving_s: float | None = None,
    seconds: float | None = None,
    most: int = MOST_SAMPLES,
    opened: float | None = None,
) -> Played:
    """Show a scene, or a film's frames, until the user ends it, or for some seconds.

    With `turn_deg` it turns by itself, degrees a second, for `moving_s` seconds (None: to the end); so long a film
    plays. `seconds` of None waits for the user; else the picture is refined to `most` samples before the end. `opened`
    is when the window was opened, by time.perf_counter.
    """
    began = last = time.perf_counter()
    opened = began if opened is None else opened
    stage, shower = _Stage(picture, hand, reel), _Shower(picture, screens, display, view, sender)
    while screens.obey(hand, reel):
        interrupts.check()
        now = time.perf_counter()
        moving = moving_s is None or now - began < moving_s
        if moving:
            hand.turn(turn_deg * (now - last))
        if reel is not None:
            reel.playing = reel.playing and moving
            reel.advance(now - last)
        last = now
        moment = (0 if reel is None else reel.frame, hand.motion)
        if moment != shower.shown:
            shower.show(moment, stage, keep=reel is not None)
        elif reel is not None and reel.playing:
            time.sleep(LOOK_S)
        elif stage.drawn != moment:  # it was shown from memory
            stage.draw(moment)
        elif picture.samples < most:
            if picture.finer(screens.waiting):
                shower.refresh()
        elif seconds is not None and now - began >= seconds:
            break
        else:
            time.sleep(LOOK_S)
    return shower.played(opened, began)


class _Stage:
    """What the picture has before it: a moment of a film, or of a scene moved by hand."""

    def __init__(self, picture: LivePicture, hand: Hand, reel: Reel | None) -> None:
        self._picture, self._hand, self._reel = picture, hand, reel
        self._frame = -1
        self.drawn: Moment | None = None

    def draw(self, moment: Moment) -> None:
        """Draw the quick picture of a moment whose motion is the hand's."""
        frame, _ = moment
        if self._reel is not None and frame != self._frame:
            scene = self._reel.scene(frame)
            if scene is not None:
                self._picture.stage(scene)
            self._hand.base = self._reel.placement(frame) if scene is None else scene.placement
            self._frame = frame
        self._picture.quick(self._hand.placement())
        self.drawn = moment


class _Kept:
    """Pictures of a film's frames, as long as the hand does not move and there is room."""

    def __init__(self) -> None:
        self._motion: tuple[float, ...] = ()
        self._pictures: dict[int, tuple[Pixels, Pixels | None]] = {}
        self._bytes = 0

    def get(self, moment: Moment) -> tuple[Pixels, Pixels | None] | None:
        frame, motion = moment
        return self._pictures.get(frame) if motion == self._motion else None

    def put(self, moment: Moment, pictures: tuple[Pixels, Pixels | None]) -> None:
        frame, motion = moment
        if motion != self._motion:
            self._motion, self._bytes = motion, 0
            self._pictures.clear()
        self._bytes += sum(one.nbytes for one in pictures if one is not None)
        if self._bytes <= KEPT_BYTES:
            self._pictures[frame] = pictures


class _Shower:
    """Puts pictures on screens and board, and counts them."""

    def __init__(
        self, picture: LivePicture, screens: Screens, display: Display, view: EyeView | None, sender: FrameSender | None
    ) -> None:
        self._picture, self._screens, self._display = picture, screens, display
        self._view, self._sender = view, sender
        self._kept = _Kept()
        self._times: deque[float] = deque(maxlen=1000)
        self._frames, self._first = 0, 0.0
        self.shown: Moment | None = None

    def show(self, moment: Moment, stage: _Stage, keep: bool) -> None:
        """Show a moment, drawn on a stage, or as it was kept."""
        began = time.perf_counter()
        pictures = self._kept.get(moment)
        if pictures is None:
            stage.draw(moment)
            pictures = self._pictures(moving=True)
            if keep:
                self._kept.put(moment, pictures)
        rate = f"{1.0 / max(self._times[-1], 1e-3):.0f} frames/s" if self._times else "at rest"
        block = self._picture.block
        self._present(pictures, f"{rate}, 1 ray for {f'{block} x {block} pixels' if block > 1 else 'each pixel'}")
        ended = time.perf_counter()
        if self.shown is None:
            self._first = ended
        else:
            self._frames += 1
            self._times.append(ended - began)
        self.shown = moment

    def refresh(self) -> None:
        """Show the picture, which has become finer."""
        self._present(self._pictures(moving=False), f"at rest, {self._picture.samples} samples")

    def played(self, opened: float, began: float) -> Played:
        """Return what was shown, since the window was opened and the loop began."""
        return Played(
            first_s=self._first - opened if self._first else 0.0,
            frames=self._frames,
            frames_per_second=1.0 / statistics.median(self._times) if self._times else 0.0,
            slowest_s=max(self._times, default=0.0),
            block=self._picture.block,
            samples=self._picture.samples,
            seconds=time.perf_counter() - began,
        )

    def _pictures(self, moving: bool) -> tuple[Pixels, Pixels | None]:
        """Return the panel's picture, and what the eye sees."""
        picture, view = self._picture, self._view
        if view is None:
            return picture.values, None
        seen = observe(picture.radiance, self._display, view.eye, view.window, VIEW_SAMPLES[not moving])
        return picture.values, encoded_values(seen.radiance, "srgb", 8).astype("uint8")

    def _present(self, pictures: tuple[Pixels, Pixels | None], state: str) -> None:
        for name, pixels in zip((PANEL, VIEW), pictures, strict=True):
            if pixels is not None:
                self._screens.show(name, pixels, f"Lippmann: {state}")
        if self._sender is not None:
            self._sender.send(pictures[0])

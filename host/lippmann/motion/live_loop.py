"""The loop of a live picture: obey, draw, show; refine while nothing moves."""

from __future__ import annotations

import statistics
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated

from lippmann.base import interrupts
from lippmann.base.fullscreen import Pixels
from lippmann.base.images import Radiance
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


@dataclass(frozen=True)
class EyeView:
    """What is seen in the second window."""

    display: Display
    eye: Eye
    window: Window

    def draw(self, radiance: Radiance, moving: bool) -> Pixels:
        """Return what the eye sees of the panel's radiance (height, width, 3)."""
        seen = observe(radiance, self.display, self.eye, self.window, VIEW_SAMPLES[not moving])
        return encoded_values(seen.radiance, "srgb", 8).astype("uint8")


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


@dataclass
class LiveShow:
    """A scene, or a film's frames, on screens and board, moved by hand."""

    picture: LivePicture
    hand: Hand
    screens: Screens
    view: EyeView | None = None
    #: Takes each picture of the panel to where else it is shown.
    send: Callable[[Pixels], None] | None = None
    reel: Reel | None = None
    #: What the screens show, and what the picture has before it.
    _shown: Moment | None = None
    _drawn: Moment | None = None
    _frame: int = -1
    #: Pictures of a film's frames, as long as the hand does not move and there is room.
    _kept: dict[Moment, list[Pixels]] = field(default_factory=dict)
    #: When the first picture was shown, by time.perf_counter, and the seconds of each further one.
    _first: float = 0.0
    _frames: int = 0
    _times: deque[float] = field(default_factory=lambda: deque(maxlen=1000))

    def run(
        self,
        *,
        turn_deg: float = 0.0,
        moving_s: float | None = None,
        seconds: float | None = None,
        most: int = MOST_SAMPLES,
        opened: float | None = None,
    ) -> Played:
        """Show it until the user ends it, or for some seconds.

        With `turn_deg` it turns by itself, degrees a second, for `moving_s` seconds (None: to the end); so long a film
        plays. `seconds` of None waits for the user; else the picture is refined to `most` samples before the end.
        `opened` is when the window was opened, by time.perf_counter.
        """
        began = last = time.perf_counter()
        picture, reel = self.picture, self.reel
        while self.screens.obey(self.hand, reel):
            interrupts.check()
            now = time.perf_counter()
            moving = moving_s is None or now - began < moving_s
            if moving:
                self.hand.turn(turn_deg * (now - last))
            if reel is not None:
                reel.playing = reel.playing and moving
                reel.advance(now - last)
            last = now
            moment = (0 if reel is None else reel.frame, self.hand.motion)
            if moment != self._shown:
                self._show(moment)
            elif reel is not None and reel.playing:
                time.sleep(LOOK_S)
            elif self._drawn != moment:  # it was shown from memory
                self._draw(moment)
            elif picture.samples < most:
                if picture.finer(self.screens.waiting):
                    self._present(self._pictures(moving=False), f"at rest, {picture.samples} samples")
            elif seconds is not None and now - began >= seconds:
                break
            else:
                time.sleep(LOOK_S)
        opened = began if opened is None else opened
        return Played(
            first_s=self._first - opened if self._first else 0.0,
            frames=self._frames,
            frames_per_second=1.0 / statistics.median(self._times) if self._times else 0.0,
            slowest_s=max(self._times, default=0.0),
            block=picture.block,
            samples=picture.samples,
            seconds=time.perf_counter() - began,
        )

    def _draw(self, moment: Moment) -> None:
        """Draw the quick picture of a moment whose motion is the hand's."""
        frame, _ = moment
        if self.reel is not None and frame != self._frame:
            scene = self.reel.scene(frame)
            if scene is not None:
                self.picture.stage(scene)
            self.hand.base = self.reel.placement(frame) if scene is None else scene.placement
            self._frame = frame
        self.picture.quick(self.hand.placement())
        self._drawn = moment

    def _show(self, moment: Moment) -> None:
        """Show a moment, as it was kept, or drawn."""
        began = time.perf_counter()
        if any(motion != moment[1] for _, motion in self._kept):
            self._kept.clear()
        pictures = self._kept.get(moment)
        if pictures is None:
            self._draw(moment)
            pictures = self._pictures(moving=True)
            kept_bytes = sum(one.nbytes for kept in [*self._kept.values(), pictures] for one in kept)
            if self.reel is not None and kept_bytes <= KEPT_BYTES:
                self._kept[moment] = pictures
        rate = f"{1.0 / max(self._times[-1], 1e-3):.0f} frames/s" if self._times else "at rest"
        block = self.picture.block
        self._present(pictures, f"{rate}, 1 ray for {f'{block} x {block} pixels' if block > 1 else 'each pixel'}")
        ended = time.perf_counter()
        if self._shown is None:
            self._first = ended
        else:
            self._frames += 1
            self._times.append(ended - began)
        self._shown = moment

    def _pictures(self, moving: bool) -> list[Pixels]:
        """Return the panel's picture, and what the eye sees."""
        panel = [self.picture.values]
        return panel if self.view is None else [*panel, self.view.draw(self.picture.radiance, moving)]

    def _present(self, pictures: list[Pixels], state: str) -> None:
        """Show the panel's picture, and what the eye sees."""
        for name, pixels in zip((PANEL, VIEW), pictures, strict=False):
            self.screens.show(name, pixels, f"Lippmann: {state}")
        if self.send is not None:
            self.send(pictures[0])

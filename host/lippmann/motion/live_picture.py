"""Shows a scene's integral image, quickly while the scene moves, with more samples at rest."""

from __future__ import annotations

import statistics
import time
import timeit
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import numpy.typing as npt

from lippmann.base import interrupts
from lippmann.base.fullscreen import Pixels
from lippmann.base.images import Radiance
from lippmann.base.toml import documented, key
from lippmann.base.tones import BAND_ROWS, encoded_values
from lippmann.base.variant import Jit, current_device, dr, mi
from lippmann.display.description import Display, Panel
from lippmann.eye.observer import Eye, observe
from lippmann.motion.film_frames import Reel
from lippmann.motion.live_windows import Hand, Screens
from lippmann.optics.rays import Model
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import Renderer, radiance_of
from lippmann.rendering.sampling import RaySource, Window, display_source
from lippmann.scenes.placement import Matrix, Placement
from lippmann.scenes.scene import Scene

#: Bits of the float32 numbers 0 and 1. Positive floats and their bits have the same order.
ZERO, ONE = 0, 0x3F800000


def least_radiance(panel: Panel, bits: int) -> Radiance:
    """Return the minimum radiance of each level of a panel except the darkest, (2^bits - 1,)."""
    levels = values_of(bits)[1:]
    low, high = np.full(len(levels), ZERO), np.full(len(levels), ONE)
    while (high - low > 1).any():
        middle = (low + high) // 2
        reached = encoded_values(middle.astype(np.int32).view(np.float32), panel.transfer, bits) >= levels
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    return high.astype(np.int32).view(np.float32)


def values_of(bits: int) -> npt.NDArray[np.uint8]:
    """Return the 8-bit values (levels,) of the levels of a panel with at most 8 bits."""
    return encoded_values(np.linspace(0.0, 1.0, 1 << bits), "linear", bits).astype(np.uint8)


class Encoder:
    """Converts radiance planes to 8-bit values, as `encoded_values` does."""

    def __init__(self, panel: Panel) -> None:
        bits = min(panel.bits, 8)
        self._byte = getattr(dr, mi.variant().split("_")[0]).ad.UInt8
        self._shape = panel.shape
        self._least = mi.Float(least_radiance(panel, bits))
        self._values = self._byte(values_of(bits))
        dr.make_opaque(self._least, self._values)

    def __call__(self, planes: list[Jit]) -> Pixels:
        """Convert colour planes to values (height, width, 3), which may share Dr.Jit's memory."""
        place = 3 * dr.arange(mi.UInt32, dr.width(planes[0]))
        values = dr.empty(self._byte, 3 * dr.width(place))
        for k, plane in enumerate(planes):
            level = dr.binary_search(
                0, dr.width(self._least), lambda i, plane=plane: dr.gather(mi.Float, self._least, i) <= plane
            )
            dr.scatter(values, dr.gather(self._byte, self._values, level), place + k)
        return np.asarray(values).reshape(self._shape)


#: Render time of a moving picture, s, above which a block of pixels gets one ray.
QUICK_S = 0.06
#: Timed pictures; the fastest one sets `block`.
TRIALS = 3
MAX_BLOCK = 8
#: Samples per pixel of each pass while the scene is at rest.
PASS_SAMPLES = 4
#: Pixels rendered between two checks of the mouse, keyed by device.
PIXELS_AT_ONCE = {"llvm": 1 << 18, "cuda": 1 << 25}


class LivePicture:
    """The integral image of a moving scene. It stays on the device until it is read."""

    def __init__(
        self, scene: Scene, display: Display, model: Model, settings: Settings, block: int | None = None
    ) -> None:
        """Compile the renderers. If `block` is None, measured speed sets it. Raises errors of `Renderer`."""
        self._scene = scene
        self._panel = display.panel
        self._encoder = Encoder(display.panel)
        # No irradiance cache: it would have more points than a quick picture has rays.
        self._settings = replace(settings, shading="each")
        self._source = display_source(display, model)
        #: Side in pixels of the blocks that get one ray each in a quick picture.
        self.block = 1
        self._renderers: dict[int, Renderer] = {}
        self._compile(1)
        if block is None:
            quick = self._renderer(1)
            seconds = len(quick.bands) * min(timeit.repeat(lambda: quick.render(0), number=1, repeat=TRIALS))
            block = min(MAX_BLOCK, int(np.ceil(np.sqrt(max(seconds / QUICK_S, 1.0)))))
        if block > 1:
            self.block = block
            self._renderers.clear()
            self._compile(1)
        self._compile(PASS_SAMPLES)
        self._block_of_pixel = _blocks(self._panel, self.block)
        self._placement, self._passes = scene.placement, 0
        self._planes: list[Jit] = []

    def stage(self, scene: Scene) -> None:
        """Use the scene of another frame. Call `quick` next."""
        self._scene = scene
        self._renderers.clear()

    @property
    def samples(self) -> int:
        """Samples of each pixel after the last `finer`; 0 after `quick`."""
        return self._passes * PASS_SAMPLES

    @property
    def middle_mm(self) -> Matrix:
        """The centre of the placed scene's bounding box (3,), mm."""
        low, high = self._scene.box(self._scene.placement)
        return 0.5 * (low + high)

    @property
    def values(self) -> Pixels:
        """The picture as the panel's values (height, width, 3), 8 bits."""
        return self._encoder(self._mean())

    @property
    def radiance(self) -> Radiance:
        """The picture's radiance (height, width, 3)."""
        return radiance_of(self._mean(), self._panel.width_px)

    def quick(self, placement: Placement) -> None:
        """Draw the scene at another placement, with one ray per block of pixels."""
        self._placement, self._passes = self._scene.placed(placement).placement, 0
        planes = self._draw_pass(1, lambda: False) or []
        if self.block > 1:
            planes = [dr.gather(type(plane), plane, self._block_of_pixel) for plane in planes]
        self._planes = planes

    def finer(self, interrupted: Callable[[], bool]) -> bool:
        """Add a pass to the mean picture; return False if the pass was interrupted."""
        planes = self._draw_pass(PASS_SAMPLES, interrupted)
        if planes is None:
            return False
        self._planes = [a + b for a, b in zip(self._planes, planes, strict=True)] if self._passes else planes
        dr.eval(self._planes)
        self._passes += 1
        return True

    def _mean(self) -> list[Jit]:
        passes = dr.opaque(mi.Float, float(max(self._passes, 1)))
        return [plane / passes for plane in self._planes]

    def _renderer(self, samples: int) -> Renderer:
        if samples not in self._renderers:
            source = _coarsen(self._source, self.block) if samples == 1 < self.block else self._source
            rows = BAND_ROWS * max(1, round(PIXELS_AT_ONCE[current_device()] / (source.width_px * BAND_ROWS)))
            bands = [range(first, min(first + rows, source.height_px)) for first in range(0, source.height_px, rows)]
            self._renderers[samples] = Renderer(self._scene, source, replace(self._settings, samples=samples), bands)
        return self._renderers[samples]

    def _compile(self, samples: int) -> None:
        renderer = self._renderer(samples)
        # Placements with and without rotation use different programs.
        for turn_deg in (0.0, 1.0):
            renderer.move(replace(self._scene.placement, rotation_deg=(0.0, turn_deg, 0.0)))
            renderer.prepare()
        renderer.move(self._scene.placement)

    def _draw_pass(self, samples: int, interrupted: Callable[[], bool]) -> list[Jit] | None:
        renderer = self._renderer(samples)
        renderer.move(self._placement, self._passes)
        parts = []
        for band in renderer.bands:
            if interrupted():
                return None
            parts.append(renderer.draw(band)[0])
        return [dr.concat(list(planes)) for planes in zip(*parts, strict=True)]


def _coarsen(source: RaySource, block: int) -> RaySource:
    return replace(
        source,
        width_px=-(-source.width_px // block),
        height_px=-(-source.height_px // block),
        lines=lambda b, u, v, square: source.lines(b, u * block, v * block, square),
        layout=None,
        owner=None,
    )


def _blocks(panel: Panel, block: int) -> Jit:
    pixel = dr.arange(mi.UInt32, panel.width_px * panel.height_px)
    row = pixel // panel.width_px
    blocks = row // block * -(-panel.width_px // block) + (pixel - row * panel.width_px) // block
    dr.eval(blocks)
    return blocks


#: Samples per pixel of a finished picture at rest.
MAX_SAMPLES = 64
#: A film's frame number, and the user's motion.
Moment = tuple[int, tuple[float, ...]]
#: Maximum memory for stored pictures of a film, bytes.
CACHE_BYTES = 1 << 30
PANEL, VIEW = "panel", "eye's view"
#: Pause between two checks of mouse and keys while idle, s.
PAUSE_S = 0.01
#: Rays per pixel of the eye's view, while the scene moves and at rest.
VIEW_SAMPLES = (1, 8)


@dataclass(frozen=True)
class EyeView:
    """An eye's view, which the second window shows."""

    display: Display
    eye: Eye
    window: Window

    def draw(self, radiance: Radiance, moving: bool) -> Pixels:
        """Return the eye's view of the panel's radiance (height, width, 3)."""
        view = observe(radiance, self.display, self.eye, self.window, VIEW_SAMPLES[not moving])
        return encoded_values(view.radiance, "srgb", 8).astype("uint8")


@documented
@dataclass
class Played:
    """Timing figures of a live picture."""

    first_s: Annotated[float, key("from the open window to its first picture")] = 0.0
    frames: Annotated[int, key("pictures of the moving scene, or of the film")] = 0
    frames_per_second: Annotated[float, key("of the moving scene, from the median frame; 0 without one")] = 0.0
    slowest_s: Annotated[float, key("its slowest frame")] = 0.0
    block: Annotated[int, key("side of the blocks of pixels that get one ray while it moves")] = 1
    samples: Annotated[int, key("for each pixel of the last picture")] = 0
    seconds: Annotated[float, key("from the first picture to the end")] = 0.0


@dataclass
class LiveShow:
    """Shows a scene or a film, which the user moves, on screens and on a board."""

    picture: LivePicture
    hand: Hand
    screens: Screens
    view: EyeView | None = None
    #: Function that sends each picture of the panel to a board.
    send: Callable[[Pixels], None] | None = None
    reel: Reel | None = None
    #: The moment that the screens show, and the last moment that `picture` drew.
    _current: Moment | None = None
    _drawn: Moment | None = None
    #: Pictures of a film's frames, stored until the user moves the scene.
    _cache: dict[Moment, list[Pixels]] = field(default_factory=dict)
    #: Time of the first picture (perf_counter); number and durations of later pictures.
    _first: float = 0.0
    _frames: int = 0
    _times: deque[float] = field(default_factory=lambda: deque(maxlen=1000))

    def run(
        self,
        *,
        turn_deg: float = 0.0,
        moving_s: float | None = None,
        seconds: float | None = None,
        samples: int = MAX_SAMPLES,
        opened: float | None = None,
    ) -> Played:
        """Run the loop until the user ends it.

        The loop also ends when `seconds` have passed and the picture has all `samples`.
        For `moving_s` seconds (None means to the end), the scene rotates by `turn_deg` per
        second, or the film plays. `opened` is when the window opened (perf_counter).
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
            if moment != self._current:
                self._show(moment)
            elif reel is not None and reel.playing:
                time.sleep(PAUSE_S)
            elif self._drawn != moment:  # the screens show a stored picture
                self._draw(moment)
            elif picture.samples < samples:
                if picture.finer(self.screens.waiting):
                    self._present(self._pictures(moving=False), f"at rest, {picture.samples} samples")
            elif seconds is not None and now - began >= seconds:
                break
            else:
                time.sleep(PAUSE_S)
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
        frame, _ = moment
        if self.reel is not None and (self._drawn is None or frame != self._drawn[0]):
            scene, self.hand.base = self.reel.stage(frame)
            if scene is not None:
                self.picture.stage(scene)
        self.picture.quick(self.hand.placement())
        self._drawn = moment

    def _show(self, moment: Moment) -> None:
        began = time.perf_counter()
        if any(motion != moment[1] for _, motion in self._cache):
            self._cache.clear()
        pictures = self._cache.get(moment)
        if pictures is None:
            self._draw(moment)
            pictures = self._pictures(moving=True)
            cache_bytes = sum(one.nbytes for some in [*self._cache.values(), pictures] for one in some)
            if self.reel is not None and cache_bytes <= CACHE_BYTES:
                self._cache[moment] = pictures
        rate = f"{1.0 / max(self._times[-1], 1e-3):.0f} frames/s" if self._times else "at rest"
        block = self.picture.block
        self._present(pictures, f"{rate}, 1 ray for {f'{block} x {block} pixels' if block > 1 else 'each pixel'}")
        ended = time.perf_counter()
        if self._current is None:
            self._first = ended
        else:
            self._frames += 1
            self._times.append(ended - began)
        self._current = moment

    def _pictures(self, moving: bool) -> list[Pixels]:
        panel = [self.picture.values]
        return panel if self.view is None else [*panel, self.view.draw(self.picture.radiance, moving)]

    def _present(self, pictures: list[Pixels], state: str) -> None:
        for name, pixels in zip((PANEL, VIEW), pictures, strict=False):
            self.screens.show(name, pixels, f"Lippmann: {state}")
        if self.send is not None:
            self.send(pictures[0])

"""The integral image of a scene that moves: at once with few rays, then finer while it rests."""

from __future__ import annotations

import timeit
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from lippmann.base.fullscreen import Pixels
from lippmann.base.images import Radiance
from lippmann.base.tones import BAND_ROWS, encoded_values
from lippmann.base.variant import Jit, current_device, drjit, mitsuba
from lippmann.display.description import Display, Panel
from lippmann.optics.rays import Model
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import Renderer, radiance_of
from lippmann.rendering.sampling import RaySource, display_source
from lippmann.scenes.placement import Matrix, Placement
from lippmann.scenes.scene import Scene

#: float32 of 0 and of 1, as whole numbers; those between are in the order of their values.
ZERO, ONE = 0, 0x3F800000


def least_radiance(panel: Panel, bits: int) -> npt.NDArray[np.float32]:
    """Return the least radiance of each of a panel's levels above the darkest (2^bits - 1,), by bisection.

    For any transfer curve that does not fall: `encoded_values` itself is asked.
    """
    wanted = values_of(bits)[1:]
    low, high = np.full(len(wanted), ZERO), np.full(len(wanted), ONE)
    while (high - low > 1).any():
        middle = (low + high) // 2
        reached = encoded_values(middle.astype(np.int32).view(np.float32), panel.transfer, bits) >= wanted
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    return high.astype(np.int32).view(np.float32)


def values_of(bits: int) -> npt.NDArray[np.uint8]:
    """Return the 8-bit values of all levels of a panel of up to 8 bits (levels,)."""
    return encoded_values(np.linspace(0.0, 1.0, 1 << bits), "linear", bits).astype(np.uint8)


class Encoder:
    """Makes 8-bit values of planes of radiance, those of `encoded_values`."""

    def __init__(self, panel: Panel) -> None:
        """Take the panel's transfer curve, and its bits up to 8."""
        dr, mi = drjit(), mitsuba()
        bits = min(panel.bits, 8)
        self._byte = getattr(dr, mi.variant().split("_")[0]).ad.UInt8
        self._shape = (panel.height_px, panel.width_px, 3)
        self._least, self._values = mi.Float(least_radiance(panel, bits)), self._byte(values_of(bits))
        dr.make_opaque(self._least, self._values)

    def __call__(self, planes: list[Jit]) -> Pixels:
        """Return the values (height, width, 3) of red, green and blue planes, each of all pixels row by row.

        They may be Dr.Jit's memory, as in `radiance_of`.
        """
        dr, mi = drjit(), mitsuba()
        place = 3 * dr.arange(mi.UInt32, dr.width(planes[0]))
        found = dr.empty(self._byte, 3 * dr.width(place))
        for k, plane in enumerate(planes):
            level = dr.binary_search(
                0, dr.width(self._least), lambda i, plane=plane: dr.gather(mi.Float, self._least, i) <= plane
            )
            dr.scatter(found, dr.gather(self._byte, self._values, level), place + k)
        return np.asarray(found).reshape(self._shape)


#: Seconds that a picture of a moving scene may take; where the panel has too many pixels, blocks of them get one ray.
QUICK_S = 0.06
#: Pictures that are timed to find it; another program may disturb one.
TRIALS = 3
#: Largest block, pixels of a side.
MOST_BLOCK = 8
#: Samples of a pass while the scene rests.
PASS_SAMPLES = 4
#: Pixels that are rendered between two looks at the mouse, by device.
PIXELS_AT_ONCE = {"llvm": 1 << 18, "cuda": 1 << 25}


class LivePicture:
    """The integral image of a scene in changing places.

    It stays where it is rendered, on a GPU perhaps, until `values` or `radiance` asks for it.
    """

    def __init__(
        self, scene: Scene, display: Display, model: Model, settings: Settings, block: int | None = None
    ) -> None:
        """Compile the programs; `block` of None finds one that is quick enough. Raises InputError as `Renderer`."""
        self._scene, self._panel, self._encoder = scene, display.panel, Encoder(display.panel)
        # A quick picture has fewer rays than there are points whose light they could share.
        self._settings, self._source = replace(settings, shading="each"), display_source(display, model)
        #: Side of the blocks of pixels that get one ray in a quick picture.
        self.block = 1
        self._renderers: dict[int, Renderer] = {}
        self._compile(1)
        if block is None:
            quick = self._renderer(1)
            seconds = len(quick.bands) * min(timeit.repeat(lambda: quick.render(0), number=1, repeat=TRIALS))
            block = min(MOST_BLOCK, int(np.ceil(np.sqrt(max(seconds / QUICK_S, 1.0)))))
        if block > 1:
            self.block = block
            self._renderers.clear()
            self._compile(1)
        self._compile(PASS_SAMPLES)
        self._block_of_pixel = _blocks(self._panel, self.block)
        self._placement, self._passes = scene.placement, 0
        self._planes: list[Jit] = self._renderer(PASS_SAMPLES).planes(self._panel.height_px)

    def stage(self, scene: Scene) -> None:
        """Take another scene, that of another moment; `quick` is to follow."""
        self._scene = scene
        self._renderers.clear()

    @property
    def samples(self) -> int:
        """Samples of each pixel in the picture that `finer` returned last; 0 after `quick`."""
        return self._passes * PASS_SAMPLES

    @property
    def middle_mm(self) -> Matrix:
        """The middle of the scene's box where it stands now (3,), mm."""
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
        """Make the picture of the scene in another place, one ray for each block of pixels."""
        dr = drjit()
        self._placement, self._passes = self._scene.placed(placement).placement, 0
        planes = self._drawn(1, lambda: False) or []
        if self.block > 1:
            planes = [dr.gather(type(plane), plane, self._block_of_pixel) for plane in planes]
        self._planes = planes

    def finer(self, interrupted: Callable[[], bool]) -> bool:
        """Make it the mean of the passes so far and one more; return False when that was interrupted, and is not done.

        The first pass equals a render of `PASS_SAMPLES` samples.
        """
        planes = self._drawn(PASS_SAMPLES, interrupted)
        if planes is None:
            return False
        self._planes = [a + b for a, b in zip(self._planes, planes, strict=True)] if self._passes else planes
        drjit().eval(self._planes)
        self._passes += 1
        return True

    def _mean(self) -> list[Jit]:
        passes = drjit().opaque(mitsuba().Float, float(max(self._passes, 1)))
        return [plane / passes for plane in self._planes]

    def _renderer(self, samples: int) -> Renderer:
        """Return the renderer of quick pictures (one sample), or of passes, of the scene on the stage."""
        if samples not in self._renderers:
            source = _coarse(self._source, self.block) if samples == 1 < self.block else self._source
            rows = BAND_ROWS * max(1, round(PIXELS_AT_ONCE[current_device()] / (source.width_px * BAND_ROWS)))
            bands = [range(first, min(first + rows, source.height_px)) for first in range(0, source.height_px, rows)]
            self._renderers[samples] = Renderer(self._scene, source, replace(self._settings, samples=samples), bands)
        return self._renderers[samples]

    def _compile(self, samples: int) -> None:
        renderer = self._renderer(samples)
        # A scene in the display's own frame has a program of its own: compiled now, lest the first move waits for it.
        for turn_deg in (0.0, 1.0):
            renderer.move(replace(self._scene.placement, rotation_deg=(0.0, turn_deg, 0.0)))
            renderer.prepare()
        renderer.move(self._scene.placement)

    def _drawn(self, samples: int, interrupted: Callable[[], bool]) -> list[Jit] | None:
        """Return the planes of the next pass with so many samples, or None."""
        renderer = self._renderer(samples)
        renderer.move(self._placement, self._passes)
        planes = renderer.planes(renderer.bands[-1].stop)
        for band in renderer.bands:
            if interrupted():
                return None
            renderer.draw(band, planes)
        return planes


def _coarse(source: RaySource, block: int) -> RaySource:
    """Return the rays through the middles of blocks of pixels."""
    return replace(
        source,
        width_px=-(-source.width_px // block),
        height_px=-(-source.height_px // block),
        lines=lambda b, u, v, square: source.lines(b, u * block, v * block, square),
        layout=None,
        owner=None,
    )


def _blocks(panel: Panel, block: int) -> Jit:
    """Return the number of each pixel's block, row by row (UInt32)."""
    dr, mi = drjit(), mitsuba()
    pixel = dr.arange(mi.UInt32, panel.width_px * panel.height_px)
    row = pixel // panel.width_px
    found = row // block * -(-panel.width_px // block) + (pixel - row * panel.width_px) // block
    dr.eval(found)
    return found

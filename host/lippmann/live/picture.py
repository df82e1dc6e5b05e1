"""The integral image of a scene that moves: at once with few rays, then finer while it rests."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from lippmann.display import Display
from lippmann.images import BAND_ROWS, Radiance
from lippmann.optics.rays import Model
from lippmann.rendering.placement import Placement
from lippmann.rendering.renderer import Renderer, Settings
from lippmann.rendering.scene import Scene, box_of, in_front_of
from lippmann.rendering.sources import RaySource, display_source

#: Seconds that a picture of a moving scene may take; where the panel has too many pixels, blocks of them get one ray.
QUICK_S = 0.06
#: Pictures that are timed to find it; another program may disturb one.
TRIALS = 3
#: Largest block, pixels of a side.
MOST_BLOCK = 8
#: Samples of a pass while the scene rests.
PASS_SAMPLES = 4
#: Pixels that are rendered between two looks at the mouse.
PIXELS_AT_ONCE = 1 << 18


class LivePicture:
    """The integral image of a scene in changing places."""

    def __init__(self, scene: Scene, display: Display, model: Model, settings: Settings) -> None:
        """Compile the programs, and find the block that is quick enough. Raises InputError as `Renderer`."""
        self._scene, self._panel = scene, display.panel
        self._settings = replace(settings, samples=PASS_SAMPLES)
        low, high = box_of(scene.mitsuba, Placement())
        self._corners = np.array([[x, y, z, 1.0] for x in (low[0], high[0]) for y in (low[1], high[1])
                                  for z in (low[2], high[2])])  # fmt: skip
        source = display_source(display, model)
        self.block = 1
        self._quick = self._renderer(source, 1)
        self._quick.prepare()
        taken = min(self._timed() for _ in range(TRIALS))
        if taken > QUICK_S:
            self.block = min(MOST_BLOCK, int(np.ceil(np.sqrt(taken / QUICK_S))))
            self._quick = self._renderer(_coarse(source, self.block), 1)
            self._quick.prepare()
        self._fine = self._renderer(source, PASS_SAMPLES)
        self._placement = scene.placement
        self._sum: Radiance = np.zeros((self._panel.height_px, self._panel.width_px, 3), np.float32)
        self._passes = 0

    @property
    def samples(self) -> int:
        """Samples of each pixel in the picture that `finer` returned last; 0 after `quick`."""
        return self._passes * PASS_SAMPLES

    @property
    def middle_mm(self) -> Any:
        """The middle of the scene's box where it stands now (3,), mm."""
        corners = self._corners @ self._scene.placement.display_from_scene.T
        return 0.5 * (corners.min(axis=0) + corners.max(axis=0))[:3]

    def quick(self, placement: Placement) -> Radiance:
        """Return the picture of the scene in another place, one ray for each block of pixels."""
        self._placement, self._passes = self._with_front(placement), 0
        self._quick.move(self._placement, self._settings.seed)
        found = self._all(self._quick, lambda: False)
        assert found is not None
        if self.block > 1:
            found = found.repeat(self.block, axis=0).repeat(self.block, axis=1)
        return found[: self._panel.height_px, : self._panel.width_px]

    def finer(self, interrupted: Callable[[], bool]) -> Radiance | None:
        """Return the mean of the passes so far and one more; None when that was interrupted, and is to be done again.

        The first pass has the render's seed, and equals a render of `PASS_SAMPLES` samples.
        """
        self._fine.move(self._placement, (self._settings.seed + self._passes) & 0xFFFFFFFF)
        found = self._all(self._fine, interrupted)
        if found is None:
            return None
        self._sum = found if not self._passes else self._sum + found
        self._passes += 1
        return self._sum / np.float32(self._passes)

    def _renderer(self, source: RaySource, samples: int) -> Renderer:
        rows = BAND_ROWS * max(1, round(PIXELS_AT_ONCE / (source.width_px * BAND_ROWS)))
        bands = [range(first, min(first + rows, source.height_px)) for first in range(0, source.height_px, rows)]
        return Renderer(self._scene, source, replace(self._settings, samples=samples), bands)

    def _timed(self) -> float:
        began = time.perf_counter()
        self._quick.render(0)
        return (time.perf_counter() - began) * len(self._quick.bands)

    def _with_front(self, placement: Placement) -> Placement:
        """Return a placement with depths: those of the scene's box, where it has none."""
        if placement.near_mm is not None and placement.far_mm is not None:
            return placement
        depths = (self._corners @ placement.display_from_scene.T)[:, 2]
        far, near = float(depths.min()), float(depths.max())
        return replace(placement, near_mm=in_front_of((far, near)), far_mm=far)

    @staticmethod
    def _all(renderer: Renderer, interrupted: Callable[[], bool]) -> Radiance | None:
        """Return the picture of all bands, or None."""
        parts = []
        for number in range(len(renderer.bands)):
            if interrupted():
                return None
            parts.append(renderer.render(number)[0])
        return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _coarse(source: RaySource, block: int) -> RaySource:
    """Return the rays through the middles of blocks of pixels."""
    return replace(
        source,
        width_px=-(-source.width_px // block),
        height_px=-(-source.height_px // block),
        lines=lambda b, u, v, square: source.lines(b, u * block, v * block, square),
        layout=None,
    )

"""What each pixel of a camera sees of a panel: a sparse matrix, with which each photograph is one multiplication.

All rays of the camera's pixels, spread over pixel and pupil, are traced once, against the light, as the observer does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from lippmann.base import interrupts
from lippmann.calibration.simulated_camera import Camera
from lippmann.display.description import Display
from lippmann.display.subpixels import layout_of
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.rays import Engine, Floats, Hits, Indices, gets_through
from lippmann.optics.trace import trace_to_panel

#: Rays traced at once.
CHUNK_RAYS = 1 << 20
#: Colours of a photograph.
COLOURS = 3
Light = npt.NDArray[np.float32]
#: Traces origins (N, 3) and unit directions (N, 3) to the panel.
Tracer = Callable[[Floats, Floats], Hits]


@dataclass(frozen=True)
class Sight:
    """Shares of the light of panel pixels (columns) in camera pixels (rows), one matrix, or one for each colour.

    `brightness` (height, width) is what the camera's lens leaves of an even light.
    """

    matrices: tuple[Any, ...]
    brightness: Floats

    def photograph(self, light: Light) -> Light:
        """Return the picture of a panel's linear light; both are (height, width), or (height, width, 3) in colour."""
        grey = light.ndim == 2 and len(self.matrices) == 1
        planes = [light] if grey else [light[..., k] if light.ndim == 3 else light for k in range(COLOURS)]
        seen = [self.matrices[k % len(self.matrices)] @ plane.ravel() for k, plane in enumerate(planes)]
        pictures = [self.brightness * one.reshape(self.brightness.shape) for one in seen]
        return np.asarray(pictures[0] if grey else np.stack(pictures, axis=2), np.float32)


def gathered(display: Display, camera: Camera, seen: Iterator[tuple[int, int, Indices, Floats, Any]]) -> Sight:
    """Return the sight from samples, given in bands of whole rows of the picture.

    Each band is its first and last camera pixel, then of each sample the camera pixel, the panel's coordinates (N, 2),
    and whether it sees the panel. Samples that do not see it count as dark.
    """
    panel, layout = display.panel, layout_of(display.panel.subpixels)
    parts: list[list[Any]] = [[] for _ in range(1 if layout is None else COLOURS)]
    for first, last, pixel, place, sees in seen:
        rows, count = pixel - first, last - first
        share = (1.0 / np.maximum(np.bincount(rows, minlength=count), 1)).astype(np.float32)[rows] * sees
        column = np.clip(np.floor(place[:, 0]), 0, panel.width_px - 1).astype(np.int64)
        row = np.clip(np.floor(place[:, 1]), 0, panel.height_px - 1).astype(np.int64)
        weights = [share] if layout is None else [np.zeros_like(share) for _ in range(COLOURS)]
        if layout is not None:
            for k, gain, inside in layout.emitters(NumpyBackend(), place[:, 0], place[:, 1]):
                # A white sub-pixel, which shows what the colours have in common, is left dark.
                if k < COLOURS:
                    weights[k] += np.where(inside, gain * share, 0.0)
        for part, weight in zip(parts, weights, strict=True):
            lit = weight > 0.0
            at = rows[lit], (row * panel.width_px + column)[lit]
            shape = count, panel.width_px * panel.height_px
            part.append(sparse.coo_matrix((weight[lit].astype(np.float32), at), shape=shape).tocsr())
    return Sight(tuple(sparse.vstack(part, format="csr") for part in parts), camera.brightness())


def sight_of(display: Display, camera: Camera, samples: int = 3, seed: int = 0, tracer: Tracer | None = None) -> Sight:
    """Trace what a camera sees of a display.

    `samples` is the number of rays across a camera pixel, and down. `tracer` traces them; None: `traced`, the exact
    lenslets.
    """
    rng = np.random.default_rng((seed, 0x51))
    trace = tracer or traced(display)
    rows_at_once = max(1, CHUNK_RAYS // (camera.width_px * samples * samples))

    def bands() -> Iterator[tuple[int, int, Indices, Floats, Any]]:
        for first in range(0, camera.height_px, rows_at_once):
            interrupts.check()
            last = min(first + rows_at_once, camera.height_px)
            shape = (last - first, camera.width_px, samples, samples)
            row, column, a, b = (axis.ravel() for axis in np.indices(shape))
            u = column + (a + rng.random(len(a))) / samples
            v = first + row + (b + rng.random(len(b))) / samples
            if camera.blur_px > 0.0:
                u += camera.blur_px * rng.standard_normal(len(u))
                v += camera.blur_px * rng.standard_normal(len(v))
            radius, turn = np.sqrt(rng.random(len(a))), 2.0 * np.pi * rng.random(len(a))
            hits = trace(*camera.rays(u, v, (radius * np.cos(turn), radius * np.sin(turn))))
            pixel = (first + row) * camera.width_px + column
            yield first * camera.width_px, last * camera.width_px, pixel, hits.pixel, gets_through(hits.status)

    return gathered(display, camera, bands())


def traced(display: Display, engine: Engine = "fast") -> Tracer:
    """Return the tracer through a display's exact lenslets."""
    return lambda origin, direction: trace_to_panel(display, origin, direction, engine=engine)

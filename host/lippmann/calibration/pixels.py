"""Where a lenslet looks, more finely than the panel's pixels: the points that agree with what the camera's pixels read.

A reading is the middle of the panel's pixel that is seen. With the point t that a lenslet sees on average, and the
movement s(p) of the point over its cell, the camera's pixels p of the lenslet read on average

    f(t) = mean of floor(t + s(p)) + 1/2,

which grows with t in steps. So a mean that was read gives the interval in which t is. Where points move by a pixel or
more over the cell it is short; in focus, where all of a lenslet sees one pixel, it is as wide as that pixel. The middle
of such an interval is no measurement: its error is that of rounding, which is alike for many neighbours.

The movement is that of exact rays through the array that a first solution has found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lippmann.calibration.landing import inner_rays
from lippmann.calibration.lenslets import Lenslets
from lippmann.display import Display
from lippmann.optics.panel import PanelFrame

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
#: Panel pixels by which a mean of readings may be wrong.
TOLERANCE = 0.02
#: Halvings of an interval of two pixels.
HALVINGS = 11
#: Lenslets of a view through which rays are traced.
TRACED = 60
#: Readings whose movement is computed at once.
CHUNK = 1 << 18
SEED = 1912


@dataclass(frozen=True)
class Movement:
    """How panel points (pixels) move over a cell: factors (13, 2) of `_basis`, and the mean slope of the view."""

    factors: Floats
    slope: Floats

    def of(self, local: npt.NDArray[np.floating], slope: Floats) -> Floats:
        """Return the movement (N, 2) at places (N, 2) in the cell of pitch 1, for cameras at slopes (N, 2)."""
        return np.asarray(_basis(local, slope - self.slope) @ self.factors)


def _basis(local: npt.NDArray[np.floating], aside: Floats) -> Floats:
    """Return what points of a cell move with: up to cubes of the place, and the place's change with the slope."""
    x, y = local.T
    a, b = aside.T
    columns = [x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3, a * x, a * y, b * x, b * y]
    return np.stack([np.ones_like(x), *columns], axis=1)


def movement_of(display: Display, turn_deg: float, slopes: Floats, distance_mm: float) -> Movement:
    """Trace the movement of a view, whose lenslets see the camera at slopes (N, 2).

    `turn_deg` is the direction of the cells' first axis on the panel.
    """
    some = slopes[np.random.default_rng(SEED).permutation(len(slopes))[:TRACED]]
    inner, at, seen = inner_rays(display, some, distance_mm)
    c, s = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    local = inner @ [[c, -s], [s, c]] / display.array.pitches_mm[0]
    number = np.maximum(seen.sum(axis=1), 1)[:, None, None]
    at = at - (at * seen[..., None]).sum(axis=1, keepdims=True) / number
    pixels = at / display.panel.pitches_mm * [1.0, -1.0]
    middle = slopes.mean(axis=0)
    basis = _basis(np.tile(local, (len(some), 1)), np.repeat(some - middle, len(local), axis=0))
    lit = seen.ravel()
    return Movement(np.linalg.lstsq(basis[lit], pixels.reshape(-1, 2)[lit], rcond=None)[0], middle)


def refined(view: Lenslets, display: Display, slopes: Floats, movement: Movement) -> Lenslets:
    """Return the view with the middles and half widths of the intervals that its readings give."""
    readings, frame = view.readings, PanelFrame.of(display)
    assert readings is not None
    count = len(view.index)
    shift = np.empty_like(readings.local)
    for first in range(0, len(shift), CHUNK):
        part = slice(first, first + CHUNK)
        shift[part] = movement.of(readings.local[part], slopes[readings.group[part]])
    found = [interval(readings.panel_px[:, axis], shift[:, axis], readings.group, count) for axis in (0, 1)]
    low, high = (np.stack(sides, axis=1) for sides in zip(*found, strict=True))
    middle = np.stack(frame.panel_from_pixel(*(0.5 * (low + high)).T), axis=1)
    return replace(view, panel_mm=middle, half_px=0.5 * (high - low))


def interval(
    read: npt.NDArray[np.float32], shift: npt.NDArray[np.float32], group: Indices, count: int
) -> tuple[Floats, Floats]:
    """Return the least and the greatest t of each lenslet whose f is the mean that was read, but for the tolerance."""
    number = np.maximum(np.bincount(group, minlength=count), 1)
    mean = np.bincount(group, weights=read, minlength=count) / number
    # Less the pixel of the mean, so that single precision does.
    whole = np.floor(mean)
    sides = []
    for wanted in (mean - TOLERANCE, mean + TOLERANCE):
        low, high = mean - 1.0, mean + 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            step = np.floor((middle - whole).astype(np.float32)[group] + shift)
            above = whole + np.bincount(group, weights=step, minlength=count) / number + 0.5 > wanted
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        sides.append(0.5 * (low + high))
    return sides[0], sides[1]

"""Where a lenslet looks, more finely than the panel's pixels: the points that agree with what the camera's pixels read.

A reading is the middle of the panel's pixel that is seen. With the point t that a lenslet sees on average, and the
movement s(p) of the point over its cell, the camera's pixels p of the lenslet read on average

    f(t) = mean of S(t + s(p)),   S(u) = mean of floor(v) + 1/2 over |v - u| < b/2,

which grows with t in steps whose edges have the width b: that of the camera's blur on the panel, the same for all of a
position. It is the b whose S is nearest to the single readings. So a mean that was read gives the interval in which t
is. Where points move by a pixel or more over the cell it is short; in focus, where all of a lenslet sees one pixel, it
is as wide as that pixel. The middle of a wide interval is no measurement: its error is that of rounding, which is alike
for many neighbours.

The movement is that of exact rays through the array that a first solution has found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from lippmann.calibration.landing import ACROSS, inner_rays
from lippmann.calibration.lenslets import INNER, Lenslets
from lippmann.display import Display
from lippmann.optics.panel import PanelFrame

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Values = npt.NDArray[np.floating[Any]]
#: Panel pixels by which a mean of readings may be wrong.
TOLERANCE = 0.02
#: Least and greatest width b, and how well it is found, pixels.
BLURS, BLUR_STEP = (0.01, 1.0), 0.01
#: Halvings of an interval of two pixels.
HALVINGS = 11
#: Lenslets of a view through which rays are traced.
TRACED = 60
#: Readings whose movement is computed at once.
CHUNK = 1 << 16
#: Lenslets from which the blur is found.
MOST_BLURRED = 200
#: Step across a cell of pitch 1, for differences.
STEP = 1e-3
SEED = 1912
#: Powers of the place in the cell, up to the fifth, and of the slope, up to the second: aberrations of steep lenslets.
PLACE = [(a, b) for a in range(6) for b in range(6 - a)]
SLOPE = [(a, b) for a in range(3) for b in range(3 - a)]


@dataclass(frozen=True)
class Movement:
    """How panel points (pixels) move over a cell: factors (slope powers, place powers, 2), around a mean slope."""

    factors: Floats
    slope: Floats

    def over_cell(self, slopes: Floats) -> Floats:
        """Return how points move on average over inner cells, (N, 2, 2) pixels for each pitch, for slopes (N, 2)."""
        own = np.tensordot(_powers(slopes - self.slope, SLOPE), self.factors, axes=1)
        side = INNER * (np.arange(ACROSS) + 0.5 - 0.5 * ACROSS) / ACROSS
        local = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        ways = [
            (_powers(local + step, PLACE) - _powers(local - step, PLACE)).mean(axis=0) / (2.0 * STEP)
            for step in STEP * np.eye(2)
        ]
        return np.asarray(np.einsum("dp,npa->nda", np.array(ways), own))

    def of(self, local: Values, slopes: Floats, group: Indices) -> npt.NDArray[np.float32]:
        """Return the movement (M, 2) at places (M, 2) in cells of pitch 1, of lenslets with slopes (N, 2)."""
        own = np.tensordot(_powers(slopes - self.slope, SLOPE), self.factors, axes=1)
        moved = np.empty((len(local), 2), np.float32)
        for first in range(0, len(local), CHUNK):
            part = slice(first, first + CHUNK)
            moved[part] = np.einsum("mp,mpa->ma", _powers(local[part], PLACE), own[group[part]])
        return moved


def _powers(values: Values, exponents: Sequence[tuple[int, int]]) -> Floats:
    """Return x^a y^b of values (N, 2) for each pair of exponents, (N, pairs)."""
    x, y = values.T.astype(np.float64)
    return np.stack([x**a * y**b for a, b in exponents], axis=1)


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
    powers = _powers(some - middle, SLOPE)[:, None, :, None] * _powers(local, PLACE)[None, :, None, :]
    design = powers.reshape(len(some), len(local), -1)[seen]
    factors = np.linalg.lstsq(design, pixels[seen], rcond=None)[0]
    return Movement(factors.reshape(len(SLOPE), len(PLACE), 2), middle)


def refined(view: Lenslets, display: Display, slopes: Floats, movement: Movement) -> Lenslets:
    """Return the view with the middles and half widths of the intervals that its readings give.

    What the tolerance adds to a half width is no doubt: short intervals are measurements.
    """
    readings, frame = view.readings, PanelFrame.of(display)
    assert readings is not None
    count, shift = len(view.index), movement.of(readings.local, slopes, readings.group)
    axes = [(readings.panel_px[:, axis], shift[:, axis], readings.group, count) for axis in (0, 1)]
    found = [interval(*one, blur_of(*one)) for one in axes]
    low, high = (np.stack(sides, axis=1) for sides in zip(*found, strict=True))
    middle = np.stack(frame.panel_from_pixel(*(0.5 * (low + high)).T), axis=1)
    moves = movement.over_cell(slopes) * np.multiply(display.panel.pitches_mm, [1.0, -1.0])
    return replace(view, panel_mm=middle, moves=moves, half_px=np.maximum(0.5 * (high - low) - TOLERANCE, 0.0))


def read(at: Values, blur: float) -> Values:
    """Return S of the module's formula, without its 1/2, at points (M,): the integral of floor over b."""
    if not blur:
        return np.floor(at)

    def integral(end: Values) -> Values:
        part = end - np.floor(end)
        return np.asarray(0.5 * (end * end - end + part * (1.0 - part)))

    half = at.dtype.type(0.5 * blur)
    return np.asarray((integral(at + half) - integral(at - half)) / (half + half))


def blur_of(panel_px: npt.NDArray[np.float32], shift: npt.NDArray[np.float32], group: Indices, count: int) -> float:
    """Return the b with which readings are nearest to S, each lenslet at the middle of its interval."""
    some = group < MOST_BLURRED
    panel_px, shift, group, count = panel_px[some], shift[some], group[some], min(count, MOST_BLURRED)

    def off(blur: float) -> float:
        middle = 0.5 * np.sum(interval(panel_px, shift, group, count, blur), axis=0)
        near = np.floor(middle)
        expected = read((middle - near).astype(np.float32)[group] + shift, blur) + near[group] + 0.5
        return float(np.mean(abs(expected - panel_px)))

    return float(minimize_scalar(off, bounds=BLURS, method="bounded", options={"xatol": BLUR_STEP}).x)


def interval(
    panel_px: npt.NDArray[np.float32], shift: npt.NDArray[np.float32], group: Indices, count: int, blur: float = 0.0
) -> tuple[Floats, Floats]:
    """Return the least and the greatest t of each lenslet whose f is the mean that was read, but for the tolerance."""
    number = np.maximum(np.bincount(group, minlength=count), 1)
    mean = np.bincount(group, weights=panel_px, minlength=count) / number
    # Less the pixel of the mean, so that single precision does.
    whole = np.floor(mean)
    sides = []
    for wanted in (mean - TOLERANCE, mean + TOLERANCE):
        low, high = mean - 1.0, mean + 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            step = read((middle - whole).astype(np.float32)[group] + shift, blur)
            above = whole + np.bincount(group, weights=step, minlength=count) / number + 0.5 > wanted
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        sides.append(0.5 * (low + high))
    return sides[0], sides[1]

"""Find subpixel intervals for the panel points that lenslets show.

A reading is the middle of the panel pixel that a camera pixel sees. With a lenslet's
mean panel point t, and the point's movement s(p) over the cell, the lenslet's camera
pixels p have the mean reading

    f(t) = mean of S(t + s(p) + 1/2 a^2 L(p), b(p)),   S(u, b) = mean of floor(v) + 1/2

over normally distributed v with mean u and deviation b. f increases with t in blurred
steps. The photograph's blur has the deviation a in the cell, and the camera's pupil
adds c on the panel: b(p)^2 = a^2 |s'(p)|^2 + c^2. L is the sum of the second
derivatives of s. Each position's readings determine a and c.

A mean reading therefore gives an interval of t. The interval is short if points move by
a pixel or more over the cell, and a pixel wide if lenslets focus on the panel. The
middle of a wide interval is not a measurement, because neighbouring lenslets have
similar errors. The movement s is computed from exact rays through the fitted array.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.special import ndtr

from lippmann.calibration.lenslet_measurement import Lenslets, Readings
from lippmann.calibration.lenslet_projection import axes_at, inner_rays, means
from lippmann.display.description import Display
from lippmann.optics.rays import Bools, Floats, Indices
from lippmann.optics.system import PanelFrame

Values = npt.NDArray[np.floating]
Singles = npt.NDArray[np.float32]
#: Deviations of the module's formulas: a in pitches, c in panel pixels.
Blur = tuple[float, float]
#: Assumed error of a mean reading, panel pixels.
TOLERANCE = 0.02
#: Lenslets per view in the fits.
SAMPLED, SEED = 60, 1912
#: Exponents of cell position and slope in the movement polynomial.
PLACE = [(a, b) for a in range(8) for b in range(8 - a)]
SLOPE = [(a, b) for a in range(4) for b in range(4 - a)]


def _derivative(axis: int) -> Floats:
    powers, step = np.array(PLACE), np.arange(2) == axis
    return np.where((powers[:, None] + step == powers).all(axis=2), powers[:, axis], 0.0)


ALONG = (_derivative(0), _derivative(1))


@dataclass(frozen=True)
class Movement:
    """Movement of a panel point over a cell, pixels, as a polynomial in slope and cell position."""

    factors: Floats  # Shape (slope monomials, cell monomials, 2).
    slope: Floats  # Mean slope, subtracted from slopes.
    inner: Floats  # Points (M, 2) in the inner cell.

    def _own(self, slopes: Floats) -> Floats:
        return np.asarray(np.tensordot(_powers(slopes - self.slope, SLOPE), self.factors, axes=1))

    def over_cell(self, slopes: Floats, aside: Floats) -> Floats:
        """Return the mean movement (N, 2, 2), pixels per pitch, over cells shifted by `aside` (N, 2)."""
        own, mean = self._own(slopes), _powers(self.inner, PLACE).mean(axis=0)
        ways = np.array([mean @ one for one in ALONG])
        bends = np.array([[mean @ one @ other for other in ALONG] for one in ALONG])
        half = 0.5 * np.einsum("ne,dep,npa->nda", aside, bends, own, optimize=True)
        return np.asarray(np.einsum("dp,npa->nda", ways, own) + half)

    def of(self, local: Values, slopes: Floats, aside: Floats, group: Indices) -> Moved:
        """Return movements from each cell's mean, at positions (M, 2) in the sorted lenslets `group` (M,)."""
        own, at = self._own(slopes), np.asarray(local + aside[group], np.float32)
        own[:, 0] -= np.einsum("nd,nda->na", aside, self.over_cell(slopes, aside))
        ways = [one @ own for one in ALONG]
        bent = ALONG[0] @ ways[0] + ALONG[1] @ ways[1]
        factors = np.concatenate([own, *ways, bent], axis=2).astype(np.float32)
        ends = np.searchsorted(group, np.arange(len(slopes) + 1))
        moved = np.empty((len(at), 8), np.float32)
        # Process about 65,536 readings at once.
        for lenslets in np.array_split(np.arange(len(slopes)), min(len(slopes), 1 + len(at) // 65_536)):
            first = ends[lenslets[0]]
            axes = at[first : ends[lenslets[-1] + 1]].T
            x, y = (np.cumprod([np.ones_like(one), *[one] * 7], axis=0, dtype=np.float32) for one in axes)
            powers = np.asarray([x[a] * y[b] for a, b in PLACE])
            for k in lenslets:
                low, high = ends[k : k + 2] - first
                moved[ends[k] : ends[k + 1]] = powers[:, low:high].T @ factors[k]
        return Moved(moved[:, :2], np.hypot(moved[:, 2:4], moved[:, 4:6]), moved[:, 6:])


@dataclass(frozen=True)
class Moved:
    """Values of M readings: s in pixels, |s'| in pixels per pitch, and L, each (M, 2)."""

    shift: Singles
    change: Singles
    bent: Singles

    def along(self, axis: int, some: Bools | slice = slice(None)) -> Moved:
        """Return the values (M,) along columns (`axis` 0) or rows (`axis` 1)."""
        return Moved(*(one[some, axis] for one in (self.shift, self.change, self.bent)))

    def blurred(self, blur: Blur) -> tuple[Singles, Singles]:
        """Return the movement s + 1/2 a^2 L and the deviation b for a blur."""
        a, c = map(np.float32, blur)
        edge = np.maximum(np.hypot(a * self.change, c), np.float32(1e-3))  # lower limit of b, pixels
        return self.shift + np.float32(0.5) * a * a * self.bent, edge


def _powers(values: Values, exponents: Sequence[tuple[int, int]]) -> Floats:
    x, y = values.T.astype(np.float64)
    return np.stack([x**a * y**b for a, b in exponents], axis=1)


def movement_of(display: Display, slopes: Floats, distance_mm: float) -> Movement:
    """Fit a view's polynomial of point movements to exact rays with slopes (N, 2)."""
    some = slopes[np.random.default_rng(SEED).permutation(len(slopes))[:SAMPLED]]
    inner, at, arrives = inner_rays(display, some, distance_mm)
    local = inner @ axes_at(display.array.rotation_deg) / display.array.pitches_mm[0]
    pixels = (at - means(at, arrives)[:, None]) / display.panel.pitches_mm * [1.0, -1.0]
    middle = slopes.mean(axis=0)
    powers = _powers(some - middle, SLOPE)[:, None, :, None] * _powers(local, PLACE)[None, :, None, :]
    design = powers.reshape(len(some), len(local), -1)[arrives]
    factors = np.linalg.lstsq(design, pixels[arrives], rcond=None)[0]
    return Movement(np.reshape(factors, (len(SLOPE), len(PLACE), 2)), middle, local)


def refined(view: Lenslets, display: Display, slopes: Floats, aside: Floats, movement: Movement) -> Lenslets:
    """Return the view with the middles and half widths of its panel points' intervals.

    The measured cells are shifted by `aside` (N, 2) pitches from the cells of
    `movement`. The half widths do not include `TOLERANCE`.
    """
    readings, frame = view.readings, PanelFrame.of(display)
    assert readings is not None
    count, moved = len(view.index), movement.of(readings.local, slopes, aside, readings.group)
    blur = blur_of(readings, moved, count)
    intervals = [
        interval(readings.panel_px[:, axis], *moved.along(axis).blurred(blur), readings.group, count) for axis in (0, 1)
    ]
    low, high = (np.stack(sides, axis=1) for sides in zip(*intervals, strict=True))
    middle = np.stack(frame.panel_from_pixel(*(0.5 * (low + high)).T), axis=1)
    moves = movement.over_cell(slopes, aside) * np.multiply(display.panel.pitches_mm, [1.0, -1.0])
    return replace(view, panel_mm=middle, moves=moves, half_px=np.maximum(0.5 * (high - low) - TOLERANCE, 0.0))


def read(at: Singles, edge: Singles) -> Singles:
    """Return S - 1/2 of the module's formula, for means `at` (M,) and deviations `edge` (M,)."""
    near = np.rint(at)
    mean = near - 1 + ndtr((at - near) / edge)
    wide = edge > 0.17  # pixels
    if wide.any():
        turn, fade = 2.0 * math.pi * at[wide], -2.0 * np.square(math.pi * edge[wide])  # use the Fourier series
        waves = np.exp(fade) * np.sin(turn) + 0.5 * np.exp(4.0 * fade) * np.sin(2.0 * turn)
        mean[wide] = at[wide] - 0.5 + waves / math.pi
    return np.asarray(mean)


def blur_of(readings: Readings, moved: Moved, count: int) -> Blur:
    """Fit the deviations a and c of S to the readings of some lenslets."""
    lenslets = np.random.default_rng(SEED).permutation(count)[:SAMPLED]
    number = np.full(count, -1)
    number[lenslets] = np.arange(len(lenslets))
    some = number[readings.group] >= 0
    group = number[readings.group[some]]
    axes = [(readings.panel_px[some, axis], moved.along(axis, some)) for axis in (0, 1)]

    def off(blur: Floats) -> Floats:
        parts = []
        for panel_px, own in axes:
            shift, edge = own.blurred((blur[0], blur[1]))
            t = 0.5 * np.sum(interval(panel_px, shift, edge, group, len(lenslets)), axis=0)
            for _ in range(4):  # Newton's method
                near = np.floor(t)
                at = (t - near).astype(np.float32)[group] + shift
                error = panel_px - near[group] - 0.5 - read(at, edge)
                grows = np.exp(-0.5 * ((at - np.rint(at)) / edge) ** 2) / edge
                sums = [np.bincount(group, weights=grows * one, minlength=len(lenslets)) for one in (error, grows)]
                t = t + sums[0] / np.maximum(sums[1], 1e-9) * math.sqrt(2.0 * math.pi)
            parts.append(error)
        return np.concatenate(parts)

    # Start at a = 0.02 pitches and c = 0.03 pixels.
    a, c = least_squares(off, (0.02, 0.03), bounds=(0.0, 0.3), diff_step=0.02, xtol=1e-2, ftol=1e-4, max_nfev=12).x
    return float(a), float(c)


def interval(panel_px: Singles, shift: Singles, edge: Singles, group: Indices, count: int) -> tuple[Floats, Floats]:
    """Return the minimum and maximum t for which f(t) is the mean reading within the tolerance."""
    number = np.maximum(np.bincount(group, minlength=count), 1)
    mean = np.bincount(group, weights=panel_px, minlength=count) / number
    # Subtract the mean reading's pixel, so that single precision suffices.
    pixel = np.floor(mean)
    sides = []
    for target in (mean - TOLERANCE, mean + TOLERANCE):
        low, high = mean - 1.0, mean + 1.0
        for _ in range(11):  # bisections
            middle = 0.5 * (low + high)
            step = read((middle - pixel).astype(np.float32)[group] + shift, edge)
            above = pixel + np.bincount(group, weights=step, minlength=count) / number + 0.5 > target
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        sides.append(0.5 * (low + high))
    return sides[0], sides[1]

"""`fit`: the cheapest model, number of samples and build of the RTL that meet a tolerance.

For the chief rays of a display and a range of depths. All errors are in pixels of the reconstructed view (see
`lippmann.select.model`):

* **model**: how far its rays lie from the exact ones;
* **samples**: how far any light of a panel's pixel can pass from the nearest ray that samples it. The pixel's light
  spreads to w = |z| q / D at depth z; n samples of the unit square leave no place farther than `gap(n)` from them, so
  the error is gap(n) w / max(p, w), largest at the farthest depth;
* **build**: how far its rays, words of F fraction bits, lie from the exact ones.
"""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass
from functools import cache
from typing import get_args

import numpy as np
import numpy.typing as npt

from lippmann.display import Display
from lippmann.engines import trace, trace_fixed
from lippmann.errors import InputError
from lippmann.fixed.build import Build, HardwareModel
from lippmann.fixed.conversion import pixels_of_words, words_of_pixels
from lippmann.fixed.words import FRACTIONS
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.panel import PanelFrame
from lippmann.optics.rays import Rays
from lippmann.optics.sampling import R2_STEPS
from lippmann.select.model import (
    TOLERANCE,
    Choice,
    cell_corners,
    choose_model,
    model_error_px,
    probe,
    reconstructed_pixel_mm,
)

Floats = npt.NDArray[np.float64]

#: Samples that a fit goes up to.
MOST_SAMPLES = 1024
#: How far the probe of a build goes towards a cell's border: beyond, rounding may choose the neighbour.
INSIDE = 0.97
#: Rays all over the panel, and as many in the corners of cells, that a build which passes the probe is tried on too:
#: roundings differ from ray to ray; those of rays that were not tried may be larger by such a share.
SPREAD_RAYS, ROUNDING_MARGIN = 200_000, 0.05
#: Which part of the way to a corner, of INSIDE, these rays take at least.
CORNERS = 0.9


@dataclass(frozen=True)
class Fit:
    """What was chosen, and its errors in pixels of the reconstructed view.

    Attributes
    ----------
    choice
        The lens model.
    samples
        Rays for each pixel; None when MOST_SAMPLES are too few.
    sample_error_px
        Their error, or that of MOST_SAMPLES.
    build
        Of the RTL; None when none that can be built meets the tolerance.
    build_error_px
        Its error, or that of the best build; infinite when no build holds this display or gives its rays.
    """

    choice: Choice
    samples: int | None
    sample_error_px: float
    build: Build | None
    build_error_px: float


def fit(display: Display, depth_range_mm: tuple[float, float], tolerance: float = TOLERANCE) -> Fit:
    """Choose model, samples and build for a display's chief rays.

    Parameters
    ----------
    display
        The display.
    depth_range_mm
        (far, near) z of the scene, mm.
    tolerance
        Largest error allowed of each of the three, in pixels of the reconstructed view.

    Raises
    ------
    InputError
        For a tolerance that is not positive and finite.
    """
    choice = choose_model(display, depth_range_mm, "chief", tolerance)
    spread = max(_spread_px(display, z) for z in depth_range_mm)
    samples = choose_samples(spread, tolerance)
    build, error = choose_build(display, depth_range_mm, tolerance)
    return Fit(choice, samples, gap(samples or MOST_SAMPLES) * spread, build, error)


def choose_samples(spread_px: float, tolerance: float) -> int | None:
    """Return the fewest samples whose gap, times what a pixel spreads to, is within a tolerance.

    None when more than MOST_SAMPLES would be needed.
    """

    def enough(samples: int) -> bool:
        return gap(samples) * spread_px <= tolerance

    if enough(1):
        return 1
    if not enough(MOST_SAMPLES):
        return None
    # From two on each sample more can but shrink the gap: those before it stay where they are.
    return 2 + bisect.bisect_left(range(2, MOST_SAMPLES + 1), True, key=enough)


def _spread_px(display: Display, z_mm: float) -> float:
    """Return what a panel's pixel spreads to at a depth, in reconstructed pixels: at most 1."""
    spread = abs(z_mm) * display.panel.pixel_pitch_mm / display.aperture_distance_mm
    return spread / reconstructed_pixel_mm(display, z_mm)


@cache
def gap(samples: int) -> float:
    """Return the largest distance from a place in the unit square to the nearest of the renderer's samples.

    One sample stands in the centre. More are the first points of the R2 sequence, shifted at random and modulo 1: the
    worst shift leaves a corner of the square as far from them as the radius of the largest empty quarter of a disk.
    That quarter's two straight sides have just passed a point each, i and j. The way from there to point k depends on
    k - i and k - j alone, and point k is there for i - k steps back or k - i steps on: running minima either way.
    Quarters that open to the left are those to the right, turned by 180 degrees with the points.
    """
    if samples == 1:
        return math.sqrt(0.5)
    steps = np.arange(samples)
    apart = np.arange(1 - samples, samples)[:, None]  # j - i
    both = (steps + apart >= 0) & (steps + apart < samples)
    worst = 0.0
    for upward in (1, -1):
        across, up = (_squares(samples, step) for step in (R2_STEPS[0], upward * R2_STEPS[1]))

        def nearest(ahead: npt.NDArray[np.intp], across: Floats = across, up: Floats = up) -> Floats:
            squares = across[ahead + 2 * samples] + up[ahead - apart + 2 * samples]
            return np.asarray(np.minimum.accumulate(squares, axis=1))

        worst = max(worst, float(np.minimum(nearest(-steps), nearest(steps)[:, ::-1])[both].max()))
    return math.sqrt(worst)


def _squares(samples: int, step: float) -> Floats:
    """Return squared ways, modulo 1, to the points 2 `samples` steps back to 2 `samples` on; 1 to the point itself."""
    ahead = np.arange(-2 * samples, 2 * samples + 1)
    squares: Floats = np.where(ahead == 0, 1.0, ahead * step % 1.0) ** 2
    return squares


def choose_build(display: Display, depth_range_mm: tuple[float, float], tolerance: float) -> tuple[Build | None, float]:
    """Return the cheapest build of the RTL within a tolerance, and its error.

    Cheaper hardware first (pinhole, paraxial, exact), and of each the shortest words. None, with the least error, when
    there is none.
    """
    try:
        # As the words hold them, so that rounding moves none over a border.
        few, many = (
            away_from_borders(display, pixels_of_words(display, *words_of_pixels(display, pixels)))
            for pixels in (probe(display, "chief", INSIDE)[0], _spread(display))
        )
    except InputError:  # a panel larger than the words hold
        return None, float("inf")

    def error_px(pixels: Floats, model: HardwareModel, bits: int) -> float:
        try:
            rays = trace_fixed(display, pixels, None, model, bits)
        except InputError:  # the registers cannot hold this display
            return float("inf")
        return build_error_px(display, rays, model, depth_range_mm)

    least = float("inf")
    for model in get_args(HardwareModel):
        for bits in FRACTIONS:
            error = error_px(few, model, bits)
            if error <= tolerance:
                error = max(error, error_px(many, model, bits))
            if error <= tolerance:
                return Build.of(display, model, bits, aims=False), error
            least = min(least, error)
    return None, least


def _spread(display: Display) -> Floats:
    """Return pixel coordinates (N, 2) all over the panel, and of the corners of the cells there."""
    panel, array = display.panel, display.array
    size = np.array([panel.width_px, panel.height_px])
    lattice, frame = Lattice(array.grid, array.pitch_mm), PanelFrame.of(display)
    numbers = np.arange(SPREAD_RAYS)
    everywhere = np.outer(numbers, R2_STEPS) % 1.0 * size
    i, j, _, _ = lattice.locate(NumpyBackend(), *frame.array_from_panel(*frame.panel_from_pixel(*everywhere.T)))
    corners = cell_corners(array.grid, array.pitch_mm)
    x, y = (corners[numbers % len(corners)] * INSIDE * np.linspace(CORNERS, 1.0, SPREAD_RAYS)[:, None]).T
    cx, cy = lattice.centre(i, j)
    there = np.stack(frame.pixel_from_panel(*frame.panel_from_array(cx + x, cy + y)), axis=1)
    return np.concatenate([everywhere, there[((there >= 0.0) & (there < size)).all(axis=1)]])


def away_from_borders(display: Display, pixels: Floats) -> Floats:
    """Return the pixel coordinates (N, 2) that lie within INSIDE of the way from their cell's centre to its border."""
    array = display.array
    lattice, frame = Lattice(array.grid, array.pitch_mm), PanelFrame.of(display)
    _, _, x, y = lattice.locate(NumpyBackend(), *frame.array_from_panel(*frame.panel_from_pixel(*pixels.T)))
    corners = cell_corners(array.grid, array.pitch_mm)
    middles = 0.5 * (corners + np.roll(corners, 1, axis=0))  # of the border's sides
    way = np.stack([x, y], axis=1) @ middles.T / (0.5 * array.pitch_mm) ** 2
    inside: Floats = pixels[way.max(axis=1) <= INSIDE * (1.0 + 1e-9)]
    return inside


def build_error_px(display: Display, rays: Rays, model: HardwareModel, depth_range_mm: tuple[float, float]) -> float:
    """Return how far a build's rays lie from the exact ones of the same pixels, with the margin for their rounding."""
    exact, unrounded = (trace(display, rays.pixel, None, kind) for kind in ("exact", model))
    rounding = model_error_px(display, unrounded, rays, depth_range_mm)
    return model_error_px(display, exact, rays, depth_range_mm) + ROUNDING_MARGIN * rounding

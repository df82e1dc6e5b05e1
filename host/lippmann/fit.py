"""`fit`: the cheapest model, number of samples and build of the RTL that meet a tolerance.

For the chief rays of a display and a range of depths. All errors are in pixels of the reconstructed view (see
`lippmann.choose`):

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

from lippmann.choose import (
    TOLERANCE,
    Choice,
    cell_corners,
    choose_model,
    model_error_px,
    probe,
    reconstructed_pixel_mm,
)
from lippmann.display import Display
from lippmann.errors import InputError
from lippmann.fixed.build import Build, HardwareModel
from lippmann.fixed.trace import pixels_of_words, trace_fixed, words_of_pixels
from lippmann.fixed.words import FRACTIONS
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.panel import PanelFrame
from lippmann.optics.trace import Rays, trace
from lippmann.render.sampling import R2_STEPS

#: Samples that a fit goes up to.
MOST_SAMPLES = 1024
#: Places along each side of the unit square in which the largest gap is sought.
GAP_PLACES = 64
#: How far the probe of a build goes towards a cell's border: beyond, rounding may choose the neighbour.
INSIDE = 0.97
#: Rounding errors of rays that the probe has not met may be larger by such a share.
ROUNDING_MARGIN = 0.5


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
    """
    if samples == 1:
        return math.sqrt(0.5)
    points = np.outer(np.arange(samples), R2_STEPS) % 1.0
    apex = (np.arange(GAP_PLACES) + 0.5) / GAP_PLACES
    across = (points[:, 0] - apex[:, None]) % 1.0  # (places, samples), to the right
    up = (points[:, 1] - apex[:, None]) % 1.0
    worst = 0.0
    for x in (across, 1.0 - across):
        for y in (up, 1.0 - up):
            nearest = np.min(x[:, None, :] ** 2 + y[None, :, :] ** 2, axis=2)
            worst = max(worst, float(nearest.max()))
    # A quarter that begins between two places reaches at most one step farther.
    return math.sqrt(worst) + math.sqrt(0.5) / GAP_PLACES


def choose_build(display: Display, depth_range_mm: tuple[float, float], tolerance: float) -> tuple[Build | None, float]:
    """Return the cheapest build of the RTL within a tolerance, and its error.

    Cheaper hardware first (pinhole, paraxial, exact), and of each the shortest words. None, with the least error, when
    there is none.
    """
    pixels = probe(display, "chief", INSIDE)[0]
    try:
        # As the words hold them, so that rounding moves none over a border.
        pixels = away_from_borders(display, pixels_of_words(display, *words_of_pixels(display, pixels)))
    except InputError:  # a panel larger than the words hold
        return None, float("inf")
    least = float("inf")
    for model in get_args(HardwareModel):
        for bits in FRACTIONS:
            try:
                rays = trace_fixed(display, pixels, None, model, bits)
            except InputError:  # the registers cannot hold this display
                continue
            error = build_error_px(display, rays, model, depth_range_mm)
            if error <= tolerance:
                return Build.of(display, model, bits, aims=False), error
            least = min(least, error)
    return None, least


def away_from_borders(display: Display, pixels: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the pixel coordinates (N, 2) that lie within INSIDE of the way from their cell's centre to its border."""
    array = display.array
    lattice, frame = Lattice(array.grid, array.pitch_mm), PanelFrame.of(display)
    _, _, x, y = lattice.locate(NumpyBackend(), *frame.array_from_panel(*frame.panel_from_pixel(*pixels.T)))
    corners = cell_corners(array.grid, array.pitch_mm)
    middles = 0.5 * (corners + np.roll(corners, 1, axis=0))  # of the border's sides
    way = np.stack([x, y], axis=1) @ middles.T / (0.5 * array.pitch_mm) ** 2
    inside: npt.NDArray[np.float64] = pixels[way.max(axis=1) <= INSIDE * (1.0 + 1e-9)]
    return inside


def build_error_px(display: Display, rays: Rays, model: HardwareModel, depth_range_mm: tuple[float, float]) -> float:
    """Return how far a build's rays lie from the exact ones of the same pixels, with the margin for their rounding."""
    exact, unrounded = (trace(display, rays.pixel, None, kind) for kind in ("exact", model))
    rounding = model_error_px(display, unrounded, rays, depth_range_mm)
    return model_error_px(display, exact, rays, depth_range_mm) + ROUNDING_MARGIN * rounding

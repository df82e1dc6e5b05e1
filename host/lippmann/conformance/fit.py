"""Choose the cheapest lens model, sample count and RTL build within an error tolerance.

All errors are for chief rays, in pixels of the reconstructed view (docs/models.md). At
depth z, the light of a panel pixel of pitch q spreads to the width w = |z| q / D, with
the aperture distance D. With the lenslet pitch p, the width is w / max(p, w) pixels
of the view. The sampling error is the samples' `gap` in the rectangle to which the
light of a pixel spreads at the farthest depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Annotated, get_args

import numpy as np

from lippmann.base.toml import documented, key
from lippmann.display.description import Display, Pair
from lippmann.engines import trace, trace_fixed
from lippmann.errors import InputError
from lippmann.fixed.build import Build, HardwareModel
from lippmann.fixed.conversion import pixels_of_words, words_of_pixels
from lippmann.fixed.words import FRACTIONS
from lippmann.optics.model_choice import (
    TOLERANCE,
    Choice,
    choose_model,
    corners_mm,
    in_cells_mm,
    located,
    model_error_px,
    on_panel,
    panel_size,
    pixels_from_cells,
    probe,
)
from lippmann.optics.rays import Floats, Model, Rays
from lippmann.optics.sample_points import R2_STEPS, pixel_steps
from lippmann.optics.system import System

MOST_SAMPLES = 1024
#: Candidate sample counts, in steps of 1 or of about 5 % (1024^(1/142)).
TRIED_SAMPLES = sorted({round(MOST_SAMPLES ** (k / 142)) for k in range(143)})
#: Scale of the cell in which test rays start; outside, rounding may change the lenslet.
INSIDE = 0.97
#: Number of rays in an RTL build's second test. Fraction of the tested rounding
#: error that is added for other rays.
SPREAD_RAYS, ROUNDING_MARGIN = 200_000, 0.05


@documented
@dataclass(frozen=True)
class Fit:
    """Chosen lens model, sample count and RTL build, with errors in pixels of the reconstructed view."""

    choice: Annotated[Choice, key("lens model")]
    samples: Annotated[int | None, key("rays per pixel; None if MOST_SAMPLES rays are too few")]
    sample_error_px: Annotated[float, key("error of the samples, or of MOST_SAMPLES")]
    build: Annotated[Build | None, key("build of the RTL; None if every build exceeds the tolerance")]
    build_error_px: Annotated[float, key("error of this or the best build; infinite without a build")]


def fit(display: Display, depth_range_mm: Pair, tolerance: float = TOLERANCE) -> Fit:
    """Choose lens model, sample count and RTL build; parameters and errors are as in `choose_model`."""
    choice = choose_model(display, depth_range_mm, "chief", tolerance)
    # Spread of a panel pixel's light along each axis, in reconstructed pixels.
    farthest = max(map(abs, depth_range_mm)) / display.aperture_distance_mm
    x, y = (farthest * q / max(display.array.finest_mm, farthest * q) for q in display.panel.pitches_mm)
    samples = choose_samples((x, y), tolerance)
    build, error = choose_build(display, depth_range_mm, tolerance)
    return Fit(choice, samples, gap(samples or MOST_SAMPLES, (x, y)), build, error)


def choose_samples(spread_px: Pair, tolerance: float) -> int | None:
    """Return the smallest of TRIED_SAMPLES whose `gap` is within tolerance, or None."""
    # `gap` is not monotonic, because an added sample moves all samples.
    return next((samples for samples in TRIED_SAMPLES if gap(samples, spread_px) <= tolerance), None)


@cache
def gap(samples: int, sides: Pair) -> float:
    """Return the maximum distance in a rectangle to the nearest sample, of both orders of axes the larger.

    The maximum is at a Voronoi cell's corner. Samples reflected at the sides clip the
    cells there.
    """
    if samples == 1:
        return 0.5 * math.hypot(*sides)
    from scipy.spatial import KDTree, Voronoi  # slow import

    steps = np.arange(samples)[:, None]
    first, step = np.transpose(pixel_steps(samples))
    places = (first + steps * step) % (1 << 32) * 2.0**-32
    worst, half = 0.0, np.divide(sides, 2)
    for points in (places * sides, places[:, ::-1] * sides):
        reflected = [
            np.where(np.arange(2) == axis, 2.0 * side - points, points)
            for axis in range(2)
            for side in (0.0, sides[axis])
        ]
        corners = Voronoi(np.concatenate([points, *reflected])).vertices
        inside = (np.abs(corners - half) <= half * (1 + 1e-9)).all(axis=1)
        worst = max(worst, float(KDTree(points).query(corners[inside])[0].max()))
    return worst


def choose_build(display: Display, depth_range_mm: Pair, tolerance: float) -> tuple[Build | None, float]:
    """Return the cheapest RTL build within the tolerance, and its error; else None and the smallest error."""
    try:
        # Round the pixels to words first, so that rounding moves no pixel across a cell border.
        probes = {
            name: away_from_borders(display, pixels_of_words(display, *words_of_pixels(display, pixels)))
            for name, pixels in (("few", probe(display, "chief", INSIDE)[0]), ("many", _spread(display)))
        }
    except InputError:  # the panel exceeds the range of the words
        return None, math.inf

    @cache
    def unrounded(name: str, model: Model) -> Rays:
        return trace(display, probes[name], None, model)

    def error_px(name: str, model: HardwareModel, bits: int) -> float:
        try:
            rays = trace_fixed(display, probes[name], None, model, bits)
        except InputError:  # the display exceeds the range of the registers
            return math.inf
        kinds: set[Model] = {model, "exact"}
        far = {kind: model_error_px(display, unrounded(name, kind), rays, depth_range_mm) for kind in kinds}
        return far["exact"] + ROUNDING_MARGIN * far[model]

    least = math.inf
    for model in get_args(HardwareModel):
        for bits in FRACTIONS:
            error = error_px("few", model, bits)
            if error <= tolerance:
                error = max(error, error_px("many", model, bits))
            if error <= tolerance:
                return Build.of(display, model, bits, aims=False), error
            least = min(least, error)
    return None, least


def _spread(display: Display) -> Floats:
    numbers = np.arange(SPREAD_RAYS)
    everywhere = np.outer(numbers, R2_STEPS) % 1.0 * panel_size(display)
    corners = INSIDE * corners_mm(display.array)
    # Points on the outer tenth of the line from a cell's centre to its corner.
    local = corners[numbers % len(corners)] * np.linspace(0.9, 1.0, SPREAD_RAYS)[:, None]
    in_corners = pixels_from_cells(display, located(display, everywhere)[0], local)
    return np.concatenate([everywhere, on_panel(display, in_corners)])


def away_from_borders(display: Display, pixels: Floats) -> Floats:
    """Select the pixels (N, 2) that are within the fraction INSIDE of their lenslet's cell."""
    lattice = System.of(display).lattice
    across = np.abs(in_cells_mm(display, pixels) @ np.array(lattice.axes).T).max(axis=1)
    inside: Floats = pixels[across <= INSIDE * (1.0 + 1e-9) * lattice.half_mm]
    return inside

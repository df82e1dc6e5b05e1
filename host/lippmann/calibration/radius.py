"""The lenslets' radius: how far the panel point moves over a lenslet's aperture, which tells how far from focus it is.

Seen by a distant camera, the panel point of a thin lens moves by 1 - D / f of the way across the aperture. Rays that go
through the middle, and so all else that is measured, hardly depend on the radius. Exact rays give the movement for a
radius; the radius is the one with the movement that was measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from lippmann.calibration.bundle import Solution
from lippmann.calibration.landing import movement
from lippmann.calibration.lenslets import Lenslets
from lippmann.display.description import Display
from lippmann.errors import input_error

Floats = npt.NDArray[np.float64]
#: Range in which the radius is looked for, as factors of the file's.
RANGE = (0.75, 1.33)
#: Least radius, in half diagonals of a cell.
LEAST_RADIUS = 1.001
#: Lenslets of a position whose rays are traced.
TRACED = 48
#: Least standard deviation, as a share: what blur and aberrations leave on computed photographs.
LEAST_SHARE = 0.003
SEED = 1913


@dataclass(frozen=True)
class Radius:
    """A radius and its standard deviation, mm."""

    value_mm: float
    deviation_mm: float


def radius_of(display: Display, solution: Solution) -> Radius:
    """Return the radius that the movements in each position give, for the display that was found without.

    Raises InputError when no radius near the file's gives a measured movement.
    """
    views = solution.problem.views
    found = np.array([_of_position(display, solution, k, view) for k, view in enumerate(views)])
    value = float(found.mean())
    scatter = float(found.std(ddof=1)) / np.sqrt(len(found)) if len(found) > 1 else 0.02 * value
    return Radius(value, float(np.hypot(scatter, LEAST_SHARE * value)))


def measured_movement(view: Lenslets, display: Display) -> float:
    """Return the movement of a position's panel points over the aperture, mm a mm, the same in both directions."""
    turn = np.deg2rad(display.array.rotation_deg)
    c, s = np.cos(turn), np.sin(turn)
    return float(np.trace(view.spread @ [[c, -s], [s, c]])) / (2.0 * float(np.mean(display.array.pitches_mm)))


def _of_position(display: Display, solution: Solution, k: int, view: Lenslets) -> float:
    place = np.array([solution.value(f"place_{axis}_{k}") for axis in "xyz"])
    centres = solution.problem.centres(solution.x, solution.problem.places[k])
    some = np.random.default_rng(SEED).permutation(len(centres))[:TRACED]
    slopes = (place[:2] - centres[some]) / place[2]
    measured, old = measured_movement(view, display), display.array.radius_mm

    def off(radius_mm: float) -> float:
        array = replace(display.array, radius_mm=radius_mm)
        array = replace(array, thickness_mm=max(array.thickness_mm, array.sag_mm))
        return movement(replace(display, array=array), slopes, float(place[2])) - measured

    # A dome spans its cell.
    low, high = max(RANGE[0] * old, LEAST_RADIUS * display.array.half_diagonal_mm), RANGE[1] * old
    if off(low) * off(high) > 0.0:
        what = f"no radius from {low:.4g} to {high:.4g} mm moves the panel's points as photographed"
        raise input_error(view.name, what, "correct radius_mm, thickness_mm or index in the display file")
    return float(brentq(off, low, high, rtol=1e-5))

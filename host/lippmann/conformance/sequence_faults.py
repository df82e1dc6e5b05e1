"""Faults in the order of rays: late or early outputs, and registers of an earlier configuration."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lippmann.conformance.comparison import Comparison, delay_text
from lippmann.conformance.fault_search import EXPLAINED, MANY, Finding, find_fault
from lippmann.conformance.ray_sets import Bools
from lippmann.conformance.tracer_faults import turn_back
from lippmann.optics.rays import Floats
from lippmann.optics.system import System

#: Tried delays of outputs, in rays.
LAGS = (1, -1, 2, -2, 3, -3)


def directions_in_array(compared: Comparison) -> tuple[Floats, Floats]:
    """Return tested and golden directions (N, 3) in the array's axes."""
    frame = System.of(compared.inputs.display).frame
    return turn_back(frame, compared.fields["direction"]), turn_back(frame, compared.golden["direction"])


def find_delay(right: Callable[[int], Bools]) -> Finding | None:
    """Find late or early outputs; `right(lag)` marks the rays that match at a delay."""
    # Nearly equal rays may match at any delay; a true delay matches more rays than no delay.
    own = right(0).mean()
    for lag in LAGS:
        same = right(lag)
        if len(same) >= MANY and same.mean() >= EXPLAINED and same.mean() > own:
            return Finding("exit", f"outputs {delay_text(lag)}: ray k has the values of ray k {-lag:+d}", 1.0)
    return None


def find_late_component(compared: Comparison) -> Finding | None:
    """Find a late or early component of the directions."""
    if compared.wrong_arrays != ["direction"] or len(compared.edge) < 2 * MANY:
        return None
    directions, expected = directions_in_array(compared)
    right = float((~compared.wrong).mean())
    for lag in LAGS:
        for axes, which in (((0,), "x"), ((1,), "y"), ((2,), "z"), ((0, 1), "x and y")):
            moved = expected.copy()
            moved[:, axes] = np.roll(expected, lag, axis=0)[:, axes]
            share = float((np.linalg.norm(directions - moved, axis=1) <= compared.limits["direction"]).mean())
            if share >= EXPLAINED and share > right:
                fault = f"direction's {which} {delay_text(lag)}: ray k has that of ray k {-lag:+d}"
                return Finding("exit", fault, share)
    return None


def find_stale_register(compared: Comparison) -> Finding | None:
    """Find successive rays traced with the registers of an earlier configuration."""
    run = np.flatnonzero(compared.wrong)
    first, last = int(run[0]), int(run[-1])
    if len(run) < MANY or last + 1 - first >= len(compared.edge) or len(run) < 0.5 * (last + 1 - first):
        return None
    best = find_fault(compared.select(np.arange(first, last + 1)))
    if best is None:
        return None
    what = f"rays {first} to {last} are of an earlier configuration"
    return best._replace(fault=f"stale register: {what} ({best.fault})")

"""How far the rays of another tracer may be off: for all rays, for steps of the ray, and for hard cases.

A file of bounds is kept beside the design that it is for (`regress --bounds`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import numpy as np

from lippmann.base import toml
from lippmann.base.toml import documented, key
from lippmann.conformance.coverage_points import POINTS
from lippmann.conformance.hard_cases import Out
from lippmann.conformance.ray_search import Floats
from lippmann.errors import did_you_mean, input_error

Urad = Annotated[float, key("how far directions may be off, microradians", above=0.0)]
Nm = Annotated[float, key("how far points may be off, nm", above=0.0)]
#: Arrays of points, by the step that computes them.
Step = Literal["panel_mm", "start_mm", "near_mm", "centre_mm", "local_mm", "origin_mm"]


@documented
@dataclass(frozen=True, kw_only=True)
class StepBound:
    """The bound of a step of the ray."""

    array: Annotated[Step, key("the step's array, as in a file of rays")]
    point_nm: Nm


@documented
@dataclass(frozen=True, kw_only=True)
class CaseBound:
    """The bounds of a hard case; the largest counts for a ray that meets several."""

    point: Annotated[str, key("a coverage point, such as `grazing-exit`")]
    direction_urad: Urad | None = None
    point_nm: Nm | None = None


@documented
@dataclass(frozen=True, kw_only=True)
class Bounds:
    """The keys of a file of bounds; what a step or a case does not say is as for all rays."""

    direction_urad: Urad = 2.0
    point_nm: Nm = 50.0
    step: Annotated[tuple[StepBound, ...], key("")] = ()
    case: Annotated[tuple[CaseBound, ...], key("")] = ()

    def limits(self, given: Out, rays: Mapping[str, Floats]) -> dict[str, Floats]:
        """Return how far each array of rays may be off, (N,), radians and mm; `rays` are golden's."""
        count = len(rays["status"])
        steps = {one.array: one.point_nm for one in self.step}
        found: dict[str, Floats] = {
            name: np.full(count, 1e-6 * steps.get(name, self.point_nm)) for name in get_args(Step)
        }
        found["direction"] = np.full(count, 1e-6 * self.direction_urad)
        for name, limit in found.items():
            most = np.zeros(count)
            for case in self.case:
                bound = case.direction_urad if name == "direction" else case.point_nm
                if bound is not None:
                    most = np.where(POINTS[case.point](given, rays), np.maximum(most, 1e-6 * bound), most)
            found[name] = np.where(most > 0.0, most, limit)
        return found


def load_bounds(path: Path) -> Bounds:
    """Read a file of bounds; raise InputError, with file, key and remedy, for what is wrong in it."""
    bounds = toml.read(Bounds, toml.load(path, "bounds"), str(path))
    for name, some in (("step", [one.array for one in bounds.step]), ("case", [one.point for one in bounds.case])):
        for number, one in enumerate(some):
            if one in some[:number]:
                raise input_error(f"{path}: {name}[{number}]", f"'{one}' is bounded twice", "keep one of them")
    for number, case in enumerate(bounds.case):
        if case.point not in POINTS:
            remedy = did_you_mean(case.point, POINTS) or f"choose from {', '.join(POINTS)}"
            raise input_error(f"{path}: case[{number}].point", f"there is no coverage point '{case.point}'", remedy)
        if case.direction_urad is None and case.point_nm is None:
            raise input_error(f"{path}: case[{number}]", "it has no bound", "add direction_urad or point_nm")
    return bounds

"""Error bounds of tested rays: read a bounds file, find each ray's bounds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import numpy as np

from lippmann.base import toml
from lippmann.base.toml import documented, key
from lippmann.conformance.coverage_points import POINTS, points_met
from lippmann.conformance.ray_sets import PanelRays
from lippmann.conformance.tracer_faults import Arrays
from lippmann.errors import did_you_mean, input_error

Urad = Annotated[float, key("maximum error of directions, microradians", above=0.0)]
Nm = Annotated[float, key("maximum error of points, nm", above=0.0)]
#: Names of the point arrays, each the result of a trace step.
Step = Literal["panel_mm", "start_mm", "near_mm", "centre_mm", "local_mm", "origin_mm"]


@documented
@dataclass(frozen=True, kw_only=True)
class StepBound:
    """The maximum error of a trace step."""

    array: Annotated[Step, key("array of the step, as in a file of rays")]
    point_nm: Nm


@documented
@dataclass(frozen=True, kw_only=True)
class CaseBound:
    """The maximum errors of rays at a coverage point; a ray at several points gets the largest bound."""

    point: Annotated[str, key("coverage point, such as `grazing-exit`")]
    direction_urad: Urad | None = None
    point_nm: Nm | None = None


@documented
@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Contents of an error-bounds file. A step or case without its own bound has the general bound."""

    direction_urad: Urad = 2.0
    point_nm: Nm = 50.0
    step: Annotated[tuple[StepBound, ...], key("")] = ()
    case: Annotated[tuple[CaseBound, ...], key("")] = ()

    def limits(self, inputs: PanelRays, rays: Arrays) -> Arrays:
        """Return the error bounds (N,), radians or mm, keyed by array; `rays` are the golden rays."""
        steps = {one.array: one.point_nm for one in self.step}
        met = points_met(inputs, rays) if self.case else {}
        limits: Arrays = {}
        for name in (*get_args(Step), "direction"):
            usual = self.direction_urad if name == "direction" else steps.get(name, self.point_nm)
            largest = np.zeros(len(inputs.pixels))
            for case in self.case:
                bound = (case.direction_urad if name == "direction" else case.point_nm) or 0.0
                largest = np.maximum(largest, bound * met[case.point])
            limits[name] = 1e-6 * np.where(largest > 0.0, largest, usual)
        return limits


def load_bounds(path: Path) -> Bounds:
    """Read an error-bounds file. Raises InputError for an invalid file."""
    bounds = toml.read(Bounds, toml.load(path, "bounds"), str(path))
    for name, bounded in (("step", [one.array for one in bounds.step]), ("case", [one.point for one in bounds.case])):
        for number, one in enumerate(bounded):
            if one in bounded[:number]:
                raise input_error(f"{path}: {name}[{number}]", f"'{one}' has two bounds", "remove one bound")
    for number, case in enumerate(bounds.case):
        if case.point not in POINTS:
            remedy = did_you_mean(case.point, POINTS) or f"choose from {', '.join(POINTS)}"
            raise input_error(f"{path}: case[{number}].point", f"there is no coverage point '{case.point}'", remedy)
        if case.direction_urad is None and case.point_nm is None:
            raise input_error(f"{path}: case[{number}]", "the case has no bound", "add direction_urad or point_nm")
    return bounds

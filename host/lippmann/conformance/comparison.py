"""Compare tested rays with golden rays. A ray is on an edge if rounding can change its lenslet or status."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lippmann.conformance.error_bounds import Bounds
from lippmann.conformance.ray_sets import Bools, ForeignRays, PanelRays, Selection
from lippmann.conformance.tracer_faults import FIELDS, Arrays, golden
from lippmann.optics.rays import Floats

#: Names of the integer arrays of rays.
INTEGERS = ("home", "lenslet", "status")
#: Directions in which rays are moved to find rays on an edge.
AXES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
AROUND = np.concatenate([AXES, AXES @ [[1.0, 1.0], [-1.0, 1.0]]])
SHARES = (1.0, 0.5, 0.25, 0.0625)
#: Maximum rays moved at once; a ray needs about 10 kB.
AT_ONCE = 4096


@dataclass(frozen=True)
class FieldSummary:
    """Errors of a ray array: maximum (`worst`), and range of allowed errors (`limits`)."""

    field: str
    stage: str
    compared: int
    wrong: int
    worst: float
    limits: tuple[float, float]
    unit: str


@dataclass(frozen=True)
class Comparison:
    """Comparison of N tested rays with the golden engine's rays.

    `limits` contains the allowed errors (N,), keyed by array. `edge` (N,) marks rays on
    an edge. `excused` (N,) marks rays on an edge that agree with a golden ray on one
    side of the edge. `alone` (N,) marks rays of which only the status is compared.
    """

    inputs: PanelRays
    fields: Arrays
    golden: Arrays
    limits: Arrays
    edge: Bools
    excused: Bools
    alone: Bools

    @cached_property
    def wrong_by(self) -> dict[str, Bools]:
        """Masks (N,) of rays whose error exceeds the limit, keyed by array."""
        return {name: self.wrong_in(name, values) for name, values in self.fields.items()}

    @cached_property
    def wrong(self) -> Bools:
        """Mask (N,) of rays with a wrong value in at least one array."""
        return np.asarray(np.any(list(self.wrong_by.values()), axis=0))

    @property
    def wrong_arrays(self) -> list[str]:
        """Names of the arrays that contain wrong values."""
        return [name for name, wrong in self.wrong_by.items() if wrong.any()]

    def far(self, name: str, values: Floats, other: Arrays) -> Floats:
        """Return the `distance` of values from `other[name]`; 0 for values that are not compared."""
        return np.where(self.alone & (name != "status"), 0.0, distance(name, values, other[name]))

    def wrong_in(self, name: str, values: Floats) -> Bools:
        """Return a mask (N,) of the wrong values of the array `name`."""
        far = self.far(name, values, self.golden)
        excused = self.excused & np.isfinite(far) & (name != "panel_mm")
        return (far > self.limits[name]) & ~excused

    def select(self, rays: Selection) -> Comparison:
        """Return the comparison of selected rays."""
        fields, golden, limits = (
            {name: array[rays] for name, array in arrays.items()} for arrays in (self.fields, self.golden, self.limits)
        )
        masks = [mask[rays] for mask in (self.edge, self.excused, self.alone)]
        return Comparison(self.inputs.select(rays), fields, golden, limits, *masks)

    def later(self, lag: int) -> Comparison:
        """Compare golden ray k with tested ray k + `lag`."""
        rays = np.arange(max(0, -lag), len(self.edge) - max(0, lag))
        fields = {name: values[rays + lag] for name, values in self.fields.items()}
        return replace(self.select(rays), fields=fields, alone=self.alone[rays + lag])

    def summary(self, name: str) -> FieldSummary:
        """Summarise the errors of the array `name`."""
        unit, scale = ("microradian" if name == "direction" else "nm"), 1e6
        if name in INTEGERS:
            unit, scale = "rays", 1.0
        plain = ~self.edge
        far = self.far(name, self.fields[name], self.golden)[plain] * scale
        limit = self.limits[name][plain] * scale
        limits = (float(limit.min()), float(limit.max())) if len(limit) else (0.0, 0.0)
        wrong = int(self.wrong_by[name].sum())
        return FieldSummary(name, FIELDS[name][0], len(plain), wrong, float(far.max(initial=0.0)), limits, unit)


@np.errstate(all="ignore")  # tested values may overflow
def compare(
    foreign: ForeignRays, bounds: Bounds, moves_mm: tuple[Floats, Floats] | None = None, every: bool = True
) -> Comparison:
    """Compare tested rays with the golden engine's rays.

    The allowed error of a ray is its bound plus its largest change when panel point or
    aperture point moves by `moves_mm`, (N, 2) each (default: `roundings`). If `every` is
    false, only rays that exceed their bounds are moved.
    """
    inputs = foreign.inputs
    rays, n = golden(inputs), len(inputs.pixels)
    panel_mm, aim_mm = moves_mm or roundings(inputs)
    limits = dict.fromkeys(INTEGERS, np.zeros(n)) | bounds.limits(inputs, rays)
    alone = np.zeros(n, bool) if foreign.alone is None else foreign.alone
    compared = Comparison(inputs, foreign.fields, rays, limits, np.zeros(n, bool), np.zeros(n, bool), alone)
    indices = np.arange(n) if every else np.flatnonzero(compared.wrong)
    if not len(indices):
        return compared
    more, across = _effect_of_moves(compared.select(indices), panel_mm[indices], aim_mm[indices])
    for name, extra in more.items():
        limits[name][indices] += extra
    edge, excused = np.zeros((2, n), bool)
    edge[indices] = across
    on_edge = np.flatnonzero(edge)
    for some in np.split(on_edge, range(AT_ONCE, len(on_edge), AT_ONCE)):
        excused[some] = _on_some_side(compared.select(some), panel_mm[some], aim_mm[some])
    return replace(compared, edge=edge, excused=excused)


def _effect_of_moves(compared: Comparison, panel_mm: Floats, aim_mm: Floats) -> tuple[Arrays, Bools]:
    n = len(compared.edge)
    largest = {name: np.zeros(n) for name in ("direction", "local_mm", "origin_mm")}
    edge = np.zeros(n, bool)
    for other in map(golden, _displaced(compared.inputs, panel_mm, aim_mm)):
        across = np.any([(other[name] != compared.golden[name]).any(axis=1) for name in INTEGERS], axis=0)
        edge |= across
        for name, far in largest.items():
            moves = np.linalg.norm(other[name] - compared.golden[name], axis=1)
            far[:] = np.maximum(far, np.where(across, 0.0, moves))
    moves = np.maximum(panel_mm, aim_mm).max(axis=1)
    return {name: largest.get(name, moves) for name in compared.limits if name not in INTEGERS}, edge


def _displaced(inputs: PanelRays, panel_mm: Floats, aim_mm: Floats, ways: Floats = AXES) -> Iterator[PanelRays]:
    aimed = replace(inputs, aperture=inputs.aims)
    for step in ways:
        yield replace(aimed, pixels=inputs.pixels + step * panel_mm / inputs.display.panel.pitches_mm)
        yield replace(aimed, aperture=inputs.aims + step * aim_mm)


def _on_some_side(compared: Comparison, panel_mm: Floats, aim_mm: Floats) -> Bools:
    sides = [compared.golden]
    for share in SHARES:
        sides += map(golden, _displaced(compared.inputs, share * panel_mm, share * aim_mm, AROUND))
    fields, alone = compared.fields, compared.alone
    same = np.ones((len(sides), len(alone)), bool)
    for name in fields.keys() & INTEGERS:
        same &= [(fields[name] == side[name]).all(axis=1) | (alone & (name != "status")) for side in sides]
    right = np.asarray(same.any(axis=0))
    for name in fields.keys() - {*INTEGERS, "panel_mm"}:
        values = np.array([side[name] for side in sides])
        low = np.where(same[..., None], values, np.inf).min(axis=0)
        high = np.where(same[..., None], values, -np.inf).max(axis=0)
        # Accept values outside the moved rays' range by at most its width plus the limit.
        beyond = np.maximum(low - fields[name], fields[name] - high) - np.maximum(high - low, 0.0)
        far = np.where(np.isfinite(beyond), np.maximum(beyond, 0.0), np.inf)
        right &= alone | (np.linalg.norm(far, axis=1) <= compared.limits[name])
    return right


def roundings(inputs: PanelRays) -> tuple[Floats, Floats]:
    """Return the float32 rounding errors, (N, 2) mm each, of panel points and aperture points.

    The minimum of each error is one ulp of the pitch.
    """
    pitch, pixel = inputs.display.array.coarsest_mm, np.array(inputs.display.panel.pitches_mm)

    def rounding(values: Floats) -> Floats:
        return 0.5 * np.spacing(np.abs(values).astype(np.float32)).astype(np.float64)

    least = 4.0 * rounding(np.array(0.5 * pitch))
    return np.maximum(pixel * rounding(inputs.pixels), least), np.maximum(rounding(inputs.aims), least)


def distance(name: str, values: Floats, expected: Floats) -> Floats:
    """Return distances (N,) from expected values; NaN gives infinity, integers give 0 or 1."""
    if name in INTEGERS:
        return np.asarray((values != expected).any(axis=1), np.float64)
    far = np.linalg.norm(values - expected, axis=1)
    return np.where(np.isfinite(far), far, np.inf)


def delay_text(lag: int) -> str:
    """Return a delay, in rays, as text for a fault."""
    return f"{'late' if lag > 0 else 'early'} by {abs(lag)}"

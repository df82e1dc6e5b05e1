"""Foreign rays beside golden's: how far each value may be off, and which are.

A ray may be off by the tolerance plus the effect of rounding its inputs to float32, so that a rounding never counts as
a fault, however ill-conditioned a ray is. Where such a rounding changes lenslet or status, the ray is on an edge, and
may be golden's on either side.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from lippmann.conformance.bounds import Bounds
from lippmann.conformance.coverage_points import tie
from lippmann.conformance.foreign_rays import Foreign
from lippmann.conformance.hard_cases import Out
from lippmann.conformance.lens_faults import FIELDS, Arrays, golden
from lippmann.conformance.ray_search import Bools, Floats

#: Arrays of integers.
WHOLE = ("home", "lenslet", "status")
#: Ways in which rays are displaced, to see whether they are on an edge; to see all sides of it, and by which shares.
AXES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
AROUND = np.concatenate([AXES, AXES @ [[1.0, 1.0], [-1.0, 1.0]]])
SHARES = (1.0, 0.5, 0.25, 0.0625)
#: Rays on an edge that are looked at together: some ten kilobytes each.
AT_ONCE = 4096


@dataclass(frozen=True)
class Compared:
    """One array of the file: the step that computes it, rays compared and wrong, the largest difference and its unit.

    `limits` are the smallest and the largest difference that any ray was allowed.
    """

    field: str
    stage: str
    compared: int
    wrong: int
    worst: float
    limits: tuple[float, float]
    unit: str


@dataclass(frozen=True)
class Comparison:
    """Foreign rays beside golden's: N rays and their inputs.

    `fields` are the arrays of the file and `golden` golden's; `limits` (N,) say how far a ray may be off in each array;
    `edge` (N,) marks rays whose status or lenslet changes within them; of `alone` (N,) the status alone is compared.
    `wrong_on_edge` are the rays on an edge, by array, that are golden's on no side of it.
    """

    given: Out
    fields: Arrays
    golden: Arrays
    limits: Arrays
    edge: Bools
    alone: Bools
    wrong_on_edge: dict[str, Bools] = field(default_factory=dict)

    @cached_property
    def wrong_by(self) -> dict[str, Bools]:
        """The rays that are wrong, by array."""
        found = {name: self.wrong_in(name, values) for name, values in self.fields.items()}
        return found | {name: found[name] | wrong for name, wrong in self.wrong_on_edge.items()}

    @cached_property
    def wrong(self) -> Bools:
        """The rays that are wrong in some array."""
        return np.asarray(np.any(list(self.wrong_by.values()), axis=0))

    @property
    def ties(self) -> Bools:
        """The panel points exactly on an edge that two cells share, which only one of them owns."""
        return tie(self.given, self.golden)

    def far(self, name: str, values: Floats, other: Arrays) -> Floats:
        """Return how far values of an array are from another's, as `distance`; 0 where they are not given."""
        return np.where(self.alone & (name != "status"), 0.0, distance(name, values, other[name]))

    def wrong_in(self, name: str, values: Floats) -> Bools:
        """Tell which values of an array are wrong; on an edge only panel points and values that are not finite."""
        far = self.far(name, values, self.golden)
        excused = self.edge & np.isfinite(far) & (name != "panel_mm")
        return np.asarray((far > self.limits[name]) & ~excused)

    def some(self, chosen: npt.NDArray[np.intp]) -> Comparison:
        """Return the comparison of some rays."""
        fields, golden, limits = (
            {key: array[chosen] for key, array in arrays.items()} for arrays in (self.fields, self.golden, self.limits)
        )
        edges = {name: wrong[chosen] for name, wrong in self.wrong_on_edge.items()}
        given = self.given.some(chosen)
        return Comparison(given, fields, golden, limits, self.edge[chosen], self.alone[chosen], edges)

    def later(self, lag: int) -> Comparison:
        """Return the comparison of each ray with the values that stand `lag` rays after it."""
        rays = np.arange(max(0, -lag), len(self.edge) - max(0, lag))
        made = self.some(rays)
        fields = {name: values[rays + lag] for name, values in self.fields.items()}
        return replace(made, fields=fields, alone=self.alone[rays + lag], wrong_on_edge={})

    def compared(self, name: str) -> Compared:
        """Return the summary of one array."""
        unit, scale = ("rays", 1.0) if name in WHOLE else ("microradian" if name == "direction" else "nm", 1e6)
        plain = ~self.edge
        far = self.far(name, self.fields[name], self.golden)[plain] * scale
        limit = self.limits[name][plain] * scale
        limits = (float(limit.min()), float(limit.max())) if len(limit) else (0.0, 0.0)
        wrong = int(self.wrong_by[name].sum())
        return Compared(name, FIELDS[name][0], len(plain), wrong, float(far.max(initial=0.0)), limits, unit)


def compare(foreign: Foreign, bounds: Bounds, panel_mm: Floats, aim_mm: Floats, every: bool = True) -> Comparison:
    """Compare arrays with golden's, within bounds.

    Panel points and aims displaced either way by some mm, (N, 2) each, tell how much more each ray may be off. Not
    `every`: these are traced only for rays beyond the bounds. The others are right whatever they tell, so the same
    rays are wrong.
    """
    given = foreign.given
    rays, n = golden(given), len(given.pixels)
    limits = dict.fromkeys(WHOLE, np.zeros(n)) | bounds.limits(given, rays)
    alone = np.zeros(n, bool) if foreign.alone is None else foreign.alone
    seen = Comparison(given, foreign.fields, rays, limits, np.zeros(n, bool), alone)
    chosen = np.arange(n) if every else np.flatnonzero(seen.wrong)
    if not len(chosen):
        return seen
    more, across = _roundings_do(seen.some(chosen), panel_mm[chosen], aim_mm[chosen])
    for name, extra in more.items():
        limits[name] = limits[name].copy()
        limits[name][chosen] += extra
    edge = seen.edge.copy()
    edge[chosen] = across
    seen = replace(seen, limits=limits, edge=edge)
    on_edge = np.flatnonzero(edge)
    wrong = {name: np.zeros(n, bool) for name in foreign.fields}
    for first in range(0, len(on_edge), AT_ONCE):
        some = on_edge[first : first + AT_ONCE]
        for name, found in _wrong_on_edge(seen.some(some), panel_mm[some], aim_mm[some]).items():
            wrong[name][some] = found
    return replace(seen, wrong_on_edge=wrong)


def _roundings_do(seen: Comparison, panel_mm: Floats, aim_mm: Floats) -> tuple[Arrays, Bools]:
    """Return how far displacements move each array's rays, and which rays change status or lenslet, (N,) each."""
    n = len(seen.edge)
    most = {name: np.zeros(n) for name in ("direction", "local_mm", "origin_mm")}
    edge = np.zeros(n, bool)
    for moved in _displaced(seen.given, panel_mm, aim_mm):
        other = golden(moved)
        across = np.any([(other[name] != seen.golden[name]).any(axis=1) for name in WHOLE], axis=0)
        edge |= across
        for name, far in most.items():
            moves = np.linalg.norm(other[name] - seen.golden[name], axis=1)
            far[:] = np.maximum(far, np.where(across, 0.0, moves))
    moves = np.maximum(panel_mm, aim_mm).max(axis=1)
    return {name: most.get(name, moves) for name in seen.limits if name not in WHOLE}, edge


def _displaced(given: Out, panel_mm: Floats, aim_mm: Floats, ways: Floats = AXES) -> Iterator[Out]:
    """Yield rays whose panel points, and then aims, are displaced by some (N, 2) mm, in some ways (M, 2)."""
    aimed = replace(given, aperture=given.aims)
    for step in ways:
        yield replace(aimed, pixels=given.pixels + step * panel_mm / given.display.panel.pitches_mm)
        yield replace(aimed, aperture=given.aims + step * aim_mm)


def _wrong_on_edge(seen: Comparison, panel_mm: Floats, aim_mm: Floats) -> dict[str, Bools]:
    """Return which of rays that are all on an edge are golden's on no side of it, (N,) by array.

    Golden's are those of inputs displaced by `SHARES` of the roundings. A ray must have status and lenslet of some of
    them, and values within their range, or beyond it by no more than its width and the limits.
    """
    sides = [seen.golden]
    for share in SHARES:
        sides += map(golden, _displaced(seen.given, share * panel_mm, share * aim_mm, AROUND))
    whole = {
        name: np.array(
            [(seen.fields[name] == side[name]).all(axis=1) | (seen.alone & (name != "status")) for side in sides]
        )
        for name in WHOLE
        if name in seen.fields
    }
    same: Bools = np.all(list(whole.values()), axis=0) if whole else np.ones((len(sides), len(seen.edge)), bool)
    found = {name: np.asarray(~one.any(axis=0)) for name, one in whole.items()}
    if whole:  # where each is golden's on some side, and not all on one, the last is wrong
        found[list(whole)[-1]] |= ~same.any(axis=0)
    for name in seen.fields.keys() - whole.keys() - {"panel_mm"}:
        values = np.array([side[name] for side in sides])
        low = np.where(same[..., None], values, np.inf).min(axis=0)
        high = np.where(same[..., None], values, -np.inf).max(axis=0)
        beyond = np.maximum(low - seen.fields[name], seen.fields[name] - high) - np.maximum(high - low, 0.0)
        far = np.where(np.isfinite(beyond), np.maximum(beyond, 0.0), np.inf)
        outside = np.linalg.norm(far, axis=1) > seen.limits[name]
        found[name] = np.asarray(same.any(axis=0) & outside & ~seen.alone)
    return found


def roundings(given: Out) -> tuple[Floats, Floats]:
    """Return how far roundings to float32 move panel points and aims, (N, 2) each, mm.

    One rounding of the given coordinate, and at least four roundings half a pitch from the lenslet's centre: those of
    the trace through the lenslet.
    """
    pitch, pixel = given.display.array.coarsest_mm, np.array(given.display.panel.pitches_mm)

    def rounding(values: Floats) -> Floats:
        return 0.5 * np.spacing(np.abs(values).astype(np.float32)).astype(np.float64)

    least = 4.0 * rounding(np.array(0.5 * pitch))
    return np.maximum(pixel * rounding(given.pixels), least), np.maximum(rounding(given.aims), least)


def distance(name: str, values: Floats, wanted: Floats) -> Floats:
    """Return how far values are from the wanted ones, (N,): a length, or 0 and 1 for integers; never NaN."""
    if name in WHOLE:
        return np.asarray((values != wanted).any(axis=1), np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        far = np.linalg.norm(values - wanted, axis=1)
    return np.where(np.isfinite(far), far, np.inf)

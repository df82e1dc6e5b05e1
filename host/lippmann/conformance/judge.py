"""Check tested rays: count wrong rays, and find the first wrong step and the fault behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lippmann.conformance.comparison import Comparison, FieldSummary, compare
from lippmann.conformance.coverage_points import covered, tied, tied_sides
from lippmann.conformance.error_bounds import Bounds
from lippmann.conformance.fault_search import MANY, PAIR, Finding, find_fault, find_two_faults
from lippmann.conformance.ray_sets import Bools, FixedCase, ForeignRays, unit_vectors
from lippmann.conformance.sequence_faults import find_delay, find_late_component, find_stale_register
from lippmann.conformance.tracer_faults import FIELDS, STAGES, TIE_RULE, golden
from lippmann.conformance.word_faults import REALS, WORD_STAGES, find_rounding, find_stuck_bit, find_word_fault
from lippmann.fixed.build import Build
from lippmann.fixed.conversion import word_unit
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.words import Ints
from lippmann.optics.rays import Floats

USUAL = Bounds()
#: Maximum difference of correct words from golden rays, in ulps of the words.
WORD_UNITS = 64.0


@dataclass(frozen=True)
class Verdict:
    """Verdict on tested rays: counts, index of the first wrong ray, and diagnosis (`Finding`).

    `on_edge` is the number of rays that exceed the bounds but lie on an edge. `covered`
    contains the number of rays at each coverage point.
    """

    rays: int
    on_edge: int
    wrong: int
    first_wrong: int | None
    stage: str | None
    fault: str | None
    explained: float
    compared: tuple[FieldSummary, ...]
    covered: dict[str, int]

    @property
    def right(self) -> bool:
        """Whether all rays are correct."""
        return not self.wrong

    @property
    def headline(self) -> str:
        """A one-line summary of the wrong rays."""
        count = f"{self.wrong} of {self.rays} rays wrong, the first is {self.first_wrong}"
        array = next((entry.field for entry in self.compared if entry.wrong and entry.stage == self.stage), None)
        step = f"stage: {self.stage}{f' ({array})' if array else ''}"
        return f"{count}; {step}; {self.fault or 'no single fault explains the rays'}"

    @property
    def searched(self) -> bool:
        """Whether a search for a pair of faults was necessary."""
        return self.wrong >= MANY and (self.fault is None or PAIR in self.fault)

    @property
    def lines(self) -> list[str]:
        """A text line per array, with error counts."""
        lines = []
        for entry in self.compared:
            least, largest = entry.limits
            allowed = f" (allowed: {least:.3g} to {largest:.3g})" if largest else ""
            lines.append(
                f"{entry.stage:<11}{entry.field:<10} {entry.wrong} of {entry.compared} wrong, "
                f"largest difference {entry.worst:.3g} {entry.unit}{allowed}"
            )
        return lines


@np.errstate(all="ignore")  # tested values may overflow
def judge(foreign: ForeignRays, bounds: Bounds = USUAL, two_faults: bool = True) -> Verdict:
    """Check rays under test, and diagnose wrong rays.

    Decimal numbers may differ from golden rays within `bounds`; fixed-point words must
    equal the twin's. `two_faults` allows a search for a pair of faults if no single
    fault explains the rays. This search takes about ten seconds.
    """
    if foreign.words is None:
        comparison = compare(foreign, bounds, every=False)
        rays, edge = comparison.golden, comparison.edge
        summaries = tuple(comparison.summary(name) for name in foreign.fields)
        wrong, finding = _judge_numbers(foreign, bounds, comparison, two_faults)
    else:
        rays, edge = golden(foreign.inputs), np.zeros(len(foreign.inputs.pixels), bool)
        wrong, finding, summaries = _judge_words(foreign, *foreign.words, two_faults)
    first = int(np.argmax(wrong)) if wrong.any() else None
    points = covered(foreign.inputs, rays)
    return Verdict(len(wrong), int(edge.sum()), int(wrong.sum()), first, *finding, summaries, points)


def _judge_numbers(
    foreign: ForeignRays, bounds: Bounds, compared: Comparison, two_faults: bool
) -> tuple[Bools, Finding]:
    if compared.wrong.any():
        return compared.wrong, _diagnose(compare(foreign, bounds), two_faults)
    if "lenslet" in foreign.fields:
        other = (foreign.fields["lenslet"] != compared.golden["lenslet"]).any(axis=1)
        sides = tied_sides(foreign.inputs)
        # A corner lies on two sides of a cell, so it cannot show which side has the wrong owner.
        alone = [side & (np.sum(sides, axis=0) == 1) for side in sides]
        turned = [side.sum() > 2 and other[side].all() for side in alone]
        if any(turned):
            edge = "an edge" if all(turned) else ("a left edge", "a lower edge")[turned.index(True)]
            wrong = other & np.any([side for side, swapped in zip(sides, turned, strict=True) if swapped], axis=0)
            return wrong, Finding("lenslet", f"{TIE_RULE}: every point on {edge} has the other owner", 1.0)
    return compared.wrong, Finding()


def _diagnose(compared: Comparison, two_faults: bool) -> Finding:
    bad = compared.wrong_arrays
    first = min((FIELDS[name][0] for name in bad), key=STAGES.index)
    codes = None
    # If a ray's status is wrong, its other values may have no meaning.
    if "status" in bad and not (compared.wrong & ~compared.wrong_by["status"]).any():
        codes = _wrong_codes(compared.fields["status"], compared.golden["status"], compared.wrong)
    if first == "status":
        return find_fault(compared) or codes or Finding(first)
    if _wrapped(compared):
        return Finding("exit", "a component of the direction wrapped where it should saturate at 1", 1.0)
    if first == "exit" and not compared.wrong_in("direction", unit_vectors(compared.fields["direction"])).any():
        return Finding("exit", "direction not normalised: it is right but for its length", 1.0)

    def right(lag: int) -> Bools:
        moved = compared.later(lag)
        return np.asarray(np.all([~moved.wrong_in(name, moved.fields[name]) for name in bad], axis=0))

    return (
        find_delay(right)
        or find_fault(compared)
        or find_late_component(compared)
        or find_stuck_bit(compared)
        or find_stale_register(compared)
        or codes
        or (find_two_faults(compared) if two_faults else None)
        or Finding(first)
    )


def _wrong_codes(status: Floats | Ints, expected: Floats | Ints, wrong: Bools) -> Finding:
    pairs, counts = np.unique(np.stack([expected[wrong, 0], status[wrong, 0]]), axis=1, return_counts=True)
    codes = ", ".join(f"{int(b)} for {int(a)} ({n} rays)" for (a, b), n in zip(pairs.T, counts, strict=True))
    return Finding("status", f"wrong status code: {codes}", 1.0)


def _wrapped(compared: Comparison) -> bool:
    wrong, right = compared.wrong_by["direction"], compared.golden["direction"]
    apart = (compared.fields["direction"] - right)[wrong]
    turns = np.round(apart / 2.0)
    residual = np.linalg.norm(apart - 2.0 * turns, axis=1)
    # An error of 2 may also be a wrong sign of a component of magnitude 1.
    return bool(
        wrong.any()
        and (np.abs(turns).sum(axis=1) == 1.0).all()
        and (residual < 1e-3).all()
        and not wrong[np.abs(right).max(axis=1) < 1.0 - 1e-3].any()
        and (~wrong).any()
    )


def _judge_words(
    foreign: ForeignRays, case: FixedCase, words: FixedRays, two_faults: bool
) -> tuple[Bools, Finding, tuple[FieldSummary, ...]]:
    twin = case.trace()
    far = {name: np.abs(a - b) for name, a, b in zip(FixedRays._fields, words, twin, strict=True)}
    wrong: Bools = np.any([apart != 0 for apart in far.values()], axis=0)
    summaries = []
    for name, apart in far.items():
        unit = "units of the last place" if name in REALS else "rays"
        count, worst = int(np.count_nonzero(apart)), float(apart.max(initial=0))
        summaries.append(FieldSummary(name, WORD_STAGES[name], len(wrong), count, worst, (0.0, 0.0), unit))
    finding = Finding()
    if wrong.any():
        first = min((entry.stage for entry in summaries if entry.wrong), key=STAGES.index)
        finding = _diagnose_words(foreign, case.build, words, twin, wrong, first, two_faults)
    return wrong, finding, tuple(summaries)


def _diagnose_words(
    foreign: ForeignRays, build: Build, words: FixedRays, twin: FixedRays, wrong: Bools, first: str, two_faults: bool
) -> Finding:
    if first == "status":
        return _wrong_codes(words.status[:, None], twin.status[:, None], wrong)
    lenslets: Bools = (words.i != twin.i) | (words.j != twin.j)
    rounding = None if lenslets.any() else find_rounding(words, twin, build)
    slip = Finding(first, rounding, 1.0) if rounding else find_word_fault(words, twin)
    if slip:
        return slip
    unit = WORD_UNITS * word_unit(build.fraction_bits)
    place = unit * foreign.inputs.display.array.radius_mm
    moved = np.full_like(foreign.inputs.pixels, place)
    wide = Bounds(direction_urad=1e6 * unit, point_nm=1e6 * place)
    compared = compare(foreign, wide, (moved, moved))
    ties = lenslets & (compared.edge | tied(foreign.inputs))
    if (ties == wrong).all():
        return Finding("lenslet", f"{TIE_RULE}: points on an edge have the other owner", 1.0)
    if not compared.wrong.any():
        return Finding(first, "words differ by less than golden can tell: rounding, or the tie rule")
    return _diagnose(compared, two_faults)

"""Judges foreign rays: how many are wrong, at which step of the ray, and which fault explains them.

Real numbers are compared with golden (`lippmann.conformance.comparison`), words with the twin, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.conformance.bounds import Bounds
from lippmann.conformance.comparison import WHOLE, Compared, Comparison, compare, distance, roundings
from lippmann.conformance.coverage_points import covered, tied_sides
from lippmann.conformance.engine_errors import FixedCase
from lippmann.conformance.error_maps import ErrorMaps
from lippmann.conformance.fault_pairs import pairs
from lippmann.conformance.foreign_rays import Foreign
from lippmann.conformance.lens_faults import FIELDS, PAIR, STAGES, TIE_RULE, Variant, fitted, golden, variants
from lippmann.conformance.ray_search import Bools, Floats
from lippmann.conformance.vectors import widths
from lippmann.errors import LippmannError
from lippmann.fixed.build import Build
from lippmann.fixed.conversion import rays_of_words, word_unit
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.words import Ints
from lippmann.optics.system import System

#: Rays that variants are tried on, and that numbers are fitted to.
SAMPLE, FIT_SAMPLE = 1500, 300
#: Wrong rays that pairs of faults are tried on first.
FEW = 90
#: Share of the rays that a variant must give for it to be the fault.
EXPLAINED = 0.97
#: The largest distance of a variant from the wrong arrays, as a share of golden's. In no array may a variant be farther
#: than golden by more than SAME (mm, radians, share of integers): the rounding of doubles and of a fit.
NEARER, SAME = 0.5, 1e-9
#: Units of the last place between golden and the words of a right design, for the widest aims.
WORD_UNITS = 64.0
#: The largest difference from the twin's words that another rounding explains.
ROUNDING_WORDS = 8
#: Delays of the outputs that are tried, in rays, and the fewest rays that show one, or two faults at once.
LAGS, MANY = (1, -1, 2, -2, 3, -3), 8
#: Sides of a cell of two owners, as `coverage.tied_sides`.
SIDES = ("left", "lower")


@dataclass(frozen=True)
class Verdict:
    """The judgement of foreign rays.

    `rays` in the file; `on_edge` are beyond the bounds, but change status or lenslet within a rounding, so that they
    may be golden's on either side;
    `wrong` are wrong in some array. `stage` is the first step that is wrong (None: all is right), `fault` the
    explanation (None: none was found), `explained` the share of the rays that it gives. `first_wrong` is the number of
    a ray. `covered` are the rays that meet each point of `coverage.POINTS`.
    """

    rays: int
    on_edge: int
    wrong: int
    first_wrong: int | None
    stage: str | None
    fault: str | None
    explained: float
    compared: tuple[Compared, ...]
    covered: dict[str, int] = field(default_factory=dict)

    @property
    def right(self) -> bool:
        """Whether no ray is wrong."""
        return not self.wrong

    @property
    def headline(self) -> str:
        """The verdict on wrong rays in a line."""
        told = f"{self.wrong} of {self.rays} rays wrong, the first is {self.first_wrong}"
        array = next((entry.field for entry in self.compared if entry.wrong and entry.stage == self.stage), None)
        step = f"stage: {self.stage}{f' ({array})' if array else ''}"
        return f"{told}; {step}; {self.fault or 'no single fault explains them'}"

    @property
    def searched(self) -> bool:
        """Whether a pair of faults was looked for, if that was allowed."""
        single = self.fault is not None and PAIR not in self.fault
        return self.wrong >= MANY and not single

    @property
    def lines(self) -> list[str]:
        """A line for each array that was compared."""
        lines = []
        for entry in self.compared:
            least, most = entry.limits
            allowed = f" (allowed: {least:.3g} to {most:.3g})" if most else ""
            lines.append(
                f"{entry.stage:<11}{entry.field:<10} {entry.wrong} of {entry.compared} wrong, "
                f"largest difference {entry.worst:.3g} {entry.unit}{allowed}"
            )
        return lines


#: Stage, fault and share of the rays that it explains.
_Finding = tuple[str | None, str | None, float]


def judge(
    foreign: Foreign,
    bounds: Bounds = Bounds(),  # noqa: B008 (frozen)
    two_faults: bool = True,
    maps: ErrorMaps | None = None,
) -> Verdict:
    """Judge foreign rays.

    `bounds` are how far directions and points may be off, beside the effect of rounding the inputs. Words must be
    equal. With `two_faults` a pair of faults is looked for when no single one explains the rays, which takes some ten
    seconds. The errors of the rays are added to `maps`.
    """
    if foreign.words is not None:
        verdict = _judge_words(foreign, *foreign.words, two_faults)
        if maps is not None:
            _map_words(maps, foreign, foreign.words[0])
        return replace(verdict, covered=covered(foreign.given, golden(foreign.given)))
    with np.errstate(all="ignore"):  # values of any size are compared
        seen = compare(foreign, bounds, *roundings(foreign.given), every=False)
        if maps is not None:
            _map_numbers(maps, seen)
        return replace(_judge_numbers(foreign, bounds, seen, two_faults), covered=covered(foreign.given, seen.golden))


def _judge_numbers(foreign: Foreign, bounds: Bounds, seen: Comparison, two_faults: bool) -> Verdict:
    compared = tuple(seen.compared(name) for name in foreign.fields)
    wrong = seen.wrong
    if wrong.any():
        every = compare(foreign, bounds, *roundings(foreign.given))
        return _verdict(seen.edge, wrong, _diagnosed(every, two_faults), compared)
    if "lenslet" in foreign.fields:
        other = (foreign.fields["lenslet"] != seen.golden["lenslet"]).any(axis=1)
        sides = tied_sides(foreign.given)
        # A corner is on two sides, and says nothing of one.
        alone = [side & (np.sum(sides, axis=0) == 1) for side in sides]
        turned = [side.sum() > 2 and other[side].all() for side in alone]
        if any(turned):
            which = "every point on an edge" if all(turned) else f"every point on a {SIDES[turned.index(True)]} edge"
            tied_wrong = other & np.any([side for side, wrong in zip(sides, turned, strict=True) if wrong], axis=0)
            return _verdict(
                seen.edge, tied_wrong, ("lenslet", f"{TIE_RULE}: {which} has the other owner", 1.0), compared
            )
    return _verdict(seen.edge, wrong, (None, None, 0.0), compared)


def _verdict(edge: Bools, wrong: Bools, finding: _Finding, compared: tuple[Compared, ...]) -> Verdict:
    first = int(np.argmax(wrong)) if wrong.any() else None
    return Verdict(len(wrong), int(edge.sum()), int(wrong.sum()), first, *finding, compared)


def _map_numbers(maps: ErrorMaps, seen: Comparison) -> None:
    """Add the errors of numbers; their last place is that of a float32 of the vector's largest component."""
    real = {name: values for name, values in seen.fields.items() if name not in WHOLE}
    apart = {name: seen.far(name, values, seen.golden) for name, values in real.items()}
    units = {name: np.spacing(np.abs(seen.golden[name]).max(axis=1).astype(np.float32)) for name in real}
    maps.add(seen.given, apart, units, ~seen.edge & ~seen.alone)


# --- diagnosis --------------------------------------------------------------------------------------------------


def _diagnosed(seen: Comparison, two_faults: bool) -> _Finding:
    """Return stage, fault and share explained of rays that are wrong."""
    bad = [name for name, wrong in seen.wrong_by.items() if wrong.any()]
    first = min((FIELDS[name][0] for name in bad), key=STAGES.index)
    if first == "status":
        return _best(seen) or (first, _codes(seen.fields["status"], seen.golden["status"], seen.wrong), 1.0)
    if _wrapped(seen):
        return "exit", "a component of the direction wrapped where it should saturate at 1", 1.0
    if first == "exit":
        length = np.linalg.norm(seen.fields["direction"], axis=1)
        unit = seen.fields["direction"] / np.where(length > 0.0, length, 1.0)[:, None]
        if not seen.wrong_in("direction", unit).any():
            return "exit", "direction not normalised: it is right but for its length", 1.0

    def equal(here: slice, there: slice) -> Bools:
        far = {name: distance(name, seen.fields[name][here], seen.golden[name][there]) for name in bad}
        far |= {name: np.where(seen.alone[here], 0.0, far[name]) for name in bad if name != "status"}
        return np.asarray(np.all([far[name] <= seen.limits[name][there] for name in bad], axis=0))

    late = _late(equal)
    if late:
        return "exit", late, 1.0
    return (
        _best(seen)
        or _one_late(seen)
        or _stuck(seen)
        or _stale(seen)
        or _only_status(seen)
        or (_two(seen) if two_faults else None)
        or (first, None, 0.0)
    )


def _axes(seen: Comparison) -> tuple[Floats, Floats]:
    """Return directions, foreign and golden's, along the array's axes."""
    frame = System.of(seen.given.display).frame
    return tuple(  # type: ignore[return-value]
        np.stack([*frame.turn_back(*rays["direction"][:, :2].T), rays["direction"][:, 2]], axis=1)
        for rays in (seen.fields, seen.golden)
    )


def _one_late(seen: Comparison) -> _Finding | None:
    """Say which component of the direction alone came too late, or too early."""
    if any(wrong.any() for name, wrong in seen.wrong_by.items() if name != "direction") or len(seen.edge) < 2 * MANY:
        return None
    got, wanted = _axes(seen)
    right = float((~seen.wrong).mean())
    for lag in LAGS:
        for axes, said in (((0,), "x"), ((1,), "y"), ((2,), "z"), ((0, 1), "x and y")):
            moved = wanted.copy()
            moved[:, axes] = np.roll(wanted, lag, axis=0)[:, axes]
            same = np.linalg.norm(got - moved, axis=1) <= seen.limits["direction"]
            if same.mean() >= EXPLAINED and same.mean() > right:
                when = f"{'late' if lag > 0 else 'early'} by {abs(lag)}"
                return "exit", f"direction's {said} {when}: ray k has that of ray k {-lag:+d}", float(same.mean())
    return None


def _stuck(seen: Comparison) -> _Finding | None:
    """Say which bit of the direction is stuck."""
    wrong = seen.wrong_by["direction"]
    if (
        any(one.any() for name, one in seen.wrong_by.items() if name != "direction")
        or wrong.all()
        or wrong.sum() < MANY
    ):
        return None
    got, wanted = _axes(seen)
    off = (got - wanted)[wrong]
    for axis, name in enumerate("xyz"):
        step = float(np.median(off[:, axis]))
        place = math.log2(abs(step)) if step and math.isfinite(step) else 0.5
        if not abs(place - round(place)) < 0.01:
            continue
        rest = off.copy()
        rest[:, axis] -= math.copysign(2.0 ** round(place), step)
        share = float((np.linalg.norm(rest, axis=1) <= seen.limits["direction"][wrong]).mean())
        if share >= EXPLAINED:
            return "exit", f"a bit of the direction's {name} is stuck at {int(step > 0)}: 2^{round(place)}", share
    return None


def _only_status(seen: Comparison) -> _Finding | None:
    """Explain rays that are wrong where their status is: the other values of a ray that should be lost say nothing."""
    if "status" not in seen.fields or (seen.wrong & ~seen.wrong_by["status"]).any():
        return None
    return "status", _codes(seen.fields["status"], seen.golden["status"], seen.wrong), 1.0


def _stale(seen: Comparison) -> _Finding | None:
    """Explain a stretch of wrong rays, with right ones before or after, by a register that took effect late."""
    run = np.flatnonzero(seen.wrong)
    first, last = int(run[0]), int(run[-1])
    if len(run) < MANY or last + 1 - first >= len(seen.edge) or len(run) < 0.5 * (last + 1 - first):
        return None
    found = _best(seen.some(np.arange(first, last + 1)))
    if found is None:
        return None
    stage, fault, share = found
    return stage, f"stale register: rays {first} to {last} are of an earlier configuration ({fault})", share


def _late(equal: Callable[[slice, slice], Bools]) -> str | None:
    """Say by how many rays outputs came too late, or too early.

    `equal(here, there)` tells which of the rays `here` have the values that the rays `there` should have. Where more
    have their own, as among rays that are nearly alike, none came late.
    """
    own = equal(slice(None), slice(None)).mean()
    for lag in LAGS:
        here, there = (slice(lag, None), slice(None, -lag)) if lag > 0 else (slice(None, lag), slice(-lag, None))
        same = equal(here, there)
        if len(same) >= MANY and same.mean() >= EXPLAINED and same.mean() > own:
            return f"outputs {'late' if lag > 0 else 'early'} by {abs(lag)}: ray k has the values of ray k {-lag:+d}"
    return None


def _codes(got: npt.NDArray[Any], wanted: npt.NDArray[Any], wrong: Bools) -> str:
    pairs, counts = np.unique(np.stack([wanted[wrong, 0], got[wrong, 0]]), axis=1, return_counts=True)
    said = ", ".join(f"{int(b)} for {int(a)} ({n} rays)" for (a, b), n in zip(pairs.T, counts, strict=True))
    return f"wrong status code: {said}"


def _wrapped(seen: Comparison) -> bool:
    """Tell whether every wrong direction is right but for one component that is off by 2."""
    wrong, right = seen.wrong_by["direction"], seen.golden["direction"]
    apart = (seen.fields["direction"] - right)[wrong]
    turns = np.round(apart / 2.0)
    rest = np.linalg.norm(apart - 2.0 * turns, axis=1)
    # A component of size 1 with the wrong sign is off by 2 as well: no wrap if rays far from 1 are wrong too.
    return bool(
        wrong.any()
        and (np.abs(turns).sum(axis=1) == 1.0).all()
        and (rest < 1e-3).all()
        and not wrong[np.abs(right).max(axis=1) < 1.0 - 1e-3].any()
        and (~wrong).any()
    )


def _best(seen: Comparison) -> _Finding | None:
    """Return stage, name and share of the variant that comes nearest to the rays, if it gives nearly all of them."""
    random = np.random.default_rng(0)
    # Of a ray on an edge a variant may give the other side.
    bad = np.flatnonzero(seen.wrong & ~seen.edge)
    bad = bad if len(bad) else np.flatnonzero(seen.wrong)
    if not len(bad):
        return None
    some = np.sort(random.permutation(bad)[:SAMPLE])
    good = random.permutation(np.flatnonzero(~seen.wrong & ~seen.edge))[: SAMPLE // 3]
    sample = seen.some(np.concatenate([some, good]))

    def best_of(found: Iterable[Variant]) -> _Finding | None:
        best, nearest = None, np.inf
        for variant in found:
            share, rest = _tried(variant, sample)
            if share >= EXPLAINED and (best is None or rest < nearest):
                best, nearest = (variant.stage, variant.name, share), rest
        return best

    found = best_of(variants(seen.given.display))
    if found is None:
        few = seen.some(random.permutation(bad)[:FIT_SAMPLE])
        found = best_of(fitted(few.given, few.fields))
    return found


def _two(seen: Comparison) -> _Finding | None:
    """Return stage, names and share of the first two faults that together give nearly all rays.

    None for a few wrong rays, in which two fitted numbers could be read whatever their cause.
    """
    for lag in (1, -1):
        found = _best(seen.later(lag))
        if found is not None:
            stage, fault, share = found
            return stage, f"{fault}{PAIR}outputs {'late' if lag > 0 else 'early'} by 1", share
    random = np.random.default_rng(0)
    bad, good = np.flatnonzero(seen.wrong & ~seen.edge), np.flatnonzero(~seen.wrong & ~seen.edge)
    if len(bad) < MANY:
        return None
    few = seen.some(np.sort(np.concatenate([random.permutation(bad)[:FEW], random.permutation(good)[: FEW // 3]])))
    fit = seen.some(random.permutation(bad)[:FIT_SAMPLE])
    for variant in pairs(fit.given, fit.fields, partial(_apart, few)):
        if _tried(variant, few)[0] >= EXPLAINED:
            share, _ = _tried(variant, seen)
            if share >= EXPLAINED:
                return variant.stage, variant.name, share
    return None


def _tried(variant: Variant, sample: Comparison) -> tuple[float, float]:
    """Return `_match` of a variant; of one that gives no display, none."""
    try:
        return _match(variant, sample)
    except (LippmannError, ValueError, ZeroDivisionError):
        return 0.0, np.inf


def _apart(sample: Comparison, variant: Variant) -> float:
    """Return how far a variant is from foreign rays, as the mean logarithm of its distances in units of golden's."""
    try:
        rays = variant.predict(sample.given, sample.golden)
    except (LippmannError, ValueError, ZeroDivisionError):
        return np.inf
    ratios = []
    for name, values in sample.fields.items():
        middle = np.mean if name in WHOLE else np.median
        far, own = middle(sample.far(name, values, rays)), middle(sample.far(name, values, sample.golden))
        if own > 0.0 and name not in variant.silent:
            ratios.append(math.log(max(float(far / own), 1e-6)) if math.isfinite(far / own) else 0.0)
    return float(np.mean(ratios)) if ratios else np.inf


def _match(variant: Variant, sample: Comparison) -> tuple[float, float]:
    """Return the share of rays that a variant gives, and its distance from the wrong ones in units of golden's.

    The share is that of the wrong rays or of all, whichever is less; 0 when golden is nearer in some array, or about
    as near in the wrong arrays. So a variant that equals golden in every array of the file explains nothing.
    """
    rays, bad = variant.predict(sample.given, sample.golden), sample.wrong
    right, ratios = np.ones(len(bad), bool), []
    for name, values in sample.fields.items():
        if name in variant.silent:
            continue
        far, own = sample.far(name, values, rays), sample.far(name, values, sample.golden)
        right &= far <= sample.limits[name]
        middle = np.mean if name in WHOLE else np.median
        wrong = sample.wrong_by[name]
        if wrong.any():
            ratios.append(float(middle(far[wrong])) / float(middle(own[wrong])))
        if middle(far[bad]) > middle(own[bad]) + SAME:
            return 0.0, np.inf
    if not ratios or not max(ratios) <= NEARER:
        return 0.0, np.inf
    return float(min(right.mean(), right[bad].mean())), max(ratios)


# --- words ------------------------------------------------------------------------------------------------------

#: Words that are real numbers.
REALS = ("x", "y", "z", "dx", "dy", "dz")
#: The steps that compute words.
WORD_STAGES = dict(zip(FixedRays._fields, ["lenslet"] * 2 + ["dome"] * 3 + ["exit"] * 3 + ["status"], strict=True))
#: Words that may be taken for each other.
SWAPS = ({"x": "y", "y": "x"}, {"dx": "dy", "dy": "dx"}, {"x": "y", "y": "x", "dx": "dy", "dy": "dx"})
#: Words that may have the wrong sign.
SIGNS = (*((name,) for name in REALS), ("x", "dx"), ("y", "dy"), ("x", "y", "dx", "dy"))


def _judge_words(foreign: Foreign, case: FixedCase, got: FixedRays, two_faults: bool) -> Verdict:
    twin = case.traced()
    far = {name: np.abs(a - b) for name, a, b in zip(FixedRays._fields, got, twin, strict=True)}
    wrong: Bools = np.any([apart != 0 for apart in far.values()], axis=0)
    compared = []
    for name, apart in far.items():
        unit = "units of the last place" if name in REALS else "rays"
        count, worst = int(np.count_nonzero(apart)), float(apart.max(initial=0))
        compared.append(Compared(name, WORD_STAGES[name], len(wrong), count, worst, (0.0, 0.0), unit))
    finding: _Finding = (None, None, 0.0)
    if wrong.any():
        first = min((entry.stage for entry in compared if entry.wrong), key=STAGES.index)
        finding = _diagnosed_words(foreign, case.build, got, twin, wrong, first, two_faults)
    return _verdict(np.zeros_like(wrong), wrong, finding, tuple(compared))


def _map_words(maps: ErrorMaps, foreign: Foreign, case: FixedCase) -> None:
    """Add the errors of words; a unit of the last place is a word's."""
    given, bits = foreign.given, case.build.fraction_bits
    twin = rays_of_words(given.display, given.pixels, case.traced(), bits)
    right = {"local_mm": twin.local_mm, "direction": twin.direction}
    apart = {name: distance(name, foreign.fields[name], values) for name, values in right.items()}
    every = np.ones(len(given.pixels), bool)
    unit = word_unit(bits) * every
    maps.add(given, apart, {"local_mm": given.display.array.radius_mm * unit, "direction": unit}, every)


def _diagnosed_words(
    foreign: Foreign, build: Build, got: FixedRays, twin: FixedRays, wrong: Bools, first: str, two_faults: bool
) -> _Finding:
    """Return stage, fault and share explained of words that differ from the twin's."""
    if first == "status":
        return first, _codes(got.status[:, None], twin.status[:, None], wrong), 1.0
    lenslets: Bools = (got.i != twin.i) | (got.j != twin.j)
    rounding = None if lenslets.any() else _rounding(got, twin, build)
    slip = (first, rounding) if rounding else _slip(got, twin)
    if slip:
        return *slip, 1.0
    unit = word_unit(build.fraction_bits)
    place = WORD_UNITS * unit * foreign.given.display.array.radius_mm
    moved = np.full_like(foreign.given.pixels, place)
    wide = Bounds(direction_urad=1e6 * WORD_UNITS * unit, point_nm=1e6 * place)
    seen = compare(foreign, wide, moved, moved)
    ties = lenslets & (seen.edge | seen.ties)
    if (ties == wrong).all():
        return "lenslet", f"{TIE_RULE}: points on an edge have the other owner", 1.0
    if not seen.wrong.any():
        return first, "words differ by less than golden can tell: rounding, or the tie rule", 0.0
    return _diagnosed(seen, two_faults)


def _slip(got: FixedRays, twin: FixedRays) -> tuple[str, str] | None:
    """Return stage and name of a fault that turns the twin's words into these, to the bit: a delay, a sign, a swap."""

    def equal(here: slice, there: slice, words: FixedRays = twin) -> Bools:
        return np.asarray(np.all([a[here] == b[there] for a, b in zip(got, words, strict=True)], axis=0))

    def gives(**changed: Ints) -> bool:
        same = equal(slice(None), slice(None), twin._replace(**changed))
        return len(same) >= MANY and bool(same.mean() >= EXPLAINED)

    late = _late(equal)
    if late:
        return "exit", late
    for names in SIGNS:
        if gives(**{name: -getattr(twin, name) for name in names}):
            return WORD_STAGES[names[0]], f"sign of the words {', '.join(names)}"
    for swap in SWAPS:
        if gives(**{name: getattr(twin, other) for name, other in swap.items()}):
            return WORD_STAGES[next(iter(swap))], f"words swapped: {', '.join(swap)}"
    for name, word, wanted in zip(FixedRays._fields, got, twin, strict=True):
        added = int(np.median(word - wanted))
        if added and name != "status" and gives(**{name: wanted + added}):
            return WORD_STAGES[name], f"a constant added to the word {name}: {added:+d}"
    return None


def _rounding(got: FixedRays, twin: FixedRays, build: Build) -> str | None:
    """Name another rounding or overflow that explains the words; None when they differ by more."""
    wanted = np.stack([getattr(twin, name) for name in REALS])
    apart = np.stack([getattr(got, name) for name in REALS]) - wanted

    def named(rows: npt.NDArray[np.bool_]) -> str:
        return ", ".join(name for name, row in zip(REALS, rows, strict=True) if row.any())

    span = np.array([1 << bits for bits in widths(REALS, build.fraction_bits)])[:, None]
    wraps = np.abs(np.abs(apart) - span) <= ROUNDING_WORDS
    if wraps.any() and (np.abs(np.where(wraps, 0, apart)) <= ROUNDING_WORDS).all():
        return f"a word wrapped where it should saturate: {named(wraps)}"
    if (np.abs(apart) > ROUNDING_WORDS).any():
        return None
    off = apart != 0
    if float(apart[off].mean()) < -0.9:
        return f"truncation for rounding (downward): {named(off)}"
    if float((apart * -np.sign(wanted))[off].mean()) > 0.9:
        return f"truncation for rounding (towards zero): {named(off)}"
    return f"another rounding, at most {int(np.abs(apart).max())} units of the last place: {named(off)}"

"""Judges foreign rays: how many are wrong, at which step of the ray, and by which fault.

Reals are held to golden. A ray may be off by the tolerance, and by what a rounding of its inputs to float32 makes of
it, so that no rounding is taken for a fault however badly a ray is conditioned. Words are held to the twin, every bit.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.conditioning.search import Floats
from lippmann.conditioning.vectors import widths
from lippmann.diagnose.faults import STAGE_OF, STAGES, Arrays, Given, Variant, fitted, golden, variants
from lippmann.diagnose.foreign import Foreign, Words
from lippmann.display import Display
from lippmann.fixed.build import Build
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.optics.rays import Model

Bools = npt.NDArray[np.bool_]

#: Rays that a diagnosis looks at, and that a fit does.
SAMPLE, FIT_SAMPLE = 1500, 300
#: Share of the rays that a variant must give for it to be the fault.
EXPLAINED = 0.97
#: How much nearer than golden it must be in the arrays that are wrong. In no array may it be farther, but for SAME (mm,
#: radians, share of whole numbers), which is what the rounding of doubles and of a fit leaves.
NEARER, SAME = 0.5, 1e-9
#: Units of the last place that words of a real design may be off golden, for the variants: those of the widest aims.
WORD_UNITS = 64.0
#: A design whose words are at most so far from the twin's rounds otherwise; it does not trace otherwise.
ROUNDING_WORDS = 8
#: By how many rays outputs may be late, and the fewest rays that show it.
LAGS, MANY = (1, -1, 2, -2, 3, -3), 8
#: Fields that are whole numbers.
WHOLE = ("home", "lenslet", "status")


@dataclass(frozen=True)
class Compared:
    """One array of the file: the step that makes it, rays compared and wrong, the largest difference and its unit.

    `limits` are the least and the largest difference that a ray was allowed.
    """

    field: str
    stage: str
    compared: int
    wrong: int
    worst: float
    limits: tuple[float, float]
    unit: str


@dataclass(frozen=True)
class Verdict:
    """What is said of foreign rays.

    `rays` in the file; `on_edge` not judged in full, for their fate turns within a rounding; `wrong` are wrong in
    some array. `stage` is the first step that is wrong (None: all is right), `fault` what explains the rays (None:
    nothing does), `explained` the share of them that it gives. `first_wrong` is the number of a ray.
    """

    rays: int
    on_edge: int
    wrong: int
    first_wrong: int | None
    stage: str | None
    fault: str | None
    explained: float
    compared: tuple[Compared, ...]

    @property
    def right(self) -> bool:
        """Whether no ray is wrong."""
        return not self.wrong


@dataclass(frozen=True)
class _Allowed:
    """What golden gives, and how far from it a ray may be: arrays by name; `edge` (N,) fates that turn within it."""

    rays: Arrays
    by_field: dict[str, Floats]
    edge: Bools


def judge(
    foreign: Foreign, display: Display, model: Model, tolerance_urad: float = 2.0, tolerance_nm: float = 50.0
) -> Verdict:
    """Judge foreign rays.

    Parameters
    ----------
    foreign
        The rays.
    display, model
        What they are to be of.
    tolerance_urad, tolerance_nm
        How far directions and points may be off, beside what a rounding of the inputs does. Of words, no bit may be.
    """
    given = Given(display, foreign.pixels, foreign.aperture, model)
    if foreign.words is not None:
        return _judge_words(foreign, foreign.words, given)
    allowed = _allowed(given, tolerance_urad * 1e-6, tolerance_nm * 1e-6, *_roundings(given))
    wrong_by = {name: _wrong(name, values, allowed) for name, values in foreign.fields.items()}
    wrong: Bools = np.any(list(wrong_by.values()), axis=0)
    ties = _ties(given)
    tied_wrong = (
        ties & (foreign.fields["lenslet"] != allowed.rays["lenslet"]).any(axis=1)
        if ("lenslet" in foreign.fields)
        else np.zeros_like(ties)
    )
    compared = tuple(_compared(name, values, allowed, wrong_by[name]) for name, values in foreign.fields.items())
    if not wrong.any() and tied_wrong.sum() > 2 and tied_wrong.sum() == ties.sum():
        fault = "cells closed on their other side (tie rule): every point on an edge has the other owner"
        return _verdict(allowed.edge, tied_wrong, "lenslet", fault, 1.0, compared)
    if not wrong.any():
        return _verdict(allowed.edge, wrong, None, None, 0.0, compared)
    return _verdict(allowed.edge, wrong, *_diagnosed(foreign.fields, given, allowed, wrong_by, wrong), compared)


def _verdict(
    edge: Bools, wrong: Bools, stage: str | None, fault: str | None, explained: float, compared: tuple[Compared, ...]
) -> Verdict:
    first = int(np.argmax(wrong)) if wrong.any() else None
    return Verdict(len(wrong), int(edge.sum()), int(wrong.sum()), first, stage, fault, explained, compared)


def _roundings(given: Given) -> tuple[Floats, Floats]:
    """Return how far roundings to float32 move panel points and aims, (N, 2) each, mm.

    One rounding of a coordinate as it is given, but at least four of one half a pitch from the lenslet's centre: those
    are what the way through a lenslet adds.
    """
    pitch, pixel = given.display.array.pitch_mm, given.display.panel.pixel_pitch_mm

    def rounding(values: Floats) -> Floats:
        return 0.5 * np.spacing(np.abs(values).astype(np.float32)).astype(np.float64)

    least = 4.0 * rounding(np.array(0.5 * pitch))
    return np.maximum(pixel * rounding(given.pixels), least), np.maximum(rounding(given.aims), least)


def _allowed(given: Given, turn: float, shift_mm: float, panel_mm: Floats, aim_mm: Floats) -> _Allowed:
    """Trace golden, and once more with panel points and aims displaced either way by some mm, (N, 2) each."""
    rays = golden(given)
    n = len(given.pixels)
    most = {name: np.zeros(n) for name in ("direction", "local_mm", "origin_mm")}
    edge = np.zeros(n, bool)
    for step in np.concatenate([np.eye(2), -np.eye(2)]):
        for moved in (
            Given(
                given.display,
                given.pixels + step * panel_mm / given.display.panel.pixel_pitch_mm,
                given.aims,
                given.model,
            ),
            Given(given.display, given.pixels, given.aims + step * aim_mm, given.model),
        ):
            other = golden(moved)
            edge |= np.any([(other[name] != rays[name]).any(axis=1) for name in WHOLE], axis=0)
            for name, far in most.items():
                np.maximum(far, np.linalg.norm(other[name] - rays[name], axis=1), out=far)
    place = shift_mm + np.maximum(panel_mm, aim_mm).max(axis=1)
    fixed = dict.fromkeys(("panel_mm", "start_mm", "near_mm", "centre_mm"), place)
    by_field = {**fixed, **{name: (turn if name == "direction" else shift_mm) + far for name, far in most.items()}}
    return _Allowed(rays, by_field, edge)


def _far(name: str, values: Floats, wanted: Floats) -> Floats:
    """Return how far values are from what is wanted, (N,): a length, or 0 and 1 for whole numbers; never NaN."""
    if name in WHOLE:
        return np.asarray((values != wanted).any(axis=1), np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        far = np.linalg.norm(values - wanted, axis=1)
    return np.where(np.isfinite(far), far, np.inf)


def _wrong(name: str, values: Floats, allowed: _Allowed) -> Bools:
    """Tell which rays of an array are wrong; those on an edge never are, but where they are not numbers."""
    far = _far(name, values, allowed.rays[name])
    limit = allowed.by_field.get(name, np.zeros(len(far)))
    return np.asarray((far > limit) & ~(allowed.edge & np.isfinite(far) & (name not in ("panel_mm",))))


def _compared(name: str, values: Floats, allowed: _Allowed, wrong: Bools) -> Compared:
    unit, scale = {"direction": ("microradian", 1e6)}.get(name, ("nm", 1e6))
    if name in WHOLE:
        unit, scale = "rays", 1.0
    far = _far(name, values, allowed.rays[name])
    worst = float(far[~allowed.edge].max(initial=0.0)) * scale
    limit = allowed.by_field.get(name, np.zeros(len(far)))[~allowed.edge] * scale
    limits = (float(limit.min()), float(limit.max())) if len(limit) else (0.0, 0.0)
    return Compared(name, STAGE_OF[name], len(wrong), int(wrong.sum()), worst, limits, unit)


def _ties(given: Given) -> Bools:
    """Tell which panel points are exactly on an edge of their cell that only one of two neighbours owns."""
    start = golden(given)["start_mm"]
    half = 0.5 * given.display.array.pitch_mm
    columns = start if given.display.array.grid == "square" else start[:, :1]
    return np.asarray((columns == -half).any(axis=1))


def _diagnosed(
    fields: Arrays, given: Given, allowed: _Allowed, wrong_by: dict[str, Bools], wrong: Bools
) -> tuple[str, str | None, float]:
    """Return stage, fault and share explained of rays that are wrong."""
    first = min((STAGE_OF[name] for name, bad in wrong_by.items() if bad.any()), key=STAGES.index)
    if first == "status":
        return first, _codes(fields["status"], allowed.rays["status"], wrong), 1.0
    wraps = _wrapped(fields["direction"], allowed, wrong_by["direction"])
    if wraps:
        return "exit", "a component of the direction wrapped where it should saturate at 1", 1.0
    if first == "exit":
        bent = fields["direction"]
        length = np.linalg.norm(bent, axis=1)
        unit = bent / np.where(length > 0.0, length, 1.0)[:, None]
        if not _wrong("direction", unit, allowed).any():
            return "exit", "direction not normalised: it is right but for its length", 1.0
    late = _late(fields, allowed, wrong_by)
    if late:
        return "exit", late, 1.0
    everywhere = _best(fields, given, allowed, np.arange(len(wrong)), wrong_by, wrong)
    return everywhere or _stale(fields, given, allowed, wrong_by, wrong) or (first, None, 0.0)


def _stale(
    fields: Arrays, given: Given, allowed: _Allowed, wrong_by: dict[str, Bools], wrong: Bools
) -> tuple[str, str, float] | None:
    """Explain a stretch of wrong rays, with right ones before or after: what was written there took effect late."""
    run = np.flatnonzero(wrong)
    first, last = int(run[0]), int(run[-1])
    if last + 1 - first >= len(wrong) or len(run) < 0.5 * (last + 1 - first):
        return None
    part = _best(fields, given, allowed, np.arange(first, last + 1), wrong_by, wrong)
    if part is None:
        return None
    return part[0], f"stale register: rays {first} to {last} are of an earlier configuration ({part[1]})", part[2]


def _late(fields: Arrays, allowed: _Allowed, wrong_by: dict[str, Bools]) -> str | None:
    """Say by how many rays the arrays that are wrong came too late, or too early."""
    for lag in LAGS:
        here, there = _shifted(lag)
        right = [
            _far(name, fields[name][here], allowed.rays[name][there])
            <= allowed.by_field.get(name, np.zeros(len(bad)))[there]
            for name, bad in wrong_by.items()
            if bad.any()
        ]
        if len(right[0]) >= MANY and np.all(right, axis=0).mean() >= EXPLAINED:
            return _lateness(lag)
    return None


def _shifted(lag: int) -> tuple[slice, slice]:
    """Return which rays came, and which should have come, when all are `lag` late."""
    return (slice(lag, None), slice(None, -lag)) if lag > 0 else (slice(None, lag), slice(-lag, None))


def _lateness(lag: int) -> str:
    return f"outputs {'late' if lag > 0 else 'early'} by {abs(lag)}: ray k has what is ray k {-lag:+d}'s"


def _codes(got: npt.NDArray[Any], wanted: npt.NDArray[Any], wrong: Bools) -> str:
    pairs, counts = np.unique(np.stack([wanted[wrong, 0], got[wrong, 0]]), axis=1, return_counts=True)
    said = ", ".join(f"{int(b)} for {int(a)} ({n} rays)" for (a, b), n in zip(pairs.T, counts, strict=True))
    return f"wrong status code: {said}"


def _wrapped(direction: Floats, allowed: _Allowed, wrong: Bools) -> bool:
    """Tell whether every wrong direction is right but for a component that is 2 off."""
    apart = (direction - allowed.rays["direction"])[wrong]
    turns = np.round(apart / 2.0)
    rest = np.linalg.norm(apart - 2.0 * turns, axis=1)
    # A component of size 1 whose sign is wrong is 2 off as well: that is no wrap where others are not as near to 1.
    return bool(
        wrong.any()
        and (np.abs(turns).sum(axis=1) == 1.0).all()
        and (rest < 1e-3).all()
        and not wrong[np.abs(allowed.rays["direction"]).max(axis=1) < 1.0 - 1e-3].any()
        and (~wrong).any()
    )


def _best(
    fields: Arrays,
    given: Given,
    allowed: _Allowed,
    index: npt.NDArray[np.intp],
    wrong_by: dict[str, Bools],
    wrong: Bools,
) -> tuple[str, str, float] | None:
    """Return stage, name and share of the variant that comes nearest to some rays, if it gives nearly all."""
    random = np.random.default_rng(0)
    bad = index[wrong[index]]
    some = np.sort(random.permutation(bad)[:SAMPLE])
    good = random.permutation(index[~wrong[index] & ~allowed.edge[index]])[: SAMPLE // 3]
    chosen = np.concatenate([some, good])
    part = given.some(chosen)
    sampled = _Sampled(
        {name: array[chosen] for name, array in fields.items()},
        {name: array[chosen] for name, array in allowed.rays.items()},
        {name: limit[chosen] for name, limit in allowed.by_field.items()},
        {name: array[some] for name, array in wrong_by.items()},
    )

    def best_of(found: Iterable[Variant]) -> tuple[float, float, Variant] | None:
        best = None
        for variant in found:
            share, rest = _match(variant, variant.predict(part), sampled)
            if share >= EXPLAINED and (best is None or rest < best[1]):
                best = share, rest, variant
        return best

    found = best_of(variants(given.display))
    if found is None:
        few = random.permutation(bad)[:FIT_SAMPLE]
        found = best_of(fitted(given.some(few), {name: array[few] for name, array in fields.items()}))
    return None if found is None else (found[2].stage, found[2].name, found[0])


@dataclass(frozen=True)
class _Sampled:
    """Rays that variants are tried on, the wrong ones first: arrays of the file, of golden, and their limits, (N, ...).

    `wrong` tells for each array which of the wrong rays are wrong in it, (M,).
    """

    values: Arrays
    golden: Arrays
    limits: dict[str, Floats]
    wrong: dict[str, Bools]


def _match(variant: Variant, rays: Arrays, sampled: _Sampled) -> tuple[float, float]:
    """Return the share of rays that a variant gives, and how far it stays from the wrong ones, in golden's distance.

    The share is that of the wrong rays or of all, whichever is less; 0 when golden is nearer in some array, or about
    as near in those that are wrong. So a variant that differs from golden in nothing that the file has explains
    nothing.
    """
    right, ratios = np.ones(len(next(iter(sampled.values.values()))), bool), []
    bad = len(next(iter(sampled.wrong.values())))
    for name, array in sampled.values.items():
        if name in variant.silent:
            continue
        far, own = _far(name, array, rays[name]), _far(name, array, sampled.golden[name])
        right &= far <= sampled.limits.get(name, np.zeros(len(far)))
        middle = np.mean if name in WHOLE else np.median
        wrong = sampled.wrong[name]
        if wrong.any():
            ratios.append(float(middle(far[:bad][wrong])) / float(middle(own[:bad][wrong])))
        if middle(far[:bad]) > middle(own[:bad]) + SAME:
            return 0.0, np.inf
    if not ratios or not max(ratios) <= NEARER:
        return 0.0, np.inf
    return float(min(right.mean(), right[:bad].mean())), max(ratios)


# --- words ------------------------------------------------------------------------------------------------------


def _judge_words(foreign: Foreign, words: Words, given: Given) -> Verdict:
    twin = ray_pipeline(*words.inputs, words.registers, words.build)
    wrong_by = {name: a != b for name, a, b in zip(FixedRays._fields, words.outputs, twin, strict=True)}
    wrong: Bools = np.any(list(wrong_by.values()), axis=0)
    compared = tuple(
        Compared(
            name,
            WORD_STAGES.get(name, "exit"),
            len(wrong),
            int(wrong_by[name].sum()),
            float(np.abs(got - wanted).max(initial=0)),
            (0.0, 0.0),
            "units of the last place" if name not in ("i", "j", "status") else "rays",
        )
        for name, got, wanted in zip(FixedRays._fields, words.outputs, twin, strict=True)
    )
    unit = 2.0 ** -(words.build.fraction_bits + 1)
    place = WORD_UNITS * unit * given.display.array.radius_mm
    moved = np.full_like(given.pixels, place)
    allowed = _allowed(given, WORD_UNITS * unit, place, moved, moved)
    if not wrong.any():
        return _verdict(np.zeros_like(wrong), wrong, None, None, 0.0, compared)
    first = min((entry.stage for entry in compared if entry.wrong), key=STAGES.index)
    lenslets = wrong_by["i"] | wrong_by["j"]
    reals = [name for name in FixedRays._fields if name not in ("i", "j", "status")]
    apart = np.stack([getattr(words.outputs, name) - getattr(twin, name) for name in reals])
    if first == "status":
        fault = _codes(words.outputs.status[:, None], twin.status[:, None], wrong)
        return _verdict(np.zeros_like(wrong), wrong, first, fault, 1.0, compared)
    said = None if lenslets.any() else _rounding(apart, twin, reals, words.build)
    slip = (first, said) if said else _slip(words.outputs, twin)
    if slip:
        return _verdict(np.zeros_like(wrong), wrong, *slip, 1.0, compared)
    ties = lenslets & (allowed.edge | _ties(given))
    if (ties == wrong).all():
        fault = "cells closed on their other side (tie rule): points on an edge have the other owner"
        return _verdict(np.zeros_like(wrong), wrong, "lenslet", fault, 1.0, compared)
    fields = {name: values for name, values in foreign.fields.items() if name != "origin_mm"}
    real_wrong = {name: _wrong(name, values, allowed) for name, values in fields.items()}
    any_wrong: Bools = np.any(list(real_wrong.values()), axis=0)
    if not any_wrong.any():
        fault = "words differ by less than golden tells apart: rounding, or the tie rule"
        return _verdict(np.zeros_like(wrong), wrong, first, fault, 0.0, compared)
    stage, name, share = _diagnosed(fields, given, allowed, real_wrong, any_wrong)
    return _verdict(np.zeros_like(wrong), wrong, stage, name, share, compared)


#: Steps that words are made at; the others at the exit.
WORD_STAGES = {**dict.fromkeys("ij", "lenslet"), **dict.fromkeys("xyz", "dome"), "status": "status"}
#: Words that may be taken for each other.
SWAPS = ({"x": "y", "y": "x"}, {"dx": "dy", "dy": "dx"}, {"x": "y", "y": "x", "dx": "dy", "dy": "dx"})
#: Words whose signs may be turned.
SIGNS = (*((name,) for name in ("x", "y", "z", "dx", "dy", "dz")), ("x", "dx"), ("y", "dy"), ("x", "y", "dx", "dy"))


def _slip(got: FixedRays, twin: FixedRays) -> tuple[str, str] | None:
    """Return the stage and name of a fault that makes the words of the twin's, to the bit: a sign, a swap, a delay."""

    def gives(words: FixedRays, here: slice = slice(None), there: slice = slice(None)) -> bool:
        same = np.all([a[here] == b[there] for a, b in zip(got, words, strict=True)], axis=0)
        return len(same) >= MANY and bool(same.mean() >= EXPLAINED)

    for lag in LAGS:
        if gives(twin, *_shifted(lag)):
            return "exit", _lateness(lag)
    for names in SIGNS:
        if gives(twin._replace(**{name: -getattr(twin, name) for name in names})):
            return WORD_STAGES.get(names[0], "exit"), f"sign of the words {', '.join(names)}"
    for swap in SWAPS:
        if gives(twin._replace(**{name: getattr(twin, other) for name, other in swap.items()})):
            return WORD_STAGES.get(next(iter(swap)), "exit"), f"words swapped: {', '.join(swap)}"
    for name, word, wanted in zip(FixedRays._fields, got, twin, strict=True):
        added = int(np.median(word - wanted))
        if added and name != "status" and gives(twin._replace(**{name: wanted + added})):
            return WORD_STAGES.get(name, "exit"), f"a constant added to the word {name}: {added:+d}"
    return None


def _rounding(apart: npt.NDArray[np.int64], twin: FixedRays, names: list[str], build: Build) -> str | None:
    """Say what rounds or overflows otherwise, from differences (6, N) of words; None when it is more than that."""
    span = np.array([1 << bits for bits in widths(names, build.fraction_bits)])[:, None]
    wraps = np.abs(np.abs(apart) - span) <= ROUNDING_WORDS
    if wraps.any() and (np.abs(np.where(wraps, 0, apart)) <= ROUNDING_WORDS).all():
        found = ", ".join(name for name, row in zip(names, wraps, strict=True) if row.any())
        return f"a word wrapped where it should saturate: {found}"
    if (np.abs(apart) > ROUNDING_WORDS).any():
        return None
    sign = np.stack([np.sign(getattr(twin, name)) for name in names])
    off = apart != 0
    mean, inward = float(apart[off].mean()), float((apart * -sign)[off].mean())
    found = ", ".join(name for name, row in zip(names, off, strict=True) if row.any())
    if mean < -0.9:
        return f"truncation for rounding (downward): {found}"
    if inward > 0.9:
        return f"truncation for rounding (towards zero): {found}"
    return f"rounded otherwise, at most {int(np.abs(apart).max())} units of the last place: {found}"

"""Search for the fault behind wrong rays: known faults, fitted display parameters, pairs of faults."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache, partial
from itertools import combinations
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from lippmann.conformance.comparison import INTEGERS, Comparison, delay_text
from lippmann.conformance.ray_sets import PanelRays, unit_vectors
from lippmann.conformance.tracer_faults import (
    FIELDS,
    GLASS,
    NO_RAYS,
    STAGES,
    Arrays,
    Variant,
    add_constant,
    change_direction,
    golden,
    variants,
    with_number,
)
from lippmann.display.description import Display
from lippmann.optics.rays import Floats

#: Maximum wrong rays in trials of known faults, and in fits.
SAMPLE, FIT_SAMPLE = 1500, 300
#: Maximum wrong rays in the first trial of a pair of faults.
FEW = 90
#: Distance of tested rays from a fault's rays against that from golden rays: maximum
#: ratio in a wrong array, maximum excess in any array.
NEARER, SAME = 0.5, 1e-9
#: Minimum fraction of rays that a fault must match, and minimum number of rays, for a diagnosis.
EXPLAINED, MANY = 0.97, 8
#: Separator between the names of two faults.
PAIR = "; and "
#: Fitted display parameters, with the trace step that uses each parameter.
FITTED = {
    "array.index": "first face",
    "gap_mm": "first face",
    "array.thickness_mm": "first face",
    "array.radius_mm": "dome",
    "array.rotation_deg": "panel",
    "array.pitch_mm": "lenslet",
    "array.pitch_mm[0]": "lenslet",
    "array.pitch_mm[1]": "lenslet",
    "array.shear": "lenslet",
    "panel.pixel_pitch_mm": "panel",
    "panel.pixel_pitch_mm[0]": "panel",
    "panel.pixel_pitch_mm[1]": "panel",
    "array.offset_mm[0]": "panel",
    "array.offset_mm[1]": "panel",
}

#: Relative changes that a fit tries; relative to the pitch for offsets and zero values.
LOOKED = (-0.5, -0.3, -0.2, -0.1, -0.05, -0.02, -0.01, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)


class Finding(NamedTuple):
    """The diagnosis: first wrong step (None if all is correct), fault, fraction of rays that it explains."""

    stage: str | None = None
    fault: str | None = None
    explained: float = 0.0


def find_fault(compared: Comparison) -> Finding | None:
    """Find the known fault, or fitted parameter, that predicts the wrong rays best."""
    random = np.random.default_rng(0)
    # Omit rays on an edge: a fault may move them to the other side.
    bad = np.flatnonzero(compared.wrong & ~compared.edge)
    bad = bad if len(bad) else np.flatnonzero(compared.wrong)
    if not len(bad):
        return None
    some = np.sort(random.permutation(bad)[:SAMPLE])
    good = random.permutation(np.flatnonzero(~compared.wrong & ~compared.edge))[: SAMPLE // 3]
    sample = compared.select(np.concatenate([some, good]))

    def nearest(faults: Iterable[Variant]) -> Finding | None:
        best, least = None, np.inf
        for variant in faults:
            share, far = _match(variant, sample)
            if share >= EXPLAINED and (best is None or far < least):
                best, least = Finding(variant.stage, variant.name, share), far
        return best

    if best := nearest(variants(compared.inputs.display)):
        return best
    small_sample = compared.select(random.permutation(bad)[:FIT_SAMPLE])
    return nearest(fitted(small_sample.inputs, small_sample.fields))


def find_two_faults(compared: Comparison) -> Finding | None:
    """Find a pair of faults that explains the wrong rays."""
    for lag in (1, -1):
        if best := find_fault(compared.later(lag)):
            return best._replace(fault=f"{best.fault}{PAIR}outputs {delay_text(lag)}")
    random = np.random.default_rng(0)
    bad = np.flatnonzero(compared.wrong & ~compared.edge)
    good = np.flatnonzero(~compared.wrong & ~compared.edge)
    if len(bad) < MANY:  # two fitted parameters explain any small set of rays
        return None
    some = np.concatenate([random.permutation(bad)[:FEW], random.permutation(good)[: FEW // 3]])
    small_sample = compared.select(np.sort(some))
    fit = compared.select(random.permutation(bad)[:FIT_SAMPLE])
    for variant in pairs(fit.inputs, fit.fields, partial(_apart, small_sample)):
        if _match(variant, small_sample)[0] >= EXPLAINED:
            share, _ = _match(variant, compared)
            if share >= EXPLAINED:
                return Finding(variant.stage, variant.name, share)
    return None


def _distances(variant: Variant, sample: Comparison) -> list[tuple[str, Floats, Floats]]:
    try:
        rays = variant.predict(sample.inputs, sample.golden)
    except NO_RAYS:
        return []
    predicted = [(name, values) for name, values in sample.fields.items() if name not in variant.silent]
    return [(name, sample.far(name, some, rays), sample.far(name, some, sample.golden)) for name, some in predicted]


def _middle(name: str, distances: Floats) -> float:
    return float(distances.mean() if name in INTEGERS else np.median(distances))


def _apart(sample: Comparison, variant: Variant) -> float:
    middles = [(_middle(name, far), _middle(name, own)) for name, far, own in _distances(variant, sample)]
    ratios = [far / own for far, own in middles if own > 0.0]
    logarithms = [math.log(max(ratio, 1e-6)) if math.isfinite(ratio) else 0.0 for ratio in ratios]
    return float(np.mean(logarithms)) if logarithms else np.inf


def _match(variant: Variant, sample: Comparison) -> tuple[float, float]:
    bad, ratios = sample.wrong, []
    right = np.ones(len(bad), bool)
    for name, far, own in _distances(variant, sample):
        right &= far <= sample.limits[name]
        wrong = sample.wrong_by[name]
        if wrong.any():
            golden_far = _middle(name, own[wrong])
            if not golden_far:  # golden rays match, perhaps on an edge
                return 0.0, np.inf
            ratios.append(_middle(name, far[wrong]) / golden_far)
        if _middle(name, far[bad]) > _middle(name, own[bad]) + SAME:
            return 0.0, np.inf
    if not ratios or not max(ratios) <= NEARER:
        return 0.0, np.inf
    return float(min(right.mean(), right[bad].mean())), max(ratios)


def fitted(inputs: PanelRays, values: Arrays) -> Iterator[Variant]:
    """Yield faults with a constant, word length or parameter fitted to the tested rays."""
    rays = golden(inputs)
    for name, what, unit, arrays in (
        ("direction", "direction", "", ("direction",)),
        ("local_mm", "exit point", " mm", ("local_mm", "origin_mm")),
    ):
        constant = np.median(values[name] - rays[name], axis=0) if name in values else np.array(math.nan)
        if np.isfinite(constant).all():
            constant = np.where(np.abs(constant) > 0.05 * np.abs(constant).max(), constant, 0.0)
            parts = [f"{x:+.3g}{unit} in {axis}" for x, axis in zip(constant, "xyz", strict=True) if x]
            yield add_constant(FIELDS[name][0], f"a constant added to the {what}: {', '.join(parts)}", arrays, constant)
    yield from _word_lengths(values["direction"])
    for name, value in (*_numbers(inputs.display).items(), (GLASS, inputs.display.array.index)):
        yield from _fit_number(name, value, inputs, values["direction"])


def fitted_together(inputs: PanelRays, values: Arrays) -> Iterator[tuple[Variant, ...]]:
    """Fit pairs of display parameters; yield the faults of the changed parameters."""
    from scipy.optimize import least_squares  # slow import

    numbers = _numbers(inputs.display)
    for names in combinations(numbers, 2):
        if len({name.partition("[")[0] for name in names}) == 1:
            continue
        old = [numbers[name] for name in names]
        unit = np.array([abs(value) or inputs.display.array.coarsest_mm for value in old])

        def residuals(candidates: Floats, names: tuple[str, ...] = names, unit: Floats = unit) -> Floats:
            rays = inputs
            try:
                for name, value in zip(names, candidates * unit, strict=True):
                    rays = with_number(name, float(value), rays)
                difference = rays.trace().direction - values["direction"]
                return np.clip(np.nan_to_num(difference), -1e3, 1e3).ravel()  # tested rays may be NaN
            except NO_RAYS:  # a huge residual shortens the fit's step
                return np.full(values["direction"].size, 1e3)

        fit = least_squares(residuals, old / unit, loss="soft_l1", f_scale=1e-4, diff_step=1e-6, max_nfev=25)
        wrong = [
            _wrong_number(name, float(value), was)
            for name, value, was in zip(names, fit.x * unit, old, strict=True)
            if f"{value:.6g}" != f"{was:.6g}"
        ]
        if wrong:
            yield tuple(wrong)


def _wrong_number(name: str, value: float, expected: float) -> Variant:
    stage = FITTED[name.rpartition(" ")[2]]
    return Variant(stage, f"{name} is {value:.6g} for {expected:.6g}", partial(with_number, name, value))


def _numbers(display: Display) -> dict[str, float]:
    numbers = {}
    for name in FITTED:
        path, _, entry = name.partition("[")
        value = attrgetter(path)(display)
        if isinstance(value, tuple) == bool(entry) and (value or name != "array.shear"):
            numbers[name] = float(value[int(entry[0])] if entry else value)
    return numbers


def _word_lengths(direction: Floats) -> Iterator[Variant]:
    for bits in range(4, 23):
        scaled = np.ldexp(direction, bits)
        if np.isfinite(scaled).all() and (scaled == np.round(scaled)).all():
            for name, cut in (("rounded", np.round), ("truncated", np.floor)):
                bend = partial(lambda cut, bits, d: np.ldexp(cut(np.ldexp(d, bits)), -bits), cut, bits)
                yield change_direction(f"direction {name} to {bits} bits of fraction", bend)
            return


def _fit_number(name: str, value: float, inputs: PanelRays, direction: Floats) -> Iterator[Variant]:
    # Search offsets in units of the pitch: offsets that differ by a pitch are equivalent.
    unit = value if value and "offset" not in name else inputs.display.array.coarsest_mm

    @cache
    def loss(candidates: float) -> float:
        try:
            rays = with_number(name, candidates, inputs).trace()
        except NO_RAYS:
            return math.inf
        return float(np.median(np.linalg.norm(rays.direction - direction, axis=1)))

    # A change in `LOOKED` moves a large panel's corner by several lenslets. The changes
    # in `near`, up to 2 %, move the corner in steps of 1/4 pitch.
    panel = inputs.display.panel
    step = 0.25 * inputs.display.array.finest_mm / (0.5 * math.hypot(panel.width_mm, panel.height_mm))
    near = step * np.arange(-int(0.02 / step), int(0.02 / step) + 1, dtype=np.float64)
    candidates = [value + share * unit for share in LOOKED]
    if name == "array.rotation_deg":
        candidates += [*map(float, range(-180, 180)), *(value + math.degrees(turn) for turn in near)]
    elif name == "array.shear" or "pitch_mm" in name:
        candidates += [value + share * (1.0 if name == "array.shear" else unit) for share in near]
    # Rotations that differ by a lattice symmetry fit equally well; take the smallest change.
    best = min(candidates, key=lambda candidate: (round(loss(candidate), 9), abs(candidate - value)))
    width = 0.02 * abs(unit)
    for _ in range(48):  # shrinks the width by the factor 2e-11
        best = min((best - width, best, best + width), key=loss)
        width *= 0.6
    if math.isfinite(loss(best)):
        yield _wrong_number(name, best, value)


def pairs(inputs: PanelRays, fields: Arrays, apart: Callable[[Variant], float]) -> Iterator[Variant]:
    """Yield pairs of faults, the likeliest first; `apart` returns a fault's distance from the rays."""
    ranked = sorted(variants(inputs.display), key=apart)
    numbers = list(fitted(inputs, fields))
    yield from (both(one, other) for one, other in combinations(ranked, 2))
    yield from (both(one, number) for one in ranked for number in numbers)
    units = list(fitted(inputs, fields | {"direction": unit_vectors(fields["direction"])}))
    yield from (both(one, number) for one in ranked if one.bend is not None for number in units)
    yield from (both(*numbers) for numbers in fitted_together(inputs, fields))
    # First apply one of the 12 nearest or a fitted input fault, or an output fault; then fit a second.
    changes = [one for one in (*ranked[:12], *numbers) if one.change is not None]
    for one in (*changes, *(one for one in ranked if one.bend is not None)):
        with suppress(*NO_RAYS, KeyError):
            changed = inputs if one.change is None else one.change(inputs)
            bent = fields if one.bend is None else fields | one.bend(fields)
            yield from (both(one, number) for number in fitted(changed, bent))


def both(*faults: Variant) -> Variant:
    """Combine faults: first all change the inputs, then all change the outputs."""

    def change(inputs: PanelRays) -> PanelRays:
        for one in faults:
            inputs = inputs if one.change is None else one.change(inputs)
        return inputs

    def bend(rays: Arrays) -> Arrays:
        for one in faults:
            rays = rays if one.bend is None else rays | one.bend(rays)
        return rays

    ordered = sorted(faults, key=lambda one: STAGES.index(one.stage))
    silent = tuple({name for one in faults for name in one.silent})
    return Variant(ordered[0].stage, PAIR.join(one.name for one in ordered), change, bend, silent=silent)

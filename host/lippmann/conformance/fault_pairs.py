"""Two faults at once, for rays that no single one explains.

Variants change the inputs of a trace or its results, so that two of them combine. A number of the display is fitted
beside the variants that alone come nearest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

import numpy as np

from lippmann.conformance.hard_cases import Out
from lippmann.conformance.lens_faults import PAIR, STAGES, Arrays, Variant, fitted, fitted_together, golden, variants
from lippmann.errors import LippmannError

#: Variants, of those that come nearest alone, beside which numbers are fitted.
NEAREST = 12


def pairs(given: Out, fields: Arrays, apart: Callable[[Variant], float]) -> Iterator[Variant]:
    """Yield pairs of variants, the likeliest first; `apart` tells how far a variant alone is from the rays `fields`.

    Numbers are fitted to `fields`, those of the rays `given`.
    """
    ranked = sorted(variants(given.display), key=apart)
    numbers = list(fitted(given, fields))
    yield from (both(one, other) for one, other in combinations(ranked, 2))
    yield from (both(one, number) for one in ranked for number in numbers)
    length = np.linalg.norm(fields["direction"], axis=1, keepdims=True)
    units = list(fitted(given, fields | {"direction": fields["direction"] / np.where(length > 0.0, length, 1.0)}))
    yield from (both(one, number) for one in ranked if one.bend is not None for number in units)
    yield from (both(*numbers) for numbers in fitted_together(given, fields))
    for one in (*ranked[:NEAREST], *numbers):
        if one.change is not None:
            yield from _beside(one, one.change, None, given, fields)
    for one in ranked:
        if one.bend is not None:
            yield from _beside(one, None, one.bend, given, fields)


def _beside(
    one: Variant,
    change: Callable[[Out], Out] | None,
    bend: Callable[[Arrays], Arrays] | None,
    given: Out,
    fields: Arrays,
) -> Iterator[Variant]:
    """Yield a variant with each number that is fitted beside it, if it leaves a display and its arrays are there."""
    try:
        given = given if change is None else change(given)
        fields = fields if bend is None else fields | bend(fields)
        yield from (both(one, number) for number in fitted(given, fields))
    except (LippmannError, ValueError, ZeroDivisionError, KeyError):
        return


def both(*some: Variant) -> Variant:
    """Return the variant with all of some faults: first the changed inputs, then the changed results."""

    def change(given: Out) -> Out:
        for one in some:
            given = one.change(given) if one.change is not None else given
        return given

    def predict(given: Out, rays: Arrays) -> Arrays:
        changed = change(given)
        found = rays if changed is given else golden(changed)
        for one in some:
            found = found if one.bend is None else found | one.bend(found)
        return found

    ordered: Sequence[Variant] = sorted(some, key=lambda one: STAGES.index(one.stage))
    silent = tuple({name for one in some for name in one.silent})
    return Variant(ordered[0].stage, PAIR.join(one.name for one in ordered), predict, silent, change)

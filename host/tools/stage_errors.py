"""Computes the error budget of the fixed-point pipeline's steps, and makes the page of `tools.bench fixed`.

A hybrid run computes the first steps in integers, and the other steps in float64. With one more step in integers, the
exit ray moves; this movement is the error of that step. The errors of all steps and of the rounded configuration add up
exactly to the twin's error.
"""

from __future__ import annotations

import dataclasses
import inspect
import itertools
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from lippmann.cli.frame import Choice, option
from lippmann.conformance.engine_report import logger
from lippmann.conformance.figures import Figures, Measured, Rows, columns, groups, values, where
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import COLOURS, Plot, finish_picture, make_axes
from lippmann.display.description import Display, Grid
from lippmann.engines import trace
from lippmann.fixed import ray_pipeline, ray_start
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.conversion import pixels_of_words
from lippmann.fixed.lenslet_faces import Meeting
from lippmann.fixed.words import OFFSET_FRACTION, Ints, extra_bits
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import HALF_SQRT3, Lattice
from lippmann.optics.rays import Floats
from lippmann.optics.system import System

from tools.bench import MeasurementRun, measurement
from tools.fixed_errors import (
    BUDGET,
    MAXIMA,
    SAMPLE,
    WHOLE,
    Words,
    aims_of,
    cell_aims,
    compare,
    measure,
    random_pixels,
    sets_of,
)
from tools.named_builds import CONFIGURATIONS, Named
from tools.report_plots import draw_bar_charts, draw_bars, make_page

if TYPE_CHECKING:
    from tools.full_report import Plan

#: Registers and ray between two steps, as words or numbers, keyed by the twin's parameter names.
State = dict[str, Any]
Steps = Mapping[str, Callable[..., Any]]

#: Number of a word's fraction bits beyond F, without those of `_EXTRA`, keyed by name. Other values are integers.
_FRACTIONS = {
    **dict.fromkeys(("slope_x", "slope_y", "slope_aim_x", "slope_aim_y", "point_x", "point_y"), 0),
    **dict.fromkeys(("point_aim_x", "point_aim_y", "cx", "cy", "rx", "g", "lean", "index", "index_square"), 0),
    **dict.fromkeys(("index_inverse_square", "depth", "x", "y", "a", "b", "mx", "my", "hx", "hy"), 0),
    **dict.fromkeys(("index_inverse", "exit_z", "half", "half_y", "rise", "nx", "ny", "nz", "cos"), 1),
    **dict.fromkeys(("ex", "ey", "ez", "dx", "dy", "dz", "out_x", "out_y", "out_dx", "out_dy", "out_dz"), 1),
    **{"depth_rest": 3, "s": 3, "share": 11, "offset_x": 2, "offset_y": 2},
}
#: Number of a word's further fraction bits, in units of `Build.extra`.
_EXTRA = {
    **dict.fromkeys(("slope_x", "slope_y", "slope_aim_x", "slope_aim_y", "mx", "my", "ex", "ey", "ez", "dx", "dy"), 1),
    "dz": 3,
}
#: Names (in `State`) of the values that a step returns, keyed by step.
_ADDED = {
    **dict.fromkeys(("lenslet_square", "lenslet_hex"), ("i", "j", "x", "y")),
    "aim": ("i", "j", "x", "y", "a", "b"),
    "converge": ("x", "y"),
    "unit_slope": ("ex", "ey", "ez"),
    **dict.fromkeys(("enter_flat", "enter_dome"), ("dx", "dy", "dz")),
    "meet_dome": Meeting._fields,
    "cell_step": ("di", "dj"),
    "move_lenslet": ("hx", "hy"),
    "leave_dome": ("out_dx", "out_dy", "out_dz"),
    "leave_flat": ("out_x", "out_y", "out_dx", "out_dy", "out_dz"),
}


def steps_of(build: Build) -> list[str]:
    """Return the names of an exact build's steps, in the order in which a ray takes them."""
    return [
        *("pixel_to_lattice", f"lenslet_{build.grid}", *["aim"] * build.aims, *["converge"] * build.converge),
        *(*["shear"] * build.shear, "blend", "unit_slope"),
        *(["meet_dome", "enter_dome", "leave_flat"] if build.viewer else ["enter_flat", "meet_dome", "leave_dome"]),
    ]


def hybrids(
    build: Build, config: Configuration, words: Words, first: int = 0
) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Yield exit points (in radii), directions, lenslets: each time with one more step in integers, from `first` on."""
    state: State = {"grid": build.grid, "f": build.fraction_bits, "upward": not build.viewer, **words._asdict()}
    state |= dataclasses.asdict(config)
    # Give the registers the names of the twin's parameters.
    state |= {"extra": build.extra, "shear": build.shear}
    state |= {"half": config.cell_half, "half_y": config.cell_half_y, "rise": config.cell_rise}
    state |= {"cx": config.cell_pitch_x, "cy": config.cell_pitch_y, "rx": config.shear_row}
    state |= {"lean": config.shear_lean, "g": config.shear_x}
    state |= {"share": config.converge_share, "offset_x": config.converge_x, "offset_y": config.converge_y}
    steps = steps_of(build)
    for cut in range(len(steps) + 1):
        if cut:
            _take(steps[cut - 1], TWIN, state, build)
        if cut >= first:
            yield _finished(build, state, steps[cut:])


def _finished(build: Build, state: State, steps: list[str]) -> tuple[Floats, Floats, Floats]:
    """Compute the remaining steps in float64; return the exit rays as `hybrids` yields them."""
    state = dict(state)
    for name, beyond in _FRACTIONS.items():
        if name in state:
            bits = build.fraction_bits + beyond + build.extra * _EXTRA.get(name, 0)
            state[name] = np.ldexp(np.asarray(state[name], np.float64), -bits)
    for name in steps:
        _take(name, FLOAT, state, build)
    if build.viewer:
        point = [state["out_x"], state["out_y"], np.full_like(state["out_x"], state["exit_z"])]
    else:
        point = [state["nx"], state["ny"], state["nz"] - 1.0]
    direction = [state[f"out_d{axis}"] for axis in "xyz"]
    return np.stack(point, axis=1), np.stack(direction, axis=1), np.stack([state["i"], state["j"]], axis=1)


def _take(name: str, steps: Steps, state: State, build: Build) -> None:
    """Compute a step with the functions `steps` (TWIN or FLOAT), and add its results to the state."""

    def call(name: str) -> Any:
        results = steps[name](*(state[parameter] for parameter in inspect.signature(steps[name]).parameters))
        state.update(zip(_ADDED[name], results, strict=False))
        return results

    if name == "pixel_to_lattice":
        for axis in "xy":
            registers = (state[f"{axis}_{register}"] for register in ("from_u", "from_v", "offset"))
            state[axis] = steps[name](state["u"], state["v"], *registers, state["f"])[0]
    elif name == "shear":
        wide = build.fraction_bits + (4 if build.converge else 2)
        x, a = (steps[name](state[at], state[up], state["g"], state["f"], wide) for at, up in ("xy", "ab"))
        state |= {"x": x[0], "a": a[0]}
    elif name == "blend":
        for axis, towards in zip("xy", "ab", strict=True):
            at, to, f = state[axis], state[towards], state["f"]
            slope, aimed, bits = state[f"slope_{axis}"], state[f"slope_aim_{axis}"], (build.local, build.aim)
            sum_ = (slope, at, aimed, to) if build.converge else (slope, to - at, 0, None)
            point = state[f"point_{axis}"], at, state[f"point_aim_{axis}"], to
            state[f"m{axis}"] = steps[name](*sum_, f, build.near + build.extra, *bits, build.extra)[0]
            state[f"h{axis}"] = steps[name](*point, f, build.near + 1, *bits)[0]
    elif name == "meet_dome":
        if not state["upward"]:
            more = extra_bits(build.fraction_bits) if steps is TWIN else 0
            state |= {f"d{axis}": state[f"e{axis}"] * (1 << more * n) for axis, n in zip("xyz", (1, 1, 3), strict=True)}
        state["met"] = call("meet_dome")
        # Try the same number of further domes as the build.
        for _ in range(build.max_cell_steps):
            call("cell_step")
            call("move_lenslet")
            state["i"], state["j"] = state["i"] + state["di"], state["j"] + state["dj"]
            state["met"] = call("meet_dome")
    else:
        call(name)


# ---- the steps in float64: lengths in radii, the lattice in pitches and rows ----


def _pixel_to_lattice(u: Ints, v: Ints, from_u: int, from_v: int, offset: int, f: int) -> tuple[Floats]:
    # Remove half a unit of the last bit, which the offset contains for rounding.
    half = 1 << (OFFSET_FRACTION - 1 - f)
    return (np.ldexp(np.float64(u * from_u + v * from_v + offset - half), -OFFSET_FRACTION),)


def _lenslet(grid: Grid, x: Floats, y: Floats) -> tuple[Floats, ...]:
    row = HALF_SQRT3 if grid == "hex" else 1.0
    i, j, x, y = Lattice(grid, 1.0).locate(NumpyBackend(), x, y * row)
    return i, j, x, y / row


_lenslet_square, _lenslet_hex = partial(_lenslet, "square"), partial(_lenslet, "hex")


def _aim(i: Ints, j: Ints, x: Floats, y: Floats, a: Floats, b: Floats, grid: Grid) -> tuple[Floats, ...]:
    di, dj, a, b = _lenslet(grid, a, b)
    return i + di, j + dj, *_move_lenslet(x, y, di, dj, 1.0, 1.0, 0.0, grid, False), a, b


def _converge(
    i: Floats, j: Floats, x: Floats, y: Floats, share: float, offset_x: float, offset_y: float, grid: Grid
) -> tuple[Floats, ...]:
    centre_x = i + 0.5 * j if grid == "hex" else i
    return x + share * centre_x + offset_x, y + share * j + offset_y


def _shear(x: Floats, y: Floats, g: float, f: int, bits: int) -> tuple[Floats]:
    return (x + g * y,)


def _blend(k: float, x: Floats, l: float, a: Floats | None, *_: int) -> tuple[Floats]:  # noqa: E741
    return (k * x if a is None else k * x + l * a,)


def _unit_slope(mx: Floats, my: Floats) -> tuple[Floats, ...]:
    ez = 1.0 / np.sqrt(1.0 + mx**2 + my**2)
    return mx * ez, my * ez, ez


def _enter_flat(ex: Floats, ey: Floats, index_inverse: float) -> tuple[Floats, ...]:
    dx, dy = index_inverse * ex, index_inverse * ey
    return dx, dy, np.sqrt(1.0 - dx**2 - dy**2)


def _meet_dome(
    hx: Floats, hy: Floats, dx: Floats, dy: Floats, dz: Floats, depth: float, depth_rest: float, upward: bool
) -> tuple[Floats, ...]:
    zc, remainder, dz = (depth, depth_rest, dz) if upward else (1.0, 0.0, -dz)
    along = hx * dx + hy * dy + zc * dz
    square = remainder - hx**2 - hy**2 + along**2
    cos = np.sqrt(np.maximum(square, 0.0))
    length = (cos if upward else np.where(square < 0.0, 0.5, -cos)) - along
    return hx + length * dx, hy + length * dy, zc + length * dz, cos, 1.0 - square


def _cell_step(
    nx: Floats, ny: Floats, half: float, half_y: float, rise: float, lean: float, grid: Grid, shear: bool
) -> tuple[Floats, ...]:
    lean = lean if shear else 0.0
    tall = half_y if grid == "square" else half * HALF_SQRT3 / (rise + 0.5 * lean)
    return Lattice(grid, (2.0 * half, 2.0 * tall), shear=lean).locate(NumpyBackend(), nx, ny)[:2]


def _move_lenslet(
    hx: Floats, hy: Floats, di: Ints | Floats, dj: Ints | Floats, cx: float, cy: float, rx: float, grid: Grid,
    shear: bool,
) -> tuple[Floats, ...]:  # fmt: skip
    if not shear:
        rx = 0.5 * cx if grid == "hex" else 0.0
    return hx - di * cx - dj * rx, hy - dj * cy


def _leave_dome(
    nx: Floats, ny: Floats, nz: Floats, cos: Floats, s: Floats,
    ex: Floats, ey: Floats, dz: Floats, index: float, index_square: float,
) -> tuple[Floats, ...]:  # fmt: skip
    bend = np.sqrt(np.maximum(1.0 - s * index_square, 0.0)) - index * cos
    return ex + bend * nx, ey + bend * ny, index * dz + bend * nz


def _enter_dome(
    nx: Floats, ny: Floats, cos: Floats, s: Floats,
    ex: Floats, ey: Floats, index_inverse: float, index_inverse_square: float,
) -> tuple[Floats, ...]:  # fmt: skip
    bend = np.sqrt(1.0 - s * index_inverse_square) - index_inverse * cos
    return index_inverse * ex - bend * nx, index_inverse * ey - bend * ny


def _leave_flat(
    nx: Floats, ny: Floats, nz: Floats, dx: Floats, dy: Floats, depth: float, index: float, index_square: float
) -> tuple[Floats, ...]:
    lateral = dx**2 + dy**2
    path = (nz - depth) / np.sqrt(1.0 - lateral)
    dz = np.sqrt(np.maximum(1.0 - lateral * index_square, 0.0))
    return nx + path * dx, ny + path * dy, index * dx, index * dy, dz


#: The steps' functions, keyed by name: the twin's, and float64 functions.
TWIN: Steps = vars(ray_start) | vars(ray_pipeline)
FLOAT: Steps = {name: globals()[f"_{name}"] for name in ("pixel_to_lattice", "shear", "blend", *_ADDED)}


def draw_budget(data: Figures) -> Plot:
    """Draw each step's part of the RTL's error, with a column per configuration."""
    columns = groups(data.rows, "configuration")
    picture, axes = make_axes(2, len(columns), (3.4, 3.0))
    for across, rows in enumerate(columns):
        # Only the first column has labels: the steps' names without `_square` or `_hex`.
        steps = [row["step"].removesuffix("_square").removesuffix("_hex") if across == 0 else "" for row in rows]
        colours = [*[COLOURS[0]] * (len(rows) - 1), COLOURS[6]]
        for axis, key, unit in zip(axes[:, across], ("rms_urad", "rms_nm"), ("microradian", "nm"), strict=True):
            draw_bars(axis, steps, values(rows, key), color=colours)
            axis.set(xlabel=f"rms, {unit}", title=rows[0]["configuration"])
    return Plot("report-budget", finish_picture(picture))


QUANTITIES = (("direction", "urad"), ("point", "nm"))
#: The report's columns of the budget, each with the column of `budget` that it shows.
BUDGETED = {
    **{f"{kind}_{unit}": f"{kind}_{of}_{unit}" for of, unit in QUANTITIES for kind in ("max", "rms")},
    **{f"left_max_{unit}": f"left_max_{of}_{unit}" for of, unit in QUANTITIES},
}


def budget(variant: Named, display: Display, seed: int, count: int = BUDGET) -> list[dict[str, Any]]:
    """Return how much each step adds to an exact configuration's error, for rays of random pixels and aims.

    The first row is for the rounding of the configuration's words; the rows of the steps follow, then the total. A row
    has the distance by which its step moves the ray and, in columns `left_...`, the error that remains if the step is
    exact.
    """
    build = variant.build
    random = np.random.default_rng(seed)
    count = min(count, WHOLE)
    words = Words(*random_pixels(display, random, count), *cell_aims(display, build, random, count))
    config = configuration(display, build, build.model)
    pixel = pixels_of_words(display, words.u, words.v)
    golden = trace(display, pixel, aims_of(display, build, words), build.model)
    turn_back = System.of(display).frame.turn_back
    # Directions in microradian and points in nm: first of golden, then of the hybrid runs.
    runs = [
        np.stack([np.column_stack([*turn_back(*v.T[:2]), v[:, 2]]) * 1e6 for v in (golden.direction, golden.local_mm)])
    ]
    alive = compare(display, build, words).alive
    steps = steps_of(build)
    for point, direction, lenslet in hybrids(build, config, words):
        runs.append(np.stack([direction * 1e6, point * display.array.radius_mm * 1e6]))
        alive &= (lenslet == golden.lenslet).all(axis=1)
    runs = [run[:, alive] for run in runs]

    def row(step: str, share: Floats, others: Floats) -> dict[str, Any]:
        columns: dict[str, Any] = {"configuration": variant.name, "display": display.name, "stage": step}
        for prefix, moves in (("", share), ("left_", others)):
            for quantity, move in zip(("direction_urad", "point_nm"), moves, strict=True):
                length = np.linalg.norm(move, axis=1)
                columns[f"{prefix}max_{quantity}"] = float(length.max())
                columns[f"{prefix}rms_{quantity}"] = float((length**2).mean() ** 0.5)
        return columns

    total = runs[-1] - runs[0]
    shares = (after - before for before, after in itertools.pairwise(runs))
    rows = [row(step, share, total - share) for step, share in zip(["configuration", *steps], shares, strict=True)]
    return [*rows, row("all", total, 0.0 * total)]


def measure_budget(scenes: Path, plan: Plan, seed: int) -> Figures:
    """Measure the error budget of the plan's configurations, each on the founding paper's display of its grid."""
    rows = []
    for name in plan.budget:
        logger.info("error budget: %s ...", name)
        variant = CONFIGURATIONS[name]
        for step in budget(variant, variant.displays(scenes)[0], seed, min(BUDGET, plan.rays)):
            values = {column: Measured(step[key]) for column, key in BUDGETED.items()}
            rows.append({"configuration": name, "display": step["display"], "step": step["stage"], **values})
    return Figures("report-budget", ("configuration", "display", "step"), rows)


@measurement(page="fixed-point-error", packages=("numpy",))
def fixed(
    bench: MeasurementRun,
    configuration: tuple[str, ...] = option(
        "Configuration to measure; may be repeated.", (), Choice([*CONFIGURATIONS]), multiple=True, metavar="NAME"
    ),
) -> tuple[Mapping[str, Any], Page]:
    """Measure the fixed-point pipeline's error against golden, and each step's part of this error.

    Example: python -m tools.bench fixed --configuration widest-square
    """
    rows, shares = [], []
    for variant in (CONFIGURATIONS[name] for name in configuration or CONFIGURATIONS):
        for display in variant.displays(bench.scenes):
            sets = sets_of(variant.build, display, bench.seed)
            rows += [measure(variant, display, rays_of, chunks) for rays_of, chunks in sets.items()]
            shares += budget(variant, display, bench.seed) if variant.build.model == "exact" else []
    return {"rows": rows, "budget": shares}, fixed_page(bench.origin, rows, shares)


def fixed_page(origin: Mapping[str, str], rows: Rows, budget: Rows) -> Page:
    """Return the page of `tools.bench fixed`."""
    worst = []
    for group in groups(rows, "configuration"):
        promises = [value for value in values(group, "kept") if value is not None]
        largest = max(group, key=lambda row: float(row["max_weighted_urad"]))
        row = {key: largest[key] for key in ("configuration", "fraction_bits", "display")}
        row |= {key: max(values(group, key)) for key in MAXIMA}
        row |= {
            key: sum(values(group, key)) for key in ("rays", "status_differs", "lenslet_differs", "refused", "lost")
        }
        worst.append({**row, "kept": all(promises) if promises else None})
    steps = []
    for group in groups(budget, "configuration"):
        *shares, total = where(group, display=group[0]["display"])
        largest = max(shares, key=lambda row: float(row["rms_direction_urad"]))
        steps.append({**largest, "whole_urad": total["rms_direction_urad"], "whole_nm": total["rms_point_nm"]})
    charts = columns(worst, {"weighted direction, microradian": "max_weighted_urad", "exit point, nm": "max_point_nm"})
    plot = draw_bar_charts("fixed-point-error", values(worst, "configuration"), charts, xscale="log")
    context = {"worst": worst, "steps": steps, "budget_rays": BUDGET, "complete_px": WHOLE, "sample": SAMPLE}
    tables = {"fixed-point-error": rows, "fixed-point-budget": budget}
    return make_page("fixed-point-error", origin, [plot], tables, context)

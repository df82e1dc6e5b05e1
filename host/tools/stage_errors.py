"""The steps of the exact model, each in the twin's integers and in float64, for the error budget.

A hybrid run takes the first steps in integers and the rest in float64. When one more step is taken in integers, the ray
that leaves moves: this is the step's share of the error. The shares, with that of the rounded configuration, add up
to the error of the twin, exactly, ray by ray.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from lippmann.display.description import Grid
from lippmann.fixed import ray_pipeline
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.meet_dome import Meeting
from lippmann.fixed.words import OFFSET_FRACTION, Ints, extra_bits
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import HALF_SQRT3, Lattice
from lippmann.optics.rays import Floats

from tools.word_sets import Words

#: The registers and the ray between two steps, under the names of the twin's parameters: words, or numbers.
State = dict[str, Any]
Steps = Mapping[str, Callable[..., Any]]

#: Fraction bits beyond F of the words, before those of `_EXTRA`. Other names are whole numbers.
_FRACTIONS = {
    **dict.fromkeys(("slope_x", "slope_y", "slope_aim_x", "slope_aim_y"), 0),
    **dict.fromkeys(("point_x", "point_y", "point_aim_x", "point_aim_y"), 0),
    **dict.fromkeys(("cx", "cy", "rx", "g", "lean"), 0),
    **dict.fromkeys(("index", "index_square", "index_inverse_square", "depth"), 0),
    **dict.fromkeys(("index_inverse", "exit_z", "half", "half_y", "rise"), 1),
    "depth_rest": 3,
    **{"share": 11, "offset_x": 2, "offset_y": 2},
    **dict.fromkeys(("x", "y", "a", "b", "mx", "my", "hx", "hy"), 0),
    **dict.fromkeys(("ex", "ey", "ez", "dx", "dy", "dz", "nx", "ny", "nz", "cos"), 1),
    **dict.fromkeys(("out_x", "out_y", "out_dx", "out_dy", "out_dz"), 1),
    "s": 3,
}
#: Those with more bits in some builds, by `Build.extra` times so many.
_EXTRA = {
    **dict.fromkeys(("slope_x", "slope_y", "slope_aim_x", "slope_aim_y", "mx", "my", "ex", "ey", "ez", "dx", "dy"), 1),
    "dz": 3,
}
#: What steps add to the state, in the order in which their functions return it.
_ADDED = {
    **dict.fromkeys(("lenslet_square", "lenslet_hex"), ("i", "j", "x", "y")),
    "aim": ("i", "j", "x", "y", "a", "b"),
    "converge": ("x", "y"),
    "unit_slope": ("ex", "ey", "ez"),
    "enter_flat": ("dx", "dy", "dz"),
    "meet_dome": Meeting._fields,
    "cell_step": ("di", "dj"),
    "move_lenslet": ("hx", "hy"),
    "leave_dome": ("out_dx", "out_dy", "out_dz"),
    "enter_dome": ("dx", "dy"),
    "leave_flat": ("out_x", "out_y", "out_dx", "out_dy", "out_dz"),
}


def steps_of(build: Build) -> list[str]:
    """Return the steps of an exact build in the order of the ray."""
    return [
        *("pixel_to_lattice", f"lenslet_{build.grid}", *["aim"] * build.aims, *["converge"] * build.converge),
        *(*["shear"] * build.shear, "blend", "unit_slope"),
        *(["meet_dome", "enter_dome", "leave_flat"] if build.viewer else ["enter_flat", "meet_dome", "leave_dome"]),
    ]


def hybrids(
    build: Build, config: Configuration, words: Words, first: int = 0
) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Run the steps of an exact build, the first ones in integers: `first` of them, then one more each time, to all.

    Yields the exit rays' points (N, 3), in radii from the lenslet's vertex, directions (N, 3), and lenslets (N, 2).
    """
    state: State = {"grid": build.grid, "f": build.fraction_bits, "upward": not build.viewer, **words._asdict()}
    state |= dataclasses.asdict(config)
    # As the twin's parameters are called.
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
    """Take the remaining steps in float64; returns what `hybrids` yields."""
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
    """Take a step with the twin's functions or those in float64: add to the state what it gives."""

    def call(name: str) -> Any:
        found = steps[name](*(state[parameter] for parameter in inspect.signature(steps[name]).parameters))
        state.update(zip(_ADDED[name], found, strict=False))
        return found

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
        # As many further domes as the build tries.
        for _ in range(build.max_cell_steps):
            call("cell_step")
            call("move_lenslet")
            state["i"], state["j"] = state["i"] + state["di"], state["j"] + state["dj"]
            state["met"] = call("meet_dome")
    else:
        call(name)


# ---- the steps in float64: lengths in radii, the lattice in pitches and rows ----


def _pixel_to_lattice(u: Ints, v: Ints, from_u: int, from_v: int, offset: int, f: int) -> tuple[Floats]:
    # The offset's word carries the half of the rounding to F bits.
    half = 1 << (OFFSET_FRACTION - 1 - f)
    lattice: Floats = np.ldexp(np.float64(u * from_u + v * from_v + offset - half), -OFFSET_FRACTION)
    return (lattice,)


def _lenslet(grid: Grid, x: Floats, y: Floats) -> tuple[Floats, ...]:
    row = HALF_SQRT3 if grid == "hex" else 1.0
    i, j, x, y = Lattice(grid, 1.0).locate(NumpyBackend(), x, y * row)
    return i, j, x, y / row


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
    zc, rest, dz = (depth, depth_rest, dz) if upward else (1.0, 0.0, -dz)
    along = hx * dx + hy * dy + zc * dz
    square = rest - hx**2 - hy**2 + along**2
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


_FLOAT = (
    *(
        _pixel_to_lattice,
        _aim,
        _converge,
        _shear,
        _blend,
        _unit_slope,
        _enter_flat,
        _meet_dome,
        _cell_step,
        _move_lenslet,
    ),
    *(_leave_dome, _enter_dome, _leave_flat),
)
#: The steps' functions under the names by which `ray_pipeline` calls them: the twin's, and those in float64.
TWIN: Steps = dict(vars(ray_pipeline))
FLOAT: Steps = {
    "lenslet_square": partial(_lenslet, "square"),
    "lenslet_hex": partial(_lenslet, "hex"),
    **{step.__name__.removeprefix("_"): step for step in _FLOAT},
}

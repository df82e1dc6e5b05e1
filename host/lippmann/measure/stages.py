"""The steps of the exact model one by one, each in the twin's integers and in float64, for the error budget.

A hybrid run takes the first steps in integers and the rest in float64. From one hybrid to the next a single step
changes over, and the ray that leaves moves by what that step does to it: its share of the error. The shares, with that
of the configuration's own rounding, add up to the error of the twin, exactly, ray by ray.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.fixed.aim import aim
from lippmann.fixed.blend import blend
from lippmann.fixed.build import Build
from lippmann.fixed.cell_step import cell_step
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.enter_dome import enter_dome
from lippmann.fixed.enter_flat import enter_flat
from lippmann.fixed.leave_dome import leave_dome
from lippmann.fixed.leave_flat import leave_flat
from lippmann.fixed.lenslet_hex import lenslet_hex
from lippmann.fixed.lenslet_square import lenslet_square
from lippmann.fixed.meet_dome import Meeting, meet_dome
from lippmann.fixed.move_lenslet import move_lenslet
from lippmann.fixed.pixel_to_panel import pixel_to_panel
from lippmann.fixed.unit_slope import unit_slope
from lippmann.fixed.words import OFFSET_FRACTION, Ints
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import HALF_SQRT3, Lattice

Floats = npt.NDArray[np.float64]
#: The ray between two steps: words, or the numbers that they stand for, under the twin's names.
State = dict[str, Any]


class Stage(NamedTuple):
    """A step of the ray, from a state to what it adds to it."""

    name: str
    fixed: Callable[[State], State]
    exact: Callable[[State], State]


@dataclass(frozen=True)
class Numbers:
    """What the configuration's words stand for: lengths in radii, the lattice in pitches and rows."""

    slope: tuple[float, float]
    point: tuple[float, float]
    point_aim: tuple[float, float]
    index: float
    index_square: float
    index_inverse: float
    index_inverse_square: float
    depth: float
    depth_rest: float
    exit_z: float
    cell_half: float
    cell_pitch: tuple[float, float]

    @classmethod
    def of(cls, c: Configuration, f: int) -> Numbers:
        """Return the numbers of a configuration."""

        def number(word: int, fraction: int = f) -> float:
            return float(word) / float(1 << fraction)

        return cls(
            slope=(number(c.slope_x), number(c.slope_y)),
            point=(number(c.point_x), number(c.point_y)),
            point_aim=(number(c.point_aim_x), number(c.point_aim_y)),
            index=number(c.index),
            index_square=number(c.index_square),
            index_inverse=number(c.index_inverse, f + 1),
            index_inverse_square=number(c.index_inverse_square),
            depth=number(c.depth),
            depth_rest=number(c.depth_rest, f + 3),
            exit_z=number(c.exit_z, f + 1),
            cell_half=number(c.cell_half, f + 1),
            cell_pitch=(number(c.cell_pitch_x), number(c.cell_pitch_y)),
        )


#: Fraction bits of each name beyond F; those not named here are whole numbers.
_FRACTIONS = {
    **dict.fromkeys(("lattice_x", "lattice_y", "x", "y", "a", "b", "mx", "my", "hx", "hy"), 0),
    **dict.fromkeys(("ex", "ey", "ez", "dx", "dy", "dz", "nx", "ny", "nz", "cos"), 1),
    **dict.fromkeys(("out_x", "out_y", "out_z", "out_dx", "out_dy", "out_dz"), 1),
    "s": 3,
}


def numbers_of(state: State, f: int) -> State:
    """Return what a state's words stand for, float64."""
    return {
        key: np.ldexp(np.asarray(value, np.float64), -(f + _FRACTIONS[key])) if key in _FRACTIONS else value
        for key, value in state.items()
    }


def hybrid(stages: list[Stage], cut: int, start: State, f: int) -> State:
    """Run the first `cut` stages in integers and the others in float64; return the last state as numbers."""
    state = dict(start)
    for stage in stages[:cut]:
        state.update(stage.fixed(state))
    state = numbers_of(state, f)
    for stage in stages[cut:]:
        state.update(stage.exact(state))
    return state


def stages_of(build: Build, config: Configuration) -> list[Stage]:
    """Return the steps of an exact build in the order of the ray.

    The first takes pixels `u`, `v` and, where the build has aims, `a`, `b`, as `ray_pipeline` does; the last gives
    `i`, `j`, `out_x` ... `out_z` (radii) and `out_dx` ... `out_dz`.
    """
    c, numbers = config, Numbers.of(config, build.fraction_bits)
    return [
        _pixel_to_panel(build, c),
        _lenslet(build),
        *([_aim(build)] if build.aims else []),
        _blend(build, c, numbers),
        _unit_slope(build),
        *([] if build.viewer else [_enter_flat(build, c, numbers)]),
        _meet_dome(build, c, numbers),
        *(
            [_enter_dome(build, c, numbers), _leave_flat(build, c, numbers)]
            if build.viewer
            else [_leave_dome(build, c, numbers)]
        ),
    ]


def _pixel_to_panel(build: Build, c: Configuration) -> Stage:
    f = build.fraction_bits

    def fixed(s: State) -> State:
        return {
            "lattice_x": pixel_to_panel(s["u"], s["v"], c.x_from_u, c.x_from_v, c.x_offset, f),
            "lattice_y": pixel_to_panel(s["u"], s["v"], c.y_from_u, c.y_from_v, c.y_offset, f),
        }

    def exact(s: State) -> State:
        # The offset's word carries the half of the rounding to F bits.
        half = 1 << (OFFSET_FRACTION - 1 - f)
        return {
            "lattice_x": np.ldexp(np.float64(s["u"] * c.x_from_u + s["v"] * c.x_from_v + c.x_offset - half), -40),
            "lattice_y": np.ldexp(np.float64(s["u"] * c.y_from_u + s["v"] * c.y_from_v + c.y_offset - half), -40),
        }

    return Stage("pixel_to_panel", fixed, exact)


def _locate(build: Build, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the cell of points in pitches and rows, and the points from its centre, likewise."""
    row = HALF_SQRT3 if build.grid == "hex" else 1.0
    i, j, x, y = Lattice(build.grid, 1.0).locate(NumpyBackend(), x, y * row)
    return i, j, x, y / row


def _lenslet(build: Build) -> Stage:
    locate = lenslet_hex if build.grid == "hex" else lenslet_square

    def state(i: Any, j: Any, x: Any, y: Any) -> State:
        still = {} if build.aims else {"a": 0.0 * x if x.dtype == np.float64 else 0 * x}
        return {"i": i, "j": j, "x": x, "y": y, **still, **({"b": still["a"]} if still else {})}

    def fixed(s: State) -> State:
        return state(*locate(s["lattice_x"], s["lattice_y"], build.fraction_bits))

    def exact(s: State) -> State:
        return state(*_locate(build, s["lattice_x"], s["lattice_y"]))

    return Stage(f"lenslet_{build.grid}", fixed, exact)


def _aim(build: Build) -> Stage:
    def fixed(s: State) -> State:
        out = aim(s["i"], s["j"], s["x"], s["y"], s["a"], s["b"], build.grid, build.fraction_bits)
        return {key: getattr(out, key) for key in ("i", "j", "x", "y", "a", "b")}

    def exact(s: State) -> State:
        di, dj, a, b = _locate(build, s["a"], s["b"])
        half = 0.5 * dj if build.grid == "hex" else 0.0
        return {"i": s["i"] + di, "j": s["j"] + dj, "x": s["x"] - di - half, "y": s["y"] - dj, "a": a, "b": b}

    return Stage("aim", fixed, exact)


def _blend(build: Build, c: Configuration, n: Numbers) -> Stage:
    f = build.fraction_bits

    def fixed(s: State) -> State:
        x, y, a, b = (s[key] for key in "xyab")
        aim_x, aim_y = (a, b) if build.aims else (None, None)
        return {
            "mx": blend(c.slope_x, a - x, 0, None, f),
            "my": blend(c.slope_y, b - y, 0, None, f),
            "hx": blend(c.point_x, x, c.point_aim_x, aim_x, f),
            "hy": blend(c.point_y, y, c.point_aim_y, aim_y, f),
        }

    def exact(s: State) -> State:
        x, y, a, b = (s[key] for key in "xyab")
        return {
            "mx": n.slope[0] * (a - x),
            "my": n.slope[1] * (b - y),
            "hx": n.point[0] * x + n.point_aim[0] * a,
            "hy": n.point[1] * y + n.point_aim[1] * b,
        }

    return Stage("blend", fixed, exact)


def _unit_slope(build: Build) -> Stage:
    def fixed(s: State) -> State:
        return dict(zip(("ex", "ey", "ez"), unit_slope(s["mx"], s["my"], build.fraction_bits), strict=True))

    def exact(s: State) -> State:
        ez = 1.0 / np.sqrt(1.0 + s["mx"] ** 2 + s["my"] ** 2)
        return {"ex": s["mx"] * ez, "ey": s["my"] * ez, "ez": ez}

    return Stage("unit_slope", fixed, exact)


def _enter_flat(build: Build, c: Configuration, n: Numbers) -> Stage:
    def fixed(s: State) -> State:
        glass = enter_flat(s["ex"], s["ey"], c.index_inverse, build.fraction_bits)
        return dict(zip(("dx", "dy", "dz"), glass, strict=True))

    def exact(s: State) -> State:
        dx, dy = n.index_inverse * s["ex"], n.index_inverse * s["ey"]
        return {"dx": dx, "dy": dy, "dz": np.sqrt(1.0 - dx**2 - dy**2)}

    return Stage("enter_flat", fixed, exact)


def _meeting(s: State) -> Meeting:
    return Meeting(s["nx"], s["ny"], s["nz"], s["cos"], s["s"], np.zeros(s["nx"].shape, np.bool_))


def _meet_dome(build: Build, c: Configuration, n: Numbers) -> Stage:
    """Meet the dome, after as many further domes as the build tries."""
    f, grid = build.fraction_bits, build.grid
    up = not build.viewer
    way = ("ex", "ey", "ez") if build.viewer else ("dx", "dy", "dz")

    def fixed(s: State) -> State:
        i, j, hx, hy = (s[key] for key in ("i", "j", "hx", "hy"))
        dx, dy, dz = (s[key] for key in way)
        met = meet_dome(hx, hy, dx, dy, dz, c.depth, c.depth_rest, f, up)
        for _ in range(build.max_cell_steps):
            di, dj, _ = cell_step(met.nx, met.ny, c.cell_half, grid, f)
            hx, hy = move_lenslet(hx, hy, di, dj, c.cell_pitch_x, c.cell_pitch_y, grid, f)
            i, j = i + di, j + dj
            met = meet_dome(hx, hy, dx, dy, dz, c.depth, c.depth_rest, f, up)
        return {"i": i, "j": j, **{key: getattr(met, key) for key in ("nx", "ny", "nz", "cos", "s")}}

    def met_at(hx: Floats, hy: Floats, dx: Floats, dy: Floats, dz: Floats) -> State:
        zc, rest = (n.depth, n.depth_rest) if up else (1.0, 0.0)
        dz = dz if up else -dz
        along = hx * dx + hy * dy + zc * dz
        square = rest - hx**2 - hy**2 + along**2
        cos = np.sqrt(np.maximum(square, 0.0))
        length = (cos if up else -cos) - along
        return {
            "nx": hx + length * dx,
            "ny": hy + length * dy,
            "nz": zc + length * dz,
            "cos": cos,
            "s": 1.0 - square,
        }

    def exact(s: State) -> State:
        i, j, hx, hy = (s[key] for key in ("i", "j", "hx", "hy"))
        d = [s[key] for key in way]
        met = met_at(hx, hy, *d)
        for _ in range(build.max_cell_steps):
            di, dj = _step(build, met["nx"], met["ny"], n.cell_half)
            hx = hx - di * n.cell_pitch[0] - (0.5 * dj * n.cell_pitch[0] if grid == "hex" else 0.0)
            hy = hy - dj * n.cell_pitch[1]
            i, j = i + di, j + dj
            met = met_at(hx, hy, *d)
        return {"i": i, "j": j, **met}

    return Stage("meet_dome", fixed, exact)


def _step(build: Build, x: Floats, y: Floats, half: float) -> tuple[Ints, Ints]:
    """Return the step to the next cell of points outside theirs, which is `half` wide on each side."""
    if build.grid == "square":
        return tuple((q >= half).astype(np.int64) - (q < -half).astype(np.int64) for q in (x, y))  # type: ignore[return-value]
    q = np.stack([x, 0.5 * x + HALF_SQRT3 * y, HALF_SQRT3 * y - 0.5 * x])
    outside = ((q >= half) | (q < -half)).any(axis=0)
    first = np.abs(q).argmax(axis=0)
    sign = np.where(np.take_along_axis(q, first[None], axis=0)[0] < 0.0, -1, 1) * outside
    steps = np.array([[1, 0], [0, 1], [-1, 1]])[first] * sign[:, None]
    return steps[:, 0], steps[:, 1]


def _leave_dome(build: Build, c: Configuration, n: Numbers) -> Stage:
    f = build.fraction_bits

    def fixed(s: State) -> State:
        d = leave_dome(_meeting(s), s["ex"], s["ey"], s["dz"], c.index, c.index_square, f)
        return _out(s["nx"], s["ny"], s["nz"] - (1 << (f + 1)), *d[:3])

    def exact(s: State) -> State:
        bend = np.sqrt(np.maximum(1.0 - s["s"] * n.index_square, 0.0)) - n.index * s["cos"]
        return _out(
            s["nx"],
            s["ny"],
            s["nz"] - 1.0,
            s["ex"] + bend * s["nx"],
            s["ey"] + bend * s["ny"],
            n.index * s["dz"] + bend * s["nz"],
        )

    return Stage("leave_dome", fixed, exact)


def _enter_dome(build: Build, c: Configuration, n: Numbers) -> Stage:
    def fixed(s: State) -> State:
        dx, dy = enter_dome(_meeting(s), s["ex"], s["ey"], c.index_inverse, c.index_inverse_square, build.fraction_bits)
        return {"dx": dx, "dy": dy}

    def exact(s: State) -> State:
        bend = np.sqrt(1.0 - s["s"] * n.index_inverse_square) - n.index_inverse * s["cos"]
        return {
            "dx": n.index_inverse * s["ex"] - bend * s["nx"],
            "dy": n.index_inverse * s["ey"] - bend * s["ny"],
        }

    return Stage("enter_dome", fixed, exact)


def _leave_flat(build: Build, c: Configuration, n: Numbers) -> Stage:
    def fixed(s: State) -> State:
        out = leave_flat(_meeting(s), s["dx"], s["dy"], c.depth, c.index, c.index_square, build.fraction_bits)
        return _out(out.x, out.y, np.full_like(out.x, c.exit_z), out.dx, out.dy, out.dz)

    def exact(s: State) -> State:
        lateral = s["dx"] ** 2 + s["dy"] ** 2
        path = (s["nz"] - n.depth) / np.sqrt(1.0 - lateral)
        return _out(
            s["nx"] + path * s["dx"],
            s["ny"] + path * s["dy"],
            np.full_like(path, n.exit_z),
            n.index * s["dx"],
            n.index * s["dy"],
            np.sqrt(np.maximum(1.0 - lateral * n.index_square, 0.0)),
        )

    return Stage("leave_flat", fixed, exact)


def _out(x: Any, y: Any, z: Any, dx: Any, dy: Any, dz: Any) -> State:
    return {"out_x": x, "out_y": y, "out_z": z, "out_dx": dx, "out_dy": dy, "out_dz": dz}

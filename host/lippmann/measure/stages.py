"""The steps of the exact model, each in the twin's integers and in float64, for the error budget.

A hybrid run takes the first steps in integers and the rest in float64. When one more step is taken in integers, the ray
that leaves moves: this is the step's share of the error. The shares, with that of the rounded configuration, add up
to the error of the twin, exactly, ray by ray.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
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
#: The ray between two steps, under the twin's names: words, or the numbers that they represent.
State = dict[str, Any]

#: Registers whose words have more fraction bits than F.
_REGISTER_FRACTIONS = {"index_inverse": 1, "depth_rest": 3, "exit_z": 1, "cell_half": 1}
#: Fraction bits beyond F of each name. Other names are whole numbers.
_FRACTIONS = {
    **dict.fromkeys(("lattice_x", "lattice_y", "x", "y", "a", "b", "mx", "my", "hx", "hy"), 0),
    **dict.fromkeys(("ex", "ey", "ez", "dx", "dy", "dz", "nx", "ny", "nz", "cos"), 1),
    **dict.fromkeys(("out_x", "out_y", "out_z", "out_dx", "out_dy", "out_dz"), 1),
    "s": 3,
}


def numbers_of(state: State, f: int) -> State:
    """Return the numbers that a state's words represent, float64."""
    return {
        key: np.ldexp(np.asarray(value, np.float64), -(f + _FRACTIONS[key])) if key in _FRACTIONS else value
        for key, value in state.items()
    }


class Stage(NamedTuple):
    """A step of the ray: from a state to what it adds to the state, in words and in float64."""

    name: str
    fixed: Callable[[State], State]
    exact: Callable[[State], State]


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
    fixed, exact = _FixedSteps(build, config), _ExactSteps(build, config)
    names = [
        *("pixel_to_panel", "lenslet", *(["aim"] if build.aims else []), "blend", "unit_slope"),
        *(["meet_dome", "enter_dome", "leave_flat"] if build.viewer else ["enter_flat", "meet_dome", "leave_dome"]),
    ]
    return [
        Stage(f"{name}_{build.grid}" if name == "lenslet" else name, getattr(fixed, name), getattr(exact, name))
        for name in names
    ]


def _out(x: Any, y: Any, z: Any, dx: Any, dy: Any, dz: Any) -> State:
    return {"out_x": x, "out_y": y, "out_z": z, "out_dx": dx, "out_dy": dy, "out_dz": dz}


def _in_lenslet(build: Build, i: Any, j: Any, x: Any, y: Any) -> State:
    """Return the state of a point in a lenslet's cell; the aims of a build without aims are the cell's centre."""
    return {"i": i, "j": j, "x": x, "y": y, **({} if build.aims else {"a": 0 * x, "b": 0 * x})}


def _met(s: State) -> Meeting:
    return Meeting(s["nx"], s["ny"], s["nz"], s["cos"], s["s"], np.zeros(s["nx"].shape, np.bool_))


class _FixedSteps:
    """The steps in the twin's integers."""

    def __init__(self, build: Build, config: Configuration) -> None:
        self.build, self.c, self.f = build, config, build.fraction_bits

    def pixel_to_panel(self, s: State) -> State:
        c = self.c
        return {
            "lattice_x": pixel_to_panel(s["u"], s["v"], c.x_from_u, c.x_from_v, c.x_offset, self.f),
            "lattice_y": pixel_to_panel(s["u"], s["v"], c.y_from_u, c.y_from_v, c.y_offset, self.f),
        }

    def lenslet(self, s: State) -> State:
        locate = lenslet_hex if self.build.grid == "hex" else lenslet_square
        return _in_lenslet(self.build, *locate(s["lattice_x"], s["lattice_y"], self.f))

    def aim(self, s: State) -> State:
        out = aim(s["i"], s["j"], s["x"], s["y"], s["a"], s["b"], self.build.grid, self.f)
        return {key: getattr(out, key) for key in ("i", "j", "x", "y", "a", "b")}

    def blend(self, s: State) -> State:
        c, f = self.c, self.f
        x, y, a, b = (s[key] for key in "xyab")
        aim_x, aim_y = (a, b) if self.build.aims else (None, None)
        return {
            "mx": blend(c.slope_x, a - x, 0, None, f),
            "my": blend(c.slope_y, b - y, 0, None, f),
            "hx": blend(c.point_x, x, c.point_aim_x, aim_x, f),
            "hy": blend(c.point_y, y, c.point_aim_y, aim_y, f),
        }

    def unit_slope(self, s: State) -> State:
        return dict(zip(("ex", "ey", "ez"), unit_slope(s["mx"], s["my"], self.f), strict=True))

    def enter_flat(self, s: State) -> State:
        return dict(zip(("dx", "dy", "dz"), enter_flat(s["ex"], s["ey"], self.c.index_inverse, self.f), strict=True))

    def meet_dome(self, s: State) -> State:
        """Meet the dome, and as many further domes as the build tries."""
        build, c, f, up = self.build, self.c, self.f, not self.build.viewer
        i, j, hx, hy = (s[key] for key in ("i", "j", "hx", "hy"))
        dx, dy, dz = (s[key] for key in (("dx", "dy", "dz") if up else ("ex", "ey", "ez")))
        met = meet_dome(hx, hy, dx, dy, dz, c.depth, c.depth_rest, f, up)
        for _ in range(build.max_cell_steps):
            di, dj, _ = cell_step(met.nx, met.ny, c.cell_half, build.grid, f)
            hx, hy = move_lenslet(hx, hy, di, dj, c.cell_pitch_x, c.cell_pitch_y, build.grid, f)
            i, j = i + di, j + dj
            met = meet_dome(hx, hy, dx, dy, dz, c.depth, c.depth_rest, f, up)
        return {"i": i, "j": j, **{key: getattr(met, key) for key in ("nx", "ny", "nz", "cos", "s")}}

    def leave_dome(self, s: State) -> State:
        d = leave_dome(_met(s), s["ex"], s["ey"], s["dz"], self.c.index, self.c.index_square, self.f)
        return _out(s["nx"], s["ny"], s["nz"] - (1 << (self.f + 1)), *d[:3])

    def enter_dome(self, s: State) -> State:
        c = self.c
        dx, dy = enter_dome(_met(s), s["ex"], s["ey"], c.index_inverse, c.index_inverse_square, self.f)
        return {"dx": dx, "dy": dy}

    def leave_flat(self, s: State) -> State:
        out = leave_flat(_met(s), s["dx"], s["dy"], self.c.depth, self.c.index, self.c.index_square, self.f)
        return _out(out.x, out.y, np.full_like(out.x, self.c.exit_z), out.dx, out.dy, out.dz)


class _ExactSteps:
    """The same steps in float64, on the numbers that the configuration's words represent.

    Lengths are in radii, the lattice is in pitches and rows.
    """

    def __init__(self, build: Build, config: Configuration) -> None:
        self.build, self.c = build, config
        names = (
            *("slope_x", "slope_y", "point_x", "point_y", "point_aim_x", "point_aim_y", "index", "index_square"),
            *("index_inverse", "index_inverse_square", "depth", "depth_rest", "exit_z"),
            *("cell_half", "cell_pitch_x", "cell_pitch_y"),
        )
        bits = {name: build.fraction_bits + _REGISTER_FRACTIONS.get(name, 0) for name in names}
        self.n: Any = SimpleNamespace(**{k: float(getattr(config, k)) / float(1 << bits[k]) for k in names})

    def pixel_to_panel(self, s: State) -> State:
        c, u, v = self.c, s["u"], s["v"]
        # The offset's word carries the half of the rounding to F bits.
        half = 1 << (OFFSET_FRACTION - 1 - self.build.fraction_bits)
        return {
            "lattice_x": np.ldexp(np.float64(u * c.x_from_u + v * c.x_from_v + c.x_offset - half), -40),
            "lattice_y": np.ldexp(np.float64(u * c.y_from_u + v * c.y_from_v + c.y_offset - half), -40),
        }

    def _locate(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the cell of points in pitches and rows, and the points from its centre, likewise."""
        row = HALF_SQRT3 if self.build.grid == "hex" else 1.0
        i, j, x, y = Lattice(self.build.grid, 1.0).locate(NumpyBackend(), x, y * row)
        return i, j, x, y / row

    def lenslet(self, s: State) -> State:
        return _in_lenslet(self.build, *self._locate(s["lattice_x"], s["lattice_y"]))

    def aim(self, s: State) -> State:
        di, dj, a, b = self._locate(s["a"], s["b"])
        half = 0.5 * dj if self.build.grid == "hex" else 0.0
        return {"i": s["i"] + di, "j": s["j"] + dj, "x": s["x"] - di - half, "y": s["y"] - dj, "a": a, "b": b}

    def blend(self, s: State) -> State:
        n = self.n
        x, y, a, b = (s[key] for key in "xyab")
        return {
            "mx": n.slope_x * (a - x),
            "my": n.slope_y * (b - y),
            "hx": n.point_x * x + n.point_aim_x * a,
            "hy": n.point_y * y + n.point_aim_y * b,
        }

    def unit_slope(self, s: State) -> State:
        ez = 1.0 / np.sqrt(1.0 + s["mx"] ** 2 + s["my"] ** 2)
        return {"ex": s["mx"] * ez, "ey": s["my"] * ez, "ez": ez}

    def enter_flat(self, s: State) -> State:
        dx, dy = self.n.index_inverse * s["ex"], self.n.index_inverse * s["ey"]
        return {"dx": dx, "dy": dy, "dz": np.sqrt(1.0 - dx**2 - dy**2)}

    def meet_dome(self, s: State) -> State:
        n, hexagonal, up = self.n, self.build.grid == "hex", not self.build.viewer
        i, j, hx, hy = (s[key] for key in ("i", "j", "hx", "hy"))
        dx, dy, dz = (s[key] for key in (("dx", "dy", "dz") if up else ("ex", "ey", "ez")))
        zc, rest, dz = (n.depth, n.depth_rest, dz) if up else (1.0, 0.0, -dz)

        def met() -> State:
            along = hx * dx + hy * dy + zc * dz
            square = rest - hx**2 - hy**2 + along**2
            cos = np.sqrt(np.maximum(square, 0.0))
            length = (cos if up else -cos) - along
            normal = {"nx": hx + length * dx, "ny": hy + length * dy, "nz": zc + length * dz}
            return {**normal, "cos": cos, "s": 1.0 - square}

        found = met()
        for _ in range(self.build.max_cell_steps):
            di, dj = self._cell_step(found["nx"], found["ny"])
            hx = hx - di * n.cell_pitch_x - (0.5 * dj * n.cell_pitch_x if hexagonal else 0.0)
            hy = hy - dj * n.cell_pitch_y
            i, j = i + di, j + dj
            found = met()
        return {"i": i, "j": j, **found}

    def _cell_step(self, x: Floats, y: Floats) -> tuple[Ints, Ints]:
        """Return the step to the next cell for points outside theirs, whose half width is `cell_half`."""
        half = self.n.cell_half
        if self.build.grid == "square":
            return tuple((q >= half).astype(np.int64) - (q < -half).astype(np.int64) for q in (x, y))
        q = np.stack([x, 0.5 * x + HALF_SQRT3 * y, HALF_SQRT3 * y - 0.5 * x])
        outside = ((q >= half) | (q < -half)).any(axis=0)
        first = np.abs(q).argmax(axis=0)
        sign = np.where(np.take_along_axis(q, first[None], axis=0)[0] < 0.0, -1, 1) * outside
        steps = np.array([[1, 0], [0, 1], [-1, 1]])[first] * sign[:, None]
        return steps[:, 0], steps[:, 1]

    def leave_dome(self, s: State) -> State:
        n, nx, ny, nz = self.n, s["nx"], s["ny"], s["nz"]
        bend = np.sqrt(np.maximum(1.0 - s["s"] * n.index_square, 0.0)) - n.index * s["cos"]
        return _out(nx, ny, nz - 1.0, s["ex"] + bend * nx, s["ey"] + bend * ny, n.index * s["dz"] + bend * nz)

    def enter_dome(self, s: State) -> State:
        n = self.n
        bend = np.sqrt(1.0 - s["s"] * n.index_inverse_square) - n.index_inverse * s["cos"]
        return {key: n.index_inverse * s[f"e{key[1]}"] - bend * s[f"n{key[1]}"] for key in ("dx", "dy")}

    def leave_flat(self, s: State) -> State:
        n, dx, dy = self.n, s["dx"], s["dy"]
        lateral = dx**2 + dy**2
        path = (s["nz"] - n.depth) / np.sqrt(1.0 - lateral)
        return _out(
            s["nx"] + path * dx,
            s["ny"] + path * dy,
            np.full_like(path, n.exit_z),
            n.index * dx,
            n.index * dy,
            np.sqrt(np.maximum(1.0 - lateral * n.index_square, 0.0)),
        )

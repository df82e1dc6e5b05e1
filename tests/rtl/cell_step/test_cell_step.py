"""cell_step against its twin and the definition: every step to a neighbour, edges and vertices of the cell."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.lenslet_faces import cell_step
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from steps import FRACTIONS, GRIDS, stream_step
from words import mixed, signed

STEPS = {
    "square": [f"{i} {j}" for i in (-1, 0, 1) for j in (-1, 0, 1)],
    "hex": ["0 0", "1 0", "0 1", "-1 1", "-1 0", "0 -1", "1 -1"],
}


@pytest.mark.parametrize("sheared", [False, True], ids=["upright", "sheared"])
@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, grid, sheared, seed, rng, seen):
    low, high = signed(f + 2)
    segments = []
    upright = int(np.sqrt(0.75) * (1 << (f + 1)) + 0.5)
    # Nothing lies inside a negative half pitch; no display has one, but a register may.
    ends = [low, low + 1, -high // 3, -1, 0, 1, 2, high // 3, high // 2, high - 1, high]
    for number, half in enumerate([*ends, *rng.integers(high // 20, high, 12).tolist()]):
        half_y = int(rng.choice([half, *rng.integers(high // 20, high, 2), low, high]))
        # The regular lattice; then any two pitches and shear; then any words.
        rise = [upright, int(rng.uniform(0.2, 4.0) * (1 << (f + 1))), int(rng.integers(*signed(f + 4)))][number % 3]
        lean = [0, int(rng.integers(-1 << f, 1 << f)), int(rng.integers(low, high))][number % 3]
        nx, ny = mixed(rng, 500, (low, high), (low, high))
        # Two of the distances near half a pitch: edges and vertices, ties among the largest.
        size = abs(half)
        q0, q1 = rng.choice([-size, size], (2, 500)) + rng.integers(-2, 3, (2, 500))
        if grid == "hex":
            which = rng.integers(0, 3, 500)
            q0 = np.where(which == 2, q1 - q0, q0)
            q1 = np.where(which == 1, rng.integers(-size, size, 500, endpoint=True), q1)
            q1 = np.floor((q1 - q0 / 2) * (1 << (f + 1)) / (rise or 1) + 0.5).astype(np.int64)
        elif number % 2:
            q1 = rng.choice([-1, 1], 500) * abs(half_y) + rng.integers(-2, 3, 500)
        if sheared:
            q0 = q0 + np.floor(q1 * lean / (1 << f) + 0.5).astype(np.int64)
        edge = (q0 >= low) & (q0 <= high) & (q1 >= low) & (q1 <= high)
        nx, ny = np.concatenate([nx, q0[edge]]), np.concatenate([ny, q1[edge]])
        di, dj, inside = cell_step(nx, ny, half, half_y, rise, lean, grid, f, sheared)
        expected = {"di_o": di, "dj_o": dj, "inside_o": inside}
        held = {"half_i": half, "half_y_i": half_y, "rise_i": rise, "shear_i": lean}
        segments.append(Segment(held, {"nx_i": nx, "ny_i": ny}, expected))
        seen.values("step", [f"{p} {q}" for p, q in zip(di, dj, strict=True)], STEPS[grid])
        seen.point("nothing inside", np.array([half < 0 and not inside.any()]))
        if not sheared or lean == 0:
            seen.point("on the lower edge, inside", (nx == -half) & inside)
            seen.point("on the upper edge, outside", (nx == half) & ~inside)
            seen.point("last inside", (nx == half - 1) & inside)
            seen.point("first outside", (nx == -half - 1) & ~inside)
    stream_step(f"cell_step-{grid}" + "-sheared" * sheared, f, segments, seed)


@pytest.mark.parametrize("grid", GRIDS)
def test_cells_are_those_of_the_lattice(grid, rng):
    """Points of random skewed cells, in float64: inside where the lattice has them, else towards their owner."""
    f = 23
    checked = 0
    for _ in range(40):
        ratio, lean = float(np.exp(rng.uniform(-np.log(4.0), np.log(4.0)))), rng.integers(-1 << f, 1 << f) / (1 << f)
        wide = rng.uniform(0.05, 0.45) / max(1.0, 1.0 / ratio)
        lattice = Lattice(grid, (2.0 * wide, 2.0 * wide / ratio), shear=lean)
        reach = 1.3 * np.abs(lattice.corners).max(axis=0)
        nx, ny = (np.clip(rng.uniform(-k, k, 4000), -0.99, 0.99) for k in reach)
        words = [np.floor(np.ldexp(w, f + 1) + 0.5).astype(np.int64) for w in (nx, ny)]
        rise = round((np.sqrt(0.75) * ratio - lean / 2) * (1 << (f + 1)))
        halves = (round(h * (1 << (f + 1))) for h in (wide, wide / ratio))
        di, dj, inside = cell_step(*words, *halves, rise, int(lean * (1 << f)), grid, f, True)
        i, j, *_ = lattice.locate(NumpyBackend(), nx, ny)
        # A few units of the last place from an edge either may be right.
        away = np.min([np.abs(np.abs(ax * nx + ay * ny) - lattice.half_mm) for ax, ay in lattice.axes], axis=0)
        sure = away > 2.0 ** (4 - f)
        own = (i == 0) & (j == 0)
        np.testing.assert_array_equal(inside[sure], own[sure])
        # One step is right where the owner is a neighbour across one side; both are then nearer to it.
        if grid == "square":
            near = sure & (np.abs(i) <= 1) & (np.abs(j) <= 1)
            np.testing.assert_array_equal((di[near], dj[near]), (i[near], j[near]))
        checked += int(sure.sum())
    assert checked > 100_000

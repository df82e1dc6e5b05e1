"""cell_step against its twin: every step to a neighbour, edges and vertices of the cell."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.cell_step import cell_step
from rtl_coverage import Coverage
from runner import seed
from steps import FRACTIONS, GRIDS, stream_step
from words import mixed, signed

STEPS = {
    "square": [f"{i} {j}" for i in (-1, 0, 1) for j in (-1, 0, 1)],
    "hex": ["0 0", "1 0", "0 1", "-1 1", "-1 0", "0 -1", "1 -1"],
}


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, grid):
    s = seed()
    rng = np.random.default_rng(s)
    low, high = signed(f + 2)
    seen = Coverage("cell_step", f"{grid}-F{f}")
    segments = []
    # Nothing lies inside a negative half pitch; no display has one, but a register may.
    ends = [low, low + 1, -high // 3, -1, 0, 1, 2, high // 3, high // 2, high - 1, high]
    for half in [*ends, *rng.integers(high // 20, high, 4).tolist()]:
        nx, ny = mixed(rng, 500, (low, high), (low, high))
        # Two of the distances near half a pitch: edges and vertices, ties among the largest.
        size = abs(half)
        q0, q1 = rng.choice([-size, size], (2, 500)) + rng.integers(-2, 3, (2, 500))
        if grid == "hex":
            which = rng.integers(0, 3, 500)
            q0 = np.where(which == 2, q1 - q0, q0)
            q1 = np.where(which == 1, rng.integers(-size, size, 500, endpoint=True), q1)
            q1 = np.floor((q1 - q0 / 2) / np.sqrt(0.75) + 0.5).astype(np.int64)
        edge = (q0 >= low) & (q0 <= high) & (q1 >= low) & (q1 <= high)
        nx, ny = np.concatenate([nx, q0[edge]]), np.concatenate([ny, q1[edge]])
        di, dj, inside = cell_step(nx, ny, half, grid, f)
        expected = {"di_o": di, "dj_o": dj, "inside_o": inside.astype(np.int64)}
        segments.append(Segment({"half_i": half}, {"nx_i": nx, "ny_i": ny}, expected))
        seen.values("step", [f"{p} {q}" for p, q in zip(di, dj, strict=True)], STEPS[grid])
        seen.point("nothing inside", np.array([half < 0 and not inside.any()]))
        seen.point("on the lower edge, inside", (nx == -half) & inside)
        seen.point("on the upper edge, outside", (nx == half) & ~inside)
        seen.point("last inside", (nx == half - 1) & inside)
        seen.point("first outside", (nx == -half - 1) & ~inside)
    stream_step(f"cell_step-{grid}", f, segments, s)
    seen.close()

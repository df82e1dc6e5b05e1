"""Step 5: the step from a point on the dome to the cell that it lies towards (rtl/optics/cell_step.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.display import Grid
from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.words import GUARD, Bools, Ints, guarded
from lippmann.optics.lattice import HALF_SQRT3


def cell_step(nx: Ints, ny: Ints, half: int, grid: Grid, f: int) -> tuple[Ints, Ints, Bools]:
    """Return the step (di, dj), and a mask of the points inside their own cell; near words, `half` is p / (2 R).

    Square: the sign of each coordinate that is outside [-half, half). Hexagonal: across the flat with the largest of
    |q0|, |q1|, |q2|, where q0 = nx, q1 = nx / 2 + (sqrt(3)/2) ny, q2 = q1 - nx, and |q| is ~q below 0. As integers,
    ny h >> k the product that `multiplier` cuts by k places:

        q1   = ((ny h >> F-2) + (nx << 2) + 4) >> 3,  h = floor(sqrt(3)/2 2^(F+1) + 1/2)
    """
    word = f + 2

    def side(q: Ints) -> Ints:
        return np.where(q >= half, 1, np.where(q < -half, -1, 0))

    if grid == "square":
        di, dj = side(nx), side(ny)
        return di, dj, (di == 0) & (dj == 0)
    rise = multiplier(ny, int(HALF_SQRT3 * (1 << (f + 1)) + 0.5), word, word, f + 1 - GUARD)
    q = np.stack([nx, guarded(rise + (nx << (GUARD - 1))), np.zeros_like(nx)])
    q[2] = q[1] - nx
    inside = (np.stack([side(k) for k in q]) == 0).all(axis=0)
    size = np.where(q < 0, ~q, q)
    sign = np.where(q < 0, -1, 1)
    first = np.where((size[0] >= size[1]) & (size[0] >= size[2]), 0, np.where(size[1] >= size[2], 1, 2))
    di = np.where(first == 0, sign[0], np.where(first == 2, -sign[2], 0))
    dj = np.where(first == 1, sign[1], np.where(first == 2, sign[2], 0))
    return np.where(inside, 0, di), np.where(inside, 0, dj), inside

"""Step 5: the step from a point on the dome to the cell that it lies towards (rtl/optics/lipp_cell_step.sv)."""

from __future__ import annotations

import numpy as np

from lippmann.display.description import Grid
from lippmann.fixed.multiplier import multiplier
from lippmann.fixed.words import GUARD, Bools, Ints, guarded


def cell_step(
    nx: Ints, ny: Ints, half: int, half_y: int, rise: int, lean: int, grid: Grid, f: int, shear: bool
) -> tuple[Ints, Ints, Bools]:
    """Return the step (di, dj), and a mask of the points inside their own cell.

    Near words, `half` is px / (2 R), `half_y` py / (2 R); `rise` is h = (sqrt(3)/2) px / py - s / 2, a word of W + 2
    bits and F + 1 fraction bits; `lean` is the shear s, a wide word. Square: the sign of each of q0 and q1 = ny that is
    outside [-half, half) or [-half_y, half_y). Hexagonal: across the flat with the largest of |q0|, |q1|, |q2|, where
    q1 = nx / 2 + h ny, q2 = q1 - q0, and |q| is ~q below 0. q0 is nx, in a build with `shear` nx - s ny. As integers,
    a b >> k the product that `multiplier` cuts by k places:

        q0   = ((nx << 3) - (ny s >> F-3) + 4) >> 3
        q1   = ((ny m >> F-2) + (nx << 2) + (n ny << 3) + 4) >> 3,  h = n 2^(F+1) + m

    with 0 <= m < 2^(F+1).
    """
    word = f + 2
    q0 = guarded((nx << GUARD) - multiplier(ny, lean, word, word, f - GUARD)) if shear else nx

    def side(q: Ints, half: int) -> Ints:
        return np.where(q >= half, 1, np.where(q < -half, -1, 0))

    if grid == "square":
        di, dj = side(q0, half), side(ny, half_y)
        return di, dj, (di == 0) & (dj == 0)
    whole, part = rise >> (f + 1), rise & ((1 << (f + 1)) - 1)
    climb = multiplier(ny, part, word, word, f + 1 - GUARD) + (whole * ny << GUARD)
    q = np.stack([q0, guarded(climb + (nx << (GUARD - 1))), np.zeros_like(nx)])
    q[2] = q[1] - q[0]
    inside = (np.stack([side(k, half) for k in q]) == 0).all(axis=0)
    size = np.where(q < 0, ~q, q)
    sign = np.where(q < 0, -1, 1)
    first = np.where((size[0] >= size[1]) & (size[0] >= size[2]), 0, np.where(size[1] >= size[2], 1, 2))
    di = np.where(first == 0, sign[0], np.where(first == 2, -sign[2], 0))
    dj = np.where(first == 1, sign[1], np.where(first == 2, sign[2], 0))
    return np.where(inside, 0, di), np.where(inside, 0, dj), inside

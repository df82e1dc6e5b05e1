"""converge against its twin, and against the formula in whole numbers: lenslets, shares and offsets at their ends."""

import math

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.ray_start import converge
from steps import FRACTIONS, GRIDS, stream_step
from words import mixed, signed


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, grid, seed, rng, seen):
    near, wide = signed(f + 2), signed(f + 9)
    segments = []
    # Ends of the words; then shares and offsets that leave most points of a panel in the words.
    ends = [tuple(int(w[k]) for w in mixed(rng, 12, wide, wide, wide)) for k in range(0, 137, 4)]
    fair = [(rng.integers(1 << (f + 4)), *rng.integers(-(1 << (f + 4)), 1 << (f + 4), 2)) for _ in range(20)]
    for share, ox, oy in [*ends, *fair]:
        i, j, x, y = mixed(rng, 60, signed(12), signed(12), near, near)
        shown_x, shown_y, beyond = converge(i, j, x, y, int(share), int(ox), int(oy), grid, f)
        words = {"i_i": i, "j_i": j, "x_i": x, "y_i": y}
        config = {"share_i": int(share), "offset_x_i": int(ox), "offset_y_i": int(oy)}
        segments.append(Segment(config, words, {"x_o": shown_x, "y_o": shown_y, "beyond_o": beyond}))
        # x + s (C - A), its fraction bits cut to F: two cuts of less than a quarter, and the
        # rounding of quarters.
        centres = (i + j / 2 if grid == "hex" else i, j)
        for got, point, centre, offset in zip((shown_x, shown_y), (x, y), centres, (ox, oy), strict=True):
            exact = [
                point[n] + math.ldexp(int(2 * centre[n]) * int(share), -12) + math.ldexp(int(offset), -2)
                for n in range(len(x))
            ]
            away = (got - np.array(exact))[~beyond]
            assert ((away > -0.75) & (away <= 0.5)).all()
            seen.point("cut", 4.0 * away % 1.0 != 0.0)
        seen.point("beyond", beyond)
        seen.point("within", ~beyond)
        seen.point("another pitch", ~beyond & (np.abs(shown_x) > 3 << (f - 1)))
    stream_step(f"converge-{grid}", f, segments, seed)

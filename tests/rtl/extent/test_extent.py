"""extent against its twin and the definition: every lenslet near the ends of areas of every size."""

import numpy as np
import pytest
from bench import Instance, Segment, stream
from lippmann.fixed.ray_start import extent
from steps import GRIDS
from words import mixed, signed

INSTANCES = {
    grid: Instance(
        "extent", {"i_i": 12, "j_i": 12}, {"missing_o": 1}, "lipp_optics_pkg::extent_latency()", {"Grid": number},
        {"along_i": 14, "across_i": 13},
    )
    for number, grid in enumerate(GRIDS)
}  # fmt: skip


@pytest.mark.parametrize("grid", GRIDS)
def test_equals_twin(grid, seed, rng, seen):
    one = INSTANCES[grid]
    batch = []
    limits = [w.tolist() for w in mixed(rng, 30, signed(14), signed(13))]
    for along, across in [(8191, 4095), (0, 0), (1, 0), (7, 3), *zip(*limits, strict=True)]:
        i, j = mixed(rng, 200, signed(12), signed(12))
        # The last lenslets that are there, and the first that are not.
        near_j = rng.choice([-1, 1], 400) * (across + rng.integers(-1, 3, 400))
        c = rng.choice([-1, 1], 400) * (along + rng.integers(-2, 4, 400))
        near_i = (c - (near_j if grid == "hex" else 0)) // 2
        fits = (np.abs(2 * near_i + 1) < 4096) & (np.abs(2 * near_j + 1) < 4096)
        i, j = np.r_[i, near_i[fits]], np.r_[j, near_j[fits]]
        missing = extent(i, j, along, across, grid)
        # 2 i + j half pitches: the centre's place on its row, whose lenslets are a pitch apart.
        place = i + (j / 2 if grid == "hex" else 0)
        np.testing.assert_array_equal(missing, (abs(place) > along / 2) | (abs(j) > across))
        held = {"along_i": along, "across_i": across}
        batch.append((one, Segment(held, {"i_i": i, "j_i": j}, {"missing_o": missing})))
        seen.point("no lenslet", missing.all())
        seen.point("the last along the row", ~missing & (2 * abs(place) == along))
        seen.point("the last row", ~missing & (abs(j) == across))
    stream(list(INSTANCES.values()), batch, "extent", seed)

"""test_pattern against the optics' twins, and those patterns against the display's geometry."""

import numpy as np
import pytest
from bench import Instance, Segment, stream
from lippmann.display.description import Array, Display, Panel
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.raster import holds_centre, locate_pixels, places_in_cell
from lippmann.fixed.ray_start import extent
from lippmann.simulation.harness import packed
from random_cases import configured_display

OFF, LENS, CENTRES, VIEWS, CHECKER, RAMP = range(6)
WHITE = 0xFFFFFF
GRIDS = {"square": 0, "hex": 1}


def pattern(kind, lens, config, grid, f, width, height, columns, rows):
    i, j, x, y = locate_pixels(config, grid, f, width, height, columns, rows)
    there = ~extent(i, j, config.extent_i, config.extent_j, grid)
    if kind == LENS:
        return np.where((i == lens[0]) & (j == lens[1]) & there, WHITE, 0)
    if kind == CENTRES:
        return np.where(holds_centre(config, f, x, y) & there, WHITE, 0)
    if kind == VIEWS:
        r, g = places_in_cell(grid, f, x, y)
        return np.where(there, r << 16 | g << 8, 0)
    if kind == CHECKER:
        return np.where((columns // 32 + rows // 32) % 2, WHITE, 0)
    return columns % 256 * 0x010101 if kind == RAMP else np.zeros_like(columns)


@pytest.mark.parametrize("f", [23, *(pytest.param(f, marks=pytest.mark.full) for f in (14, 17, 18))])
def test_equals_twin(f, seed, rng, seen):
    instances, batch = [], []
    for (width, height), grid in (((640, 480), "square"), ((1921, 1080), "hex"), ((2400, 2400), "hex")):
        parameters = {"Width": width, "Height": height, "F": f, "Grid": GRIDS[grid]}
        one = Instance(
            "test_pattern", {"column_i": 14, "row_i": 14}, {"rgb_o": 24},
            f"lipp_panel_pkg::pattern_latency({GRIDS[grid]})", parameters, {"pattern_i": 27, "optics_i": 1140},
        )  # fmt: skip
        instances.append(one)
        for kind in [LENS, CENTRES, VIEWS] * 4 + [CHECKER, RAMP, OFF, 6, 7]:
            _, config = configured_display(rng, Build(f, grid), "exact")
            # A stretch of rows, and pixels anywhere; the corners.
            left, top = rng.integers(width - 40), rng.integers(height - 30)
            columns, rows = (w.ravel() for w in np.meshgrid(np.arange(left, left + 40), np.arange(top, top + 30)))
            columns = np.r_[columns, rng.integers(0, width, 300), 0, width - 1, 0, width - 1]
            rows = np.r_[rows, rng.integers(0, height, 300), 0, 0, height - 1, height - 1]
            i, j, *_ = locate_pixels(config, grid, f, width, height, columns, rows)
            there = ~extent(i, j, config.extent_i, config.extent_j, grid)
            seen.point("no lenslet", ~there)
            pick = rng.choice(np.flatnonzero(there)) if there.any() else 0
            lens = int(i[pick]), int(j[pick])
            rgb = pattern(kind, lens, config, grid, f, width, height, columns, rows)
            word = kind << 24 | (lens[0] & 0xFFF) << 12 | lens[1] & 0xFFF
            optics = int.from_bytes(packed(config), "little")
            held = {"pattern_i": word, "optics_i": optics}
            batch.append((one, Segment(held, {"column_i": columns, "row_i": rows}, {"rgb_o": rgb})))
            if kind in (LENS, CENTRES, CHECKER):
                seen.point(f"{grid} {kind} white", rgb == WHITE)
                seen.point(f"{grid} {kind} black", rgb == 0)
            elif kind == VIEWS:
                seen.values("view", rgb >> 16 & 0xE0, range(0, 256, 32))
                seen.values("view", rgb >> 8 & 0xE0, range(0, 256, 32))
    stream(instances, batch, f"test_pattern-F{f}", seed)


@pytest.mark.parametrize("grid", GRIDS)
def test_a_centre_between_pixels_lights_all_that_meet_there(grid):
    # 20 pixels a pitch on an even panel: the centres of a row stand on corners of pixels.
    display = Display("case", Panel(400, 300, 0.05), Array(grid, 1.0, 2.0, 1.5, 0.8, "panel"), 1.0)
    config = configuration(display, Build(23, grid), "exact")
    rows, columns = np.indices((300, 400)).reshape(2, -1)
    i, j, x, y = locate_pixels(config, grid, 23, 400, 300, columns, rows)
    white = holds_centre(config, 23, x, y)
    row = white & (j == 0)
    assert sorted(set(rows[row])) == [149, 150]
    assert sorted(columns[row & (i == 0)]) == [199, 199, 200, 200]
    # Those at the panel's edges are halved.
    assert len(columns[row]) == 4 * (len(set(i[j == 0])) - 1)

"""tile_writer: pixels from independent encoders, bad data of every kind, and not one pixel beside the tile."""

from pathlib import Path

import pytest
from runner import compiled, seed, simulate

BENCH = Path(__file__).with_name("tile_writer_bench.sv")
FOLDERS = ("registers", "optics", "link", "panel")


@pytest.mark.parametrize(
    ("width", "height"),
    [
        (40, 33),
        (7, 5),
        *(pytest.param(*p, marks=pytest.mark.full) for p in ((72, 56), (64, 32), (33, 129), (1920, 1080))),
    ],
)
def test_tile_writer(width, height):
    parameters = {"Width": width, "Height": height}
    program = compiled("tile_writer_bench", parameters, BENCH.read_text())
    simulate(program, "tile_writer_bench", "cocotb_tile_writer", seed(), plusargs=parameters)

"""tile_writer: pixels from independent encoders, bad data of every kind, and not one pixel beside the tile."""

from pathlib import Path

import pytest
from runner import compiled, seed, simulate

BENCH = Path(__file__).with_name("tile_writer_bench.sv")
FOLDERS = ("registers", "optics", "link", "panel")


@pytest.mark.parametrize(
    ("width", "height", "latency"),
    [
        (40, 33, 4),
        (7, 5, 2),
        *(pytest.param(*p, marks=pytest.mark.full) for p in ((72, 56, 4), (64, 32, 2), (33, 129, 3), (1920, 1080, 7))),
    ],
)
def test_tile_writer(width, height, latency):
    parameters = {"Width": width, "Height": height, "ReadLatency": latency}
    program = compiled("tile_writer_bench", parameters, BENCH.read_text())
    simulate(program, "tile_writer_bench", "cocotb_tile_writer", seed(), plusargs=parameters)

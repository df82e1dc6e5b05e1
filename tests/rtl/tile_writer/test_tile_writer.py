"""tile_writer: pixels from independent encoders, bad data of every kind, and not one pixel beside the tile."""

from pathlib import Path

import pytest
from runner import run_cocotb

BENCH = Path(__file__).with_name("tile_writer_bench.sv")


@pytest.mark.parametrize(
    ("width", "height"),
    [
        (40, 33),
        (7, 5),
        *(pytest.param(*p, marks=pytest.mark.full) for p in ((72, 56), (64, 32), (33, 129), (1920, 1080))),
    ],
)
def test_tile_writer(width, height):
    run_cocotb("tile_writer_bench", {"Width": width, "Height": height}, BENCH.read_text())

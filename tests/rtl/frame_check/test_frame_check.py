"""frame_check, against zlib."""

from pathlib import Path

import pytest
from runner import run_cocotb

BENCH = Path(__file__).with_name("frame_check_bench.sv")


@pytest.mark.parametrize(("width", "height"), [(16, 8), (1, 7)])
def test_frame_check(width, height):
    run_cocotb("frame_check_bench", {"Width": width, "Height": height}, BENCH.read_text())

"""frame_check, against zlib."""

from pathlib import Path

import pytest
from runner import compiled, seed, simulate

BENCH = Path(__file__).with_name("frame_check_bench.sv")


@pytest.mark.parametrize(("width", "height"), [(9, 5), (16, 8), (1, 7)])
def test_frame_check(width, height):
    parameters = {"Width": width, "Height": height}
    program = compiled("frame_check_bench", parameters, BENCH.read_text())
    simulate(program, "frame_check_bench", "cocotb_frame_check", seed(), plusargs=parameters)

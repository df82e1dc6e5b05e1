"""frame_check, against zlib."""

from pathlib import Path

import pytest
from runner import compiled, seed, simulate

BENCH = Path(__file__).with_name("frame_check_bench.sv")


@pytest.mark.parametrize(("width", "height", "latency"), [(9, 5, 2), (16, 8, 3), (1, 7, 5)])
def test_frame_check(width, height, latency):
    parameters = {"Width": width, "Height": height, "ReadLatency": latency}
    program = compiled("frame_check_bench", parameters, BENCH.read_text())
    simulate(program, "frame_check_bench", "cocotb_frame_check", seed(), plusargs=parameters)

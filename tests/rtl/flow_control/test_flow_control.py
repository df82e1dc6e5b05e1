"""flow_control around a pipeline that only delays: order, contract, throughput and hold, under every pair of pauses."""

from pathlib import Path

import pytest
from runner import run_cocotb

BENCH = Path(__file__).with_name("flow_control_bench.sv")


@pytest.mark.parametrize(
    ("latency", "bits"), [(20, 5), *(pytest.param(*p, marks=pytest.mark.full) for p in ((1, 4), (6, 4), (118, 7)))]
)
def test_flow_control(latency, bits):
    run_cocotb("flow_control_bench", {"Latency": latency, "AddressBits": bits, "Width": 20}, BENCH.read_text())

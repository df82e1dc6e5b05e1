"""async_fifo: words between two unrelated clocks, pauses on both sides, the latencies that it promises."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize(
    ("width", "bits", "stages"),
    [(9, 4, 2), *(pytest.param(*p, marks=pytest.mark.full) for p in ((32, 2, 2), (5, 5, 3)))],
)
def test_async_fifo(width, bits, stages):
    run_cocotb("async_fifo", {"Width": width, "AddressBits": bits, "Stages": stages})

"""async_fifo: words between two unrelated clocks."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize(
    ("width", "bits", "stages"),
    [(9, 4, 2), *(pytest.param(*p, marks=pytest.mark.full) for p in ((32, 2, 2), (5, 5, 3)))],
)
def test_async_fifo(width, bits, stages):
    parameters = {"Width": width, "AddressBits": bits, "Stages": stages}
    program = compiled("async_fifo", parameters)
    simulate(program, "async_fifo", "cocotb_async_fifo", seed(), plusargs=parameters)

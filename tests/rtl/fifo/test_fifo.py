"""fifo: order, contract, throughput and reset, under every pair of pauses."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize(
    ("width", "bits"), [(36, 4), *(pytest.param(*p, marks=pytest.mark.full) for p in ((1, 3), (150, 5), (70, 9)))]
)
def test_fifo(width, bits):
    program = compiled("fifo", {"Width": width, "AddressBits": bits})
    simulate(program, "fifo", "cocotb_fifo", seed(), plusargs={"address_bits": bits, "case": f"{width}-{bits}"})

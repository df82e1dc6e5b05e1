"""skid_buffer: registers between two streams."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize("width", [9, pytest.param(185, marks=pytest.mark.full)])
def test_skid_buffer(width):
    simulate(compiled("skid_buffer", {"Width": width}), "skid_buffer", "cocotb_skid_buffer", seed())

"""block_store: three clients of two buffers, whatever they ask and however they pause."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize(("width", "height"), [(13, 7), pytest.param(64, 48, marks=pytest.mark.full)])
def test_block_store(width, height):
    parameters = {"Width": width, "Height": height}
    program = compiled("block_store", parameters)
    simulate(program, "block_store", "cocotb_block_store", seed(), plusargs=parameters)

"""block_store: three clients of two buffers, against two buffers of a dictionary, however they pause."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize(("width", "height"), [(13, 7), pytest.param(64, 48, marks=pytest.mark.full)])
def test_block_store(width, height):
    run_cocotb("block_store", {"Width": width, "Height": height})

"""reset_sync: asynchronous begin, synchronous end."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize("stages", [2, pytest.param(3, marks=pytest.mark.full)])
def test_reset_sync(stages):
    parameters = {"Stages": stages}
    program = compiled("reset_sync", parameters)
    simulate(program, "reset_sync", "cocotb_reset_sync", seed(), plusargs=parameters)

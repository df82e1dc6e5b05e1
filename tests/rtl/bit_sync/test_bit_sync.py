"""bit_sync: a bit that changes at any time of the clock, and reset."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize(("stages", "reset"), [(2, 1), (3, 1), pytest.param(4, 0, marks=pytest.mark.full)])
def test_bit_sync(stages, reset):
    parameters = {"Stages": stages, "ResetValue": reset}
    program = compiled("bit_sync", parameters)
    simulate(program, "bit_sync", "cocotb_bit_sync", seed(), plusargs=parameters)

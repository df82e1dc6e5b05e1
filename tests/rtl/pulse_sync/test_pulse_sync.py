"""pulse_sync: pulses between two unrelated clocks."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize("stages", [2, pytest.param(3, marks=pytest.mark.full)])
def test_pulse_sync(stages):
    parameters = {"Stages": stages}
    program = compiled("pulse_sync", parameters)
    simulate(program, "pulse_sync", "cocotb_pulse_sync", seed(), plusargs=parameters)

"""pulse_sync: pulses between two unrelated clocks."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize("stages", [2, pytest.param(3, marks=pytest.mark.full)])
def test_pulse_sync(stages):
    run_cocotb("pulse_sync", {"Stages": stages})

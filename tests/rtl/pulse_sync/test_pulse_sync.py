"""pulse_sync between two unrelated clocks: one pulse out for each that was accepted."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize("stages", [2, pytest.param(3, marks=pytest.mark.full)])
def test_pulse_sync(stages):
    run_cocotb("pulse_sync", {"Stages": stages})

"""bit_sync, and reset_sync: a bit that changes at any time of the clock, and reset."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize(("stages", "reset"), [(2, 1), (3, 1), pytest.param(4, 0, marks=pytest.mark.full)])
def test_bit_sync(stages, reset):
    run_cocotb("bit_sync", {"Stages": stages, "ResetValue": reset})

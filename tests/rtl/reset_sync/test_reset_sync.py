"""reset_sync: asynchronous begin, synchronous end."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize("stages", [2, pytest.param(3, marks=pytest.mark.full)])
def test_reset_sync(stages):
    run_cocotb("reset_sync", {"Stages": stages})

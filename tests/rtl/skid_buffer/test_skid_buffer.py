"""skid_buffer: registers between two streams."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize("width", [9, pytest.param(185, marks=pytest.mark.full)])
def test_skid_buffer(width):
    run_cocotb("skid_buffer", {"Width": width})

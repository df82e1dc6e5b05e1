"""show_frame: each pixel at its own place or black and counted, whatever the store does; a lost frame is black."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize(("width", "height"), [(7, 5), (1, 1), pytest.param(16, 9, marks=pytest.mark.full)])
def test_show_frame(width, height):
    run_cocotb("show_frame", {"Width": width, "Height": height})

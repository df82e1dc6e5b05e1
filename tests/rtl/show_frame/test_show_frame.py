"""show_frame: each pixel at its own place or black and counted, whatever the store does; a lost frame is black."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize(("width", "height"), [(7, 5), (1, 1), (16, 9)])
def test_show_frame(width, height):
    parameters = {"Width": width, "Height": height}
    simulate(compiled("show_frame", parameters), "show_frame", "cocotb_show_frame", seed(), plusargs=parameters)

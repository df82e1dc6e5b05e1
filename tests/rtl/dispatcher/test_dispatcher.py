"""dispatcher: every request and refusal, under pauses at all of its handshakes, against the protocol in Python."""

import pytest
from runner import run_cocotb


# A panel of more tiles than a request can name, and one of few; scenes of the least, some and the most of each.
@pytest.mark.parametrize(
    ("width", "height", "layers", "slots", "blocks"),
    [
        pytest.param(1920, 1080, 0, 1, 1, marks=pytest.mark.full),
        pytest.param(112, 80, 0, 1, 1, marks=pytest.mark.full),
        (112, 80, 3, 4, 49),
        pytest.param(112, 80, 1, 1, 2, marks=pytest.mark.full),
        pytest.param(112, 80, 8, 15, 255, marks=pytest.mark.full),
    ],
)
def test_dispatcher(width, height, layers, slots, blocks):
    parameters = {
        "Width": width, "Height": height, "ClockHz": 148_500_000, "Layers": layers, "Slots": slots, "Blocks": blocks,
    }  # fmt: skip
    run_cocotb("dispatcher", parameters)

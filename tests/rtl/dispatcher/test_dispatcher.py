"""dispatcher: every request and refusal, under pauses at all of its handshakes, against the protocol in Python."""

import pytest
from runner import compiled, seed, simulate


# A panel of more tiles than a request can name, and one of few.
@pytest.mark.parametrize(("width", "height"), [pytest.param(1920, 1080, marks=pytest.mark.full), (112, 80)])
def test_dispatcher(width, height):
    parameters = {"Width": width, "Height": height, "ClockHz": 148_500_000}
    program = compiled("dispatcher", parameters)
    simulate(program, "dispatcher", "cocotb_dispatcher", seed(), plusargs=parameters)

"""register_bus: every address, both ways, whatever time the registers take; with the scene's block and without."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize("scene", [0, 1])
def test_register_bus(scene):
    parameters = {"Scene": scene}
    program = compiled("register_bus", parameters)
    simulate(program, "register_bus", "cocotb_register_bus", seed(), plusargs=parameters)

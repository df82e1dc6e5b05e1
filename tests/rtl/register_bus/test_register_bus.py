"""register_bus: every address, both ways, whatever time the registers take; with the scene's block and without."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize("scene", [0, 1])
def test_register_bus(scene):
    run_cocotb("register_bus", {"Scene": scene})

"""register_bus: every address, both ways, whatever time the registers take."""

from runner import compiled, seed, simulate


def test_register_bus():
    program = compiled("register_bus")
    simulate(program, "register_bus", "cocotb_register_bus", seed())

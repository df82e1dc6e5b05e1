"""register_bus: every address, both ways, whatever time the registers take."""

from runner import compiled, seed, simulate


def test_register_bus():
    folder = compiled("register_bus", folders=("registers", "optics", "link", "panel", "board"))
    simulate(folder, "register_bus", "cocotb_register_bus", seed())

"""presenter: a frame is shown once, and only when all of it is right."""

from runner import compiled, seed, simulate


def test_presenter():
    program = compiled("presenter")
    simulate(program, "presenter", "cocotb_presenter", seed())

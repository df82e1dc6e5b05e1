"""presenter: a frame is shown once, and only when all of it is right."""

from runner import compiled, seed, simulate


def test_presenter():
    folder = compiled("presenter", folders=("registers", "optics", "link", "panel", "board"))
    simulate(folder, "presenter", "cocotb_presenter", seed())

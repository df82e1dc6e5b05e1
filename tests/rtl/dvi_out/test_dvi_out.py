"""dvi_out: frames of video, decoded from the bits of its wires."""

from runner import compiled, seed, simulate


def test_dvi_out():
    simulate(compiled("dvi_out"), "dvi_out", "cocotb_dvi_out", seed())

"""dvi_out: frames of video, decoded from the bits of its wires."""

from runner import run_cocotb


def test_dvi_out():
    run_cocotb("dvi_out")

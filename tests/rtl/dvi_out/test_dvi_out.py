"""dvi_out: a receiver that has only the bits of the wires finds the symbols, every pixel and every sync."""

from runner import run_cocotb


def test_dvi_out():
    run_cocotb("dvi_out")

"""tmds_serialiser: symbols to bits between two clocks of one source, at any phase."""

from runner import run_cocotb


def test_tmds_serialiser():
    run_cocotb("tmds_serialiser")

"""tmds_serialiser: symbols to bits between two clocks of one source, at any phase."""

from runner import compiled, seed, simulate


def test_tmds_serialiser():
    simulate(compiled("tmds_serialiser"), "tmds_serialiser", "cocotb_tmds_serialiser", seed())

"""tmds_encoder: every byte at every balance, and lines of video."""

from runner import compiled, seed, simulate


def test_tmds_encoder():
    simulate(compiled("tmds_encoder"), "tmds_encoder", "cocotb_tmds_encoder", seed())

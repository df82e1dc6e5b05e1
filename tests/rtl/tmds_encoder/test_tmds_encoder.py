"""tmds_encoder: every byte at every balance."""

from runner import run_cocotb


def test_tmds_encoder():
    run_cocotb("tmds_encoder")

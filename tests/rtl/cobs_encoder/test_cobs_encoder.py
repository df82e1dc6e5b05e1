"""cobs_encoder, against the cobs package."""

from runner import run_cocotb


def test_cobs_encoder():
    run_cocotb("cobs_encoder", tests="packets_out")

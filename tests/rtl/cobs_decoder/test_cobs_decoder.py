"""cobs_decoder, against the cobs package."""

from runner import run_cocotb


def test_cobs_decoder():
    run_cocotb("cobs_decoder")

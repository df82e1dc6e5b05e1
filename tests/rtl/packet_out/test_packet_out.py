"""packet_out, and cobs_encoder in it, against zlib and the cobs package."""

from runner import run_cocotb


def test_packet_out():
    run_cocotb("packet_out")

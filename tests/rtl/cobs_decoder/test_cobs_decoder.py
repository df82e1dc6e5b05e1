"""cobs_decoder, against the cobs package."""

from runner import compiled, seed, simulate


def test_cobs_decoder():
    program = compiled("cobs_decoder")
    simulate(program, "cobs_decoder", "cocotb_cobs_decoder", seed())

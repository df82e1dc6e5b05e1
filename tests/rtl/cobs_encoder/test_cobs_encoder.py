"""cobs_encoder, against the cobs package."""

from runner import compiled, seed, simulate


def test_cobs_encoder():
    program = compiled("cobs_encoder")
    simulate(program, "cobs_encoder", "packets_out", seed())

"""cobs_encoder, against the cobs package."""

from runner import compiled, seed, simulate


def test_cobs_encoder():
    folder = compiled("cobs_encoder", folders=("link",))
    simulate(folder, "cobs_encoder", "packets_out", seed())

"""cobs_decoder, against the cobs package."""

from runner import compiled, seed, simulate


def test_cobs_decoder():
    folder = compiled("cobs_decoder", folders=("link",))
    simulate(folder, "cobs_decoder", "cocotb_cobs_decoder", seed())

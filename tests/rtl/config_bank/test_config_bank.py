"""config_bank: a copy is made when asked for and nothing uses the words, after reset too; its proofs are in formal."""

from runner import compiled, seed, simulate


def test_config_bank():
    parameters = {"Width": 20}
    simulate(compiled("config_bank", parameters), "config_bank", "cocotb_config_bank", seed(), plusargs=parameters)

"""config_bank: a copy is made when asked for and nothing uses the words, after reset too; its proofs are in formal."""

from runner import run_cocotb


def test_config_bank():
    run_cocotb("config_bank", {"Width": 20})

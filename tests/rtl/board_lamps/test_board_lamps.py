"""board_lamps: how long the lamps of a board are lit, and the button of its test patterns, which bounces."""

from runner import run_cocotb


def test_board_lamps():
    run_cocotb("board_lamps", {"HoldBits": 5, "IdleBits": 4})

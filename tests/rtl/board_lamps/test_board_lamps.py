"""board_lamps: LEDs of a board, and the button of its test patterns."""

from runner import run_cocotb


def test_board_lamps():
    run_cocotb("board_lamps", {"HoldBits": 5, "IdleBits": 4})

"""buttons_and_lamps: how long the lamps of a board are lit, and the button of its test patterns, which bounces."""

from runner import run_cocotb


def test_buttons_and_lamps():
    run_cocotb("buttons_and_lamps", {"HoldBits": 5, "IdleBits": 4})

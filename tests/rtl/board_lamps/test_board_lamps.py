"""board_lamps: LEDs of a board, and the button of its test patterns."""

from runner import compiled, seed, simulate


def test_board_lamps():
    parameters = {"HoldBits": 5, "StillBits": 4}
    simulate(compiled("board_lamps", parameters), "board_lamps", "cocotb_board_lamps", seed(), plusargs=parameters)

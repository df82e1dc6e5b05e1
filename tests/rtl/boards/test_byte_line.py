"""A board on a byte stream loses nothing that a host writes while it is reset."""

from runner import compiled, seed, simulate


def test_no_byte_is_lost_at_a_reset():
    small = {"ByteLink": 1, "Width": 32, "Height": 16, "Build": "16'h000e"}
    program = compiled("board_with_store", small)
    simulate(program, "board_with_store", "cocotb_byte_line", seed())

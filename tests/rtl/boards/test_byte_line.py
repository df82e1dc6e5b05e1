"""A board on a byte stream loses nothing that a host writes while it is reset."""

from runner import run_cocotb


def test_no_byte_is_lost_at_a_reset():
    small = {"ByteLink": 1, "Width": 32, "Height": 16, "Build": "16'h000e"}
    run_cocotb("board_with_store", small, tests="cocotb_byte_line")

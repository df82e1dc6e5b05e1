"""frame_store: one port writes and two read, at once."""

from runner import run_cocotb


def test_frame_store():
    run_cocotb("frame_store", {"Width": 9, "Height": 5})

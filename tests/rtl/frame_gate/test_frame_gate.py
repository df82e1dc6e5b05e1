"""frame_gate: software's requests between the frames of two sources."""

from runner import run_cocotb


def test_frame_gate():
    run_cocotb("frame_gate")

"""frame_gate: software's requests between the frames of two sources."""

from runner import compiled, seed, simulate


def test_frame_gate():
    simulate(compiled("frame_gate"), "frame_gate", "cocotb_frame_gate", seed())

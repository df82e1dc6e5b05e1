"""frame_store: one port writes and two read, at once."""

from runner import compiled, seed, simulate


def test_frame_store():
    parameters = {"Width": 9, "Height": 5}
    program = compiled("frame_store", parameters)
    simulate(program, "frame_store", "cocotb_frame_store", seed(), plusargs=parameters)

"""frame_store: one port writes and two read, at once."""

from runner import compiled, seed, simulate


def test_frame_store():
    parameters = {"Width": 9, "Height": 5}
    folder = compiled("frame_store", parameters, folders=("registers", "optics", "panel"))
    simulate(folder, "frame_store", "cocotb_frame_store", seed(), plusargs=parameters)

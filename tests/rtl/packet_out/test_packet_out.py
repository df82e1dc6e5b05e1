"""packet_out, against zlib and the cobs package."""

from runner import compiled, seed, simulate


def test_packet_out():
    folder = compiled("packet_out", folders=("link",))
    simulate(folder, "packet_out", "packets_out", seed())

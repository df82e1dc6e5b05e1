"""packet_out, against zlib and the cobs package."""

from runner import compiled, seed, simulate


def test_packet_out():
    program = compiled("packet_out")
    simulate(program, "packet_out", "packets_out", seed())

"""ray_signature, against zlib."""

from runner import compiled, seed, simulate


def test_ray_signature():
    program = compiled("ray_signature")
    simulate(program, "ray_signature", "cocotb_ray_signature", seed())

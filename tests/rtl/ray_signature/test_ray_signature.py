"""ray_signature, against zlib."""

from runner import compiled, seed, simulate


def test_ray_signature():
    folder = compiled("ray_signature", folders=("registers", "optics", "link", "panel", "board"))
    simulate(folder, "ray_signature", "cocotb_ray_signature", seed())

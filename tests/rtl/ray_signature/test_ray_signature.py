"""ray_signature, against zlib."""

from runner import run_cocotb


def test_ray_signature():
    run_cocotb("ray_signature")

"""presenter beside a frame_check and a scan_out: a frame is shown once, and only when all of it is right."""

from runner import run_cocotb


def test_presenter():
    run_cocotb("presenter")

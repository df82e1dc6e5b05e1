"""scan_out: every clock of small frames, and the timing of real ones."""

from pathlib import Path

import pytest
from runner import run_cocotb

BENCH = Path(__file__).with_name("scan_out_bench.sv").read_text()
TIMINGS = ("Width", "HFront", "HSync", "HBack", "Height", "VFront", "VSync", "VBack", "HPositive", "VPositive")


@pytest.mark.parametrize(
    ("timing", "grid", "clocks"),
    [
        ((70, 3, 5, 4, 35, 2, 3, 1, 1, 0), 0, 1),
        ((70, 3, 5, 4, 35, 2, 3, 1, 0, 1), 1, 2),
        ((7, 0, 14, 0, 2, 1, 1, 0, 0, 0), 0, 1),
        ((7, 0, 14, 0, 2, 1, 1, 0, 1, 1), 1, 1),
        ((7, 0, 4, 0, 2, 1, 1, 0, 1, 1), 0, 4),
    ],
    ids=["small-square", "small-hex-2", "tiny-square", "tiny-hex", "tiny-square-4"],
)
def test_every_clock(timing, grid, clocks):
    parameters = {**dict(zip(TIMINGS, timing, strict=True)), "Grid": grid, "ClocksPerPixel": clocks}
    run_cocotb("scan_out_bench", parameters, BENCH, f"scan_out-{timing[0]}-{grid}-{clocks}")


@pytest.mark.parametrize(
    "timing",
    [
        (1920, 88, 44, 148, 1080, 4, 5, 36, 1, 1),
        pytest.param((640, 16, 96, 48, 480, 10, 2, 33, 0, 0), marks=pytest.mark.full),
        pytest.param((2400, 48, 32, 80, 2400, 3, 10, 55, 1, 0), marks=pytest.mark.full),
    ],
    ids=["1920x1080", "640x480", "2400x2400"],
)
def test_real_timing(timing):
    parameters = dict(zip(TIMINGS, timing, strict=True))
    run_cocotb("scan_out_bench", parameters, BENCH, f"scan_out-{timing[0]}", tests="cocotb_video_timing")

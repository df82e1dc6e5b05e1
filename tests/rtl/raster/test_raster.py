"""raster, against its twin."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize("f", [14, 23])
def test_raster_equals_the_twin(f):
    run_cocotb("raster", {"F": f}, environment={"RASTER_F": str(f)}, tests="raster_frames")


@pytest.mark.full
def test_raster_with_the_most_samples():
    run_cocotb("raster", {"F": 23}, environment={"RASTER_F": "23", "RASTER_LONG": "1"}, tests="raster_frames")

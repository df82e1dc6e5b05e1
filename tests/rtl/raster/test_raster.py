"""raster, against its twin."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize("f", [14, 23])
def test_raster_equals_the_twin(f):
    program = compiled("raster", {"F": f})
    simulate(program, "raster", "raster_frames", seed(), {"RASTER_F": str(f)})


@pytest.mark.full
def test_raster_with_the_most_samples():
    program = compiled("raster", {"F": 23})
    simulate(program, "raster", "raster_frames", seed(), {"RASTER_F": "23", "RASTER_LONG": "1"})

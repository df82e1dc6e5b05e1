"""tile_table: clear after reset, then a memory of both buffers."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize(("width", "height"), [(72, 56), (7, 5)])
def test_tile_table(width, height):
    parameters = {"Width": width, "Height": height}
    program = compiled("tile_table", parameters)
    simulate(program, "tile_table", "cocotb_tile_table", seed(), plusargs=parameters)

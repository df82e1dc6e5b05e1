"""tile_table: clear after reset, then a memory of both buffers."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize(("width", "height"), [(72, 56), (7, 5)])
def test_tile_table(width, height):
    run_cocotb("tile_table", {"Width": width, "Height": height})

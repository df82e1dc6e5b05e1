"""sdram_splitter: requests for pixels to transactions of the SDRAM."""

import pytest
from runner import run_cocotb

PARAMETERS = ("Width", "Height", "Block", "Budget", "MaxBudget")


@pytest.mark.parametrize(
    "values", [(34, 60, 96, 384, 384), (64, 48, 48, 0, 105), (34, 110, 512, 1536, 1536), (6, 5, 7, 24, 24)]
)
def test_sdram_splitter(values):
    run_cocotb("sdram_splitter", dict(zip(PARAMETERS, values, strict=True)))

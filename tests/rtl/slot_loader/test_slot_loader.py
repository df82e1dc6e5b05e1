"""slot_loader: every byte of random blocks at its place, and the table of their CRCs."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize(
    ("slots", "blocks"),
    [(5, 49), pytest.param(1, 2, marks=pytest.mark.full), pytest.param(15, 256, marks=pytest.mark.full)],
)
def test_slot_loader(slots, blocks):
    run_cocotb("slot_loader", {"Slots": slots, "Blocks": blocks})

"""slot_loader: every byte of random blocks at its place, and the table of their CRCs."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize(
    ("slots", "blocks"),
    [(5, 49), pytest.param(1, 2, marks=pytest.mark.full), pytest.param(15, 256, marks=pytest.mark.full)],
)
def test_slot_loader(slots, blocks):
    parameters = {"Slots": slots, "Blocks": blocks}
    program = compiled("slot_loader", parameters)
    simulate(program, "slot_loader", "cocotb_slot_loader", seed(), plusargs=parameters)

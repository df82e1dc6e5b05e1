"""reset_sync in the simulator: resets that begin and end at any time."""

import random

import cocotb
from cocotb.triggers import FallingEdge, RisingEdge, Timer
from cocotb.utils import get_sim_time
from two_clocks import start

STAGES = int(cocotb.plusargs["Stages"])


@cocotb.test()
async def begins_at_once_and_ends_with_an_edge(dut):
    # Before the clock runs.
    dut.clk_i.value, dut.rst_ni.value = 0, 1
    await Timer(11, "ps")
    dut.rst_ni.value = 0
    await Timer(1, "ps")
    assert dut.rst_no.value == 0
    half_ps = 2 * random.randrange(500, 3000)
    start(dut.clk_i, half_ps)
    for turn in range(60):
        wait = random.randrange(1, 6 * half_ps)
        await Timer(wait + (get_sim_time("ps") + wait + 1) % 2, "ps")  # on an odd picosecond
        assert dut.rst_no.value == 0
        dut.rst_ni.value = 1
        # Now and then a reset comes back before the one before it has ended.
        for edge in range(1, 3 * STAGES if turn % 3 else random.randrange(1, 3 * STAGES)):
            await RisingEdge(dut.clk_i)
            before = dut.rst_no.value
            await FallingEdge(dut.clk_i)
            assert dut.rst_no.value == (edge >= STAGES), f"edge {edge}"
            assert before == (edge > STAGES)
        wait = random.randrange(1, 2 * half_ps)
        await Timer(wait + (get_sim_time("ps") + wait + 1) % 2, "ps")
        dut.rst_ni.value = 0
        await Timer(2, "ps")
        assert dut.rst_no.value == 0

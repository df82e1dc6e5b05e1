import random

import cocotb
from cocotb.triggers import FallingEdge, RisingEdge, Timer
from cocotb.utils import get_sim_time
from two_clocks import start

STAGES = int(cocotb.plusargs["Stages"])
RESET = int(cocotb.plusargs.get("ResetValue", 0))


@cocotb.test()
async def q_is_d_at_the_edge_some_clocks_ago(dut):
    half_ps = 2 * random.randrange(500, 3000)
    dut.rst_ni.value, dut.d_i.value = 0, 1 - RESET
    start(dut.clk_i, half_ps)
    for _ in range(3):
        await RisingEdge(dut.clk_i)
        await Timer(1, "ps")
        assert dut.q_o.value == RESET
    dut.rst_ni.value = 1
    changes = [(0, RESET), (get_sim_time("ps"), 1 - RESET)]  # reset fills the registers
    edges = []

    async def change():
        level = 1 - RESET
        while True:
            # Mostly longer than a clock, now and then a spike.
            wait = random.randrange(half_ps // 4, 8 * half_ps)
            await Timer(wait + (get_sim_time("ps") + wait + 1) % 2, "ps")  # on an odd picosecond
            level = 1 - level
            dut.d_i.value = level
            changes.append((get_sim_time("ps"), level))

    cocotb.start_soon(change())
    seen = set()
    for _ in range(600):
        await RisingEdge(dut.clk_i)
        edges.append(get_sim_time("ps"))
        await FallingEdge(dut.clk_i)
        at = edges[-STAGES] if len(edges) >= STAGES else 0
        wanted = [level for time, level in changes if time < at or time == 0][-1]
        assert dut.q_o.value == wanted, f"edge {len(edges)}"
        seen.add(wanted)
    assert seen == {0, 1}
    dut.rst_ni.value = 0
    await Timer(1, "ps")
    assert dut.q_o.value == RESET

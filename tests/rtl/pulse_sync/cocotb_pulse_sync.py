import random

import cocotb
from cocotb.triggers import FallingEdge, Timer
from cocotb.utils import get_sim_time
from two_clocks import RATIOS, periods, start

STAGES = int(cocotb.plusargs["Stages"])
PULSES = 60


@cocotb.test()
@cocotb.parametrize(ratio=RATIOS)
async def each_accepted_pulse_comes_out_once(dut, ratio):
    halves = periods(ratio)
    dut.from_rst_ni.value = dut.to_rst_ni.value = dut.from_pulse_i.value = 0
    start(dut.from_clk_i, halves[0])
    start(dut.to_clk_i, halves[1])
    await Timer(8 * max(halves), "ps")
    await FallingEdge(dut.from_clk_i)
    dut.from_rst_ni.value = dut.to_rst_ni.value = 1
    accepted, out, ignored = [], [], 0

    async def collect():
        while True:
            await FallingEdge(dut.to_clk_i)
            if dut.to_pulse_o.value:
                out.append(get_sim_time("ps"))

    cocotb.start_soon(collect())
    # Sparse, as soon as it is free, and always.
    for share in (0.1, 0.5, 1.0):
        wanted = len(accepted) + PULSES // 3
        busy = 0
        while len(accepted) < wanted:
            await FallingEdge(dut.from_clk_i)
            pulse = random.random() < share
            dut.from_pulse_i.value = pulse
            free = not dut.from_busy_o.value
            if pulse and free:
                accepted.append(get_sim_time("ps") + halves[0])  # the edge that takes it
            ignored += pulse and not free
            busy = 0 if free else busy + 1
            # There and back: Stages edges and one on each side, and one more for the phases.
            assert busy <= (STAGES + 1) * (1 + halves[1] / halves[0]) + 2
    await FallingEdge(dut.from_clk_i)
    dut.from_pulse_i.value = 0
    await Timer(2 * (STAGES + 3) * sum(halves), "ps")
    assert len(out) == len(accepted) == PULSES
    assert ignored > 0
    for into, seen in zip(accepted, out, strict=True):
        # Seen half a clock after the edge that brought it: the Stages-th behind the change, or the next.
        late = (seen - halves[1] - into) / (2 * halves[1])
        assert STAGES - 1 <= late <= STAGES, late
    assert not dut.from_busy_o.value

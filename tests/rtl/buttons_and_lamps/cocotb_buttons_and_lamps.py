import random

import cocotb
from cocotb.triggers import FallingEdge
from streams import start_and_reset

HOLD, STILL = 1 << int(cocotb.plusargs["HoldBits"]), 1 << int(cocotb.plusargs["IdleBits"])


async def begin(dut):
    dut.packet_i.value = dut.error_i.value = dut.clock_lost_i.value = dut.button_i.value = 0
    await start_and_reset(dut)
    await FallingEdge(dut.clk_i)


@cocotb.test()
@cocotb.parametrize(pulse=["packet_i", "error_i"])
async def a_pulse_lights_its_lamp(dut, pulse):
    await begin(dut)
    lamp, other = (dut.linked_o, dut.alarm_o) if pulse == "packet_i" else (dut.alarm_o, dut.linked_o)
    last = None
    seen = set()
    for clock in range(40 * HOLD):
        given = random.randrange(2 * HOLD) == 0
        getattr(dut, pulse).value = int(given)
        last = clock if given else last
        await FallingEdge(dut.clk_i)
        lit = last is not None and clock - last < HOLD
        assert lamp.value == lit, f"{clock}, pulse at {last}"
        assert other.value == 0
        seen.add(lit)
    assert seen == {True, False}
    dut.clock_lost_i.value = 1
    for _ in range(3 * HOLD):
        await FallingEdge(dut.clk_i)
        assert dut.alarm_o.value == 1


@cocotb.test()
async def each_press_takes_the_next_pattern(dut):
    await begin(dut)
    for press in range(1, 14):
        for level in (1, 0):
            for _ in range(random.randrange(1, 9)):  # it bounces, each time for less than it must be still
                dut.button_i.value = random.getrandbits(1)
                for _ in range(random.randrange(1, STILL - 1)):
                    await FallingEdge(dut.clk_i)
                dut.button_i.value = 1 - level
                await FallingEdge(dut.clk_i)
            before = int(dut.pattern_o.value)
            assert before == (press - level) % 6
            dut.button_i.value = level
            for _ in range(STILL + 4):
                await FallingEdge(dut.clk_i)
            assert dut.pattern_o.value == press % 6

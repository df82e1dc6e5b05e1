"""tmds_encoder in the simulator, against the flow chart of DVI 1.0; dvi_out decodes its lines of video."""

import random
from collections import deque

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge
from tmds import by_the_flow_chart

LATENCY = 3
#: DVI 1.0, section 3.2.3: the four control symbols, bit 9 first.
CONTROL = [0b1101010100, 0b0010101011, 0b0101010100, 0b1010101011]


async def encoded(dut, inputs):
    """The symbols of a list of bytes (0 to 255) and controls (256 to 259)."""
    symbols = []
    for one in [*inputs, *[256] * LATENCY]:
        dut.de_i.value = one < 256
        dut.data_i.value = one & 255 if one < 256 else random.getrandbits(8)
        dut.control_i.value = one & 3 if one >= 256 else random.getrandbits(2)
        await FallingEdge(dut.clk_i)
        symbols.append(int(dut.symbol_o.value))
    return symbols[LATENCY - 1 :][: len(inputs)]


async def begin(dut):
    dut.rst_ni.value = 0
    dut.de_i.value = dut.data_i.value = dut.control_i.value = 0
    cocotb.start_soon(Clock(dut.clk_i, 4, "ns").start())
    for _ in range(3):
        await FallingEdge(dut.clk_i)
    assert int(dut.symbol_o.value) == CONTROL[0]
    dut.rst_ni.value = 1


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def every_byte_at_every_balance(dut):
    await begin(dut)
    ways, waiting = {0: []}, deque([0])  # bytes that lead from a control symbol to each balance
    while waiting:
        count = waiting.popleft()
        for byte in range(256):
            reached = by_the_flow_chart(byte, count)[1]
            if reached not in ways:
                ways[reached] = [*ways[count], byte]
                waiting.append(reached)
    assert sorted(ways) == list(range(-8, 9, 2)), "the range that the module states, in whole ones and zeros"
    for count, way in ways.items():
        inputs = [one for byte in range(256) for one in (256, *way, byte)]
        symbols = await encoded(dut, inputs)
        for byte in range(256):
            assert symbols[(byte + 1) * (len(way) + 2) - 1] == by_the_flow_chart(byte, count)[0], (count, byte)

"""uart_tx in the simulator."""

import random
from math import ceil, floor

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge
from streams import PATTERNS, pattern


async def send(dut, step, words, idle, clocks):
    """The line at each clock, and the clocks at which the words were taken."""
    Clock(dut.clk_i, 2, unit="ns").start()
    dut.valid_i.value, dut.data_i.value, dut.step_i.value, dut.rst_ni.value = 0, 0, step, 0
    for _ in range(3):
        await FallingEdge(dut.clk_i)
    dut.rst_ni.value = 1
    line, taken, offered = [], [], False
    for now in range(clocks):
        offered = offered or (len(taken) < len(words) and next(idle))
        dut.valid_i.value = offered
        if offered:
            dut.data_i.value = words[len(taken)]
        line.append(int(dut.tx_o.value))
        if offered and dut.ready_o.value:
            taken.append(now)
            offered = False
        await FallingEdge(dut.clk_i)
    assert len(taken) == len(words)
    return line, taken


def check(line, first, levels, clocks):
    """From clock `first` on, bits that are `clocks` long have these levels, to a clock at each edge."""
    for k, level in enumerate(levels):
        begin, end = first + k * clocks, first + (k + 1) * clocks
        inside = line[ceil(begin) + 1 : floor(end) - 1]
        assert inside
        assert set(inside) == {level}, f"bit {k}"


def levels(byte):
    return [0, *((byte >> k) & 1 for k in range(8)), 1]


@cocotb.test()
@cocotb.parametrize(clocks=[4.0, 8.0, 8.68, 33.33, 104.17])
async def keeps_the_rate_without_pauses(dut, clocks):
    step = round(65536 / clocks)
    words = [0x00, 0xFF, 0x55, 0xAA, *random.randbytes(60)]
    length = ceil(10 * len(words) * 65536 / step)
    line, taken = await send(dut, step, words, pattern("always", random, 0), length + 40)
    assert taken[0] + 1 == line.index(0)
    bits = [level for byte in words for level in levels(byte)]
    now = line[taken[0] + 1 :][: length - 1]
    assert now == [bits[t * step >> 16] for t in range(length - 1)]
    assert set(line[taken[0] + length + 2 :]) == {1}


@cocotb.test()
@cocotb.parametrize(idle=PATTERNS)
async def sends_what_it_took(dut, idle):
    step = random.randrange(3000, 12000)
    words = list(random.randbytes(80))
    line, taken = await send(dut, step, words, pattern(idle, random, 100), ceil(12 * len(words) * 65536 / step) + 3000)
    assert set(line[: taken[0] + 1]) == {1}
    for k, (byte, at) in enumerate(zip(words, taken, strict=True)):
        # Behind another byte, its rate goes on: a clock more or less.
        check(line, at + 1, levels(byte), 65536 / step)
        until = taken[k + 1] + 1 if k + 1 < len(words) else len(line)
        assert set(line[at + 2 + ceil(9 * 65536 / step) : until]) == {1}

"""word_split in the simulator: parts in their order, under every pair of pauses, one each clock."""

import random

import cocotb
from streams import PAIRS, pattern, start_and_reset, watched

PARTS = int(cocotb.plusargs["Parts"])


async def start(dut):
    dut.in_valid_i.value = dut.out_ready_i.value = dut.in_data_i.value = 0

    monitor = watched(dut, through=True)
    await start_and_reset(dut)
    await monitor.edge
    return monitor, [random.getrandbits(len(dut.in_data_i)) for _ in range(100)]


async def run(monitor, words, idle, pressure):
    """Offer words and take parts; the output follows the input in the same clock, so that the bench looks after it."""
    dut_valid, parts, sent, offered, waited = monitor.valid_o, [], 0, False, 0
    while sent < len(words):
        offered = offered or next(idle)
        take = next(pressure)
        if offered:
            monitor.put(words[sent])
        monitor.valid_i.value, monitor.ready_i.value = offered, take
        await cocotb.triggers.ReadOnly()
        valid = bool(dut_valid.value)
        assert valid == offered
        if valid and take:
            parts.append(int(monitor.data_o.value))
            waited = 0
        waited += 1
        assert waited < 300
        into = offered and bool(monitor.ready_o.value)
        await monitor.edge
        monitor.clocks += 1
        if into:
            sent, offered = sent + 1, False
    return parts


def split(words, width):
    return [word >> width * (PARTS - 1 - k) & ((1 << width) - 1) for word in words for k in range(PARTS)]


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS))
async def splits_in_order(dut, idle, pressure):
    monitor, words = await start(dut)
    parts = await run(monitor, words, pattern(idle, random, 8), pattern(pressure, random, 8))
    assert parts == split(words, len(dut.out_data_o))
    assert monitor.clocks == len(parts) or (idle, pressure) != ("always", "always")

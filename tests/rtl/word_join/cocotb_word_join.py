"""word_join in the simulator: parts in their order, under every pair of pauses, one each clock."""

import random

import cocotb
from streams import PAIRS, pattern, start_and_reset, watched

PARTS = int(cocotb.plusargs["Parts"])


async def start(dut):
    dut.in_valid_i.value = dut.out_ready_i.value = dut.in_data_i.value = 0

    monitor = watched(dut, through=True)
    await start_and_reset(dut)
    await monitor.edge
    assert not dut.out_valid_o.value
    return monitor, [random.getrandbits(len(dut.in_data_i)) for _ in range(100 * PARTS)]


def joined(words, width):
    """Wide words, the first of each group the highest part."""
    groups = [words[k : k + PARTS] for k in range(0, len(words), PARTS)]
    return [sum(word << width * (PARTS - 1 - k) for k, word in enumerate(group)) for group in groups]


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS))
async def joins_in_order(dut, idle, pressure):
    monitor, words = await start(dut)
    wanted = joined(words, len(dut.in_data_i))
    await monitor.run(words, pattern(idle, random, 8), pattern(pressure, random, 8), 300, count=len(wanted))
    assert monitor.got == wanted
    if idle == pressure == "always":
        assert monitor.accepted == list(range(monitor.accepted[0], monitor.accepted[0] + len(words)))
        assert monitor.left == [clock + 1 for clock in monitor.accepted[PARTS - 1 :: PARTS]]

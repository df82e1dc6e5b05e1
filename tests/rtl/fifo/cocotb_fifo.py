import random

import cocotb
from cocotb.clock import Clock
from rtl_coverage import Coverage
from streams import PAIRS, Monitor, hold_reset, pattern

SEEN = Monitor.seen


async def start(dut, room):
    Clock(dut.clk_i, 2, unit="ns").start()
    dut.write_i.value = dut.ready_i.value = dut.data_i.value = 0
    monitor = Monitor(dut.clk_i, dut.write_i, None, dut.valid_o, dut.ready_i, dut.data_o, dut.data_i, room)
    await reset(dut, monitor)
    return monitor


async def reset(dut, monitor):
    await hold_reset(dut)
    assert not dut.valid_o.value
    monitor.forget()


def sizes(dut):
    width, room = len(dut.data_i), 1 << int(cocotb.plusargs["AddressBits"])
    return room, [random.getrandbits(width) for _ in range(12 * room + 200)]


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS))
async def keeps_order_and_contract(dut, idle, pressure):
    room, words = sizes(dut)
    monitor = await start(dut, room)
    await monitor.run(words, pattern(idle, random, 3 * room), pattern(pressure, random, 3 * room), 8 * room + 200)
    assert monitor.got == words
    if idle == "always" and pressure in ("always", "stuck"):  # a word each clock, also of those that waited
        assert monitor.left == list(range(monitor.left[0], monitor.left[0] + len(words)))
    if idle == pressure == "always":
        assert {out - into for into, out in zip(monitor.accepted, monitor.left, strict=True)} == {4}
    SEEN["full"] += sum(
        k + room < len(words) and monitor.accepted[k + room - 1] < monitor.left[k] for k in range(len(words) - room)
    )


@cocotb.test()
async def forgets_all_at_reset(dut):
    room, words = sizes(dut)
    monitor = await start(dut, room)
    for count in (1, 2, 3, 4, 5, room):
        for word in words[:count]:
            await monitor.clock(word, random.random() < 0.2)
        await reset(dut, monitor)
        await monitor.run(words[: 2 * room], pattern("light", random, 0), pattern("light", random, 0), 200 + 8 * room)
        assert monitor.got == words[: 2 * room]


@cocotb.test()
async def coverage_is_complete(dut):
    Coverage("fifo", f"{len(dut.data_i)}-{cocotb.plusargs['AddressBits']}", SEEN).close()

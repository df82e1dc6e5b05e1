import random

import cocotb
from rtl_coverage import Coverage
from streams import PAIRS, Monitor, pattern, start_and_reset

SEEN = Monitor.seen


async def start(dut, room):
    dut.write_i.value = dut.ready_i.value = dut.data_i.value = 0
    monitor = Monitor(dut.clk_i, dut.write_i, None, dut.valid_o, dut.ready_i, dut.data_o, dut.data_i, room)
    await start_and_reset(dut)
    assert not dut.valid_o.value
    return monitor


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
async def coverage_is_complete(dut):
    Coverage("fifo", f"{len(dut.data_i)}-{cocotb.plusargs['AddressBits']}", SEEN).close()

import random

import cocotb
from cocotb.clock import Clock
from rtl_coverage import Coverage
from streams import PAIRS, Monitor, pattern

LATENCY = int(cocotb.plusargs["Latency"])
ROOM = 1 << int(cocotb.plusargs["AddressBits"])
PATIENCE = 8 * ROOM + 4 * LATENCY + 200
SEEN = Monitor.seen


async def start(dut):
    Clock(dut.clk_i, 2, unit="ns").start()
    dut.valid_i.value = dut.ready_i.value = dut.data_i.value = dut.hold_i.value = 0
    monitor = Monitor(dut.clk_i, dut.valid_i, dut.ready_o, dut.valid_o, dut.ready_i, dut.data_o, dut.data_i)
    dut.rst_ni.value = 0
    # The first edge of a simulation may come before any of the clock's rising ones.
    await monitor.edge
    for _ in range(3):
        await monitor.edge
        assert not dut.valid_o.value
        assert not dut.ready_o.value, "a ray that came now would be lost"
    dut.rst_ni.value = 1
    # A clock in which nothing is offered: the input opens.
    await monitor.clock(None, False)
    assert dut.idle_o.value
    return monitor


def some_words(dut, count):
    return [random.getrandbits(len(dut.data_i)) for _ in range(count)]


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS))
async def keeps_order_and_contract(dut, idle, pressure):
    monitor = await start(dut)
    words = some_words(dut, 8 * ROOM + 100)
    stuck = 2 * ROOM + LATENCY
    await monitor.run(words, pattern(idle, random, stuck), pattern(pressure, random, stuck), PATIENCE)
    assert monitor.got == words
    assert dut.idle_o.value
    if idle == pressure == "always":  # a word each clock; Latency clocks to the FIFO and four through it
        assert monitor.accepted == list(range(monitor.accepted[0], monitor.accepted[0] + len(words)))
        assert {out - into for into, out in zip(monitor.accepted, monitor.left, strict=True)} == {LATENCY + 4}


@cocotb.test()
async def has_room_for_as_many_as_it_says(dut):
    monitor = await start(dut)
    words = some_words(dut, ROOM + 50)
    for _ in range(2 * ROOM + 2 * LATENCY):
        await monitor.clock(words[len(monitor.accepted)], False)
    # One or two places are held back for words that are accepted meanwhile.
    assert ROOM - 2 <= len(monitor.accepted) <= ROOM
    held = len(monitor.accepted)
    for _ in range(held):
        await monitor.clock(None, True)
    assert monitor.got == words[:held], "a full FIFO gives a word each clock"
    SEEN["full"] += 1


@cocotb.test()
async def hold_closes_the_input_and_idle_tells_when_all_have_left(dut):
    monitor = await start(dut)
    for round_ in range(4):
        words = some_words(dut, 4 * ROOM)
        before = len(monitor.got)
        for word in words[: ROOM // 2 + round_]:
            await monitor.clock(word, random.random() < 0.5)
        # The clock in which hold rises may still take a ray.
        dut.hold_i.value = 1
        await monitor.clock(words[ROOM // 2 + round_], random.random() < 0.5)
        assert len(monitor.accepted) == before + ROOM // 2 + round_ + 1
        accepted = len(monitor.accepted)
        left = []  # rays that had left, in the last clocks
        for _ in range(PATIENCE):
            left = [*left[-2:], len(monitor.left)]
            await monitor.clock(None, random.random() < 0.5)
            assert not dut.ready_o.value
            # A ray that leaves is told three clocks later.
            assert len(left) < 3 or bool(dut.idle_o.value) == (left[0] == len(monitor.accepted))
        assert len(monitor.accepted) == len(monitor.left) == accepted
        assert monitor.got[before:] == words[: accepted - before]
        dut.hold_i.value = 0
        await monitor.clock(None, True)
        SEEN["held"] += 1


@cocotb.test()
async def coverage_is_complete(dut):
    Coverage("flow_control", f"{LATENCY}-{ROOM}", SEEN).close()

"""skid_buffer in the simulator: order, contract and throughput, under every pair of pauses."""

import random

import cocotb
from cocotb.clock import Clock
from rtl_coverage import Coverage
from streams import PAIRS, Monitor, pattern, watched

SEEN = Monitor.seen


async def start(dut):
    Clock(dut.clk_i, 2, unit="ns").start()
    dut.in_valid_i.value = dut.out_ready_i.value = dut.in_data_i.value = dut.clear_i.value = 0
    monitor = watched(dut)
    dut.rst_ni.value = 0
    await monitor.edge  # the simulator may begin with this value: then only a clock's edge resets
    for _ in range(3):
        await monitor.edge
        assert not dut.in_ready_o.value
        assert not dut.out_valid_o.value
    dut.rst_ni.value = 1
    await monitor.edge
    return monitor, [random.getrandbits(len(dut.in_data_i)) for _ in range(300)]


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS))
async def keeps_order_and_contract(dut, idle, pressure):
    monitor, words = await start(dut)
    await monitor.run(words, pattern(idle, random, 8), pattern(pressure, random, 8), 200)
    assert monitor.got == words
    # Two places: a third word waits outside.
    inside = [sum(at <= clock for at in monitor.accepted) - sum(at <= clock for at in monitor.left)
              for clock in range(monitor.clocks)]  # fmt: skip
    assert max(inside) <= 2
    SEEN["two words inside"] += inside.count(2)
    if idle == pressure == "always":
        assert {out - into for into, out in zip(monitor.accepted, monitor.left, strict=True)} == {1}
        assert monitor.left == list(range(monitor.left[0], monitor.left[0] + len(words)))


@cocotb.test()
async def no_path_leads_through(dut):
    """Within a clock neither output follows an input."""
    monitor, words = await start(dut)
    for word in words:
        await monitor.clock(word if random.random() < 0.6 else None, random.random() < 0.5)
        was = bool(dut.in_ready_o.value), bool(dut.out_valid_o.value), int(dut.out_data_o.value)
        for _ in range(4):
            dut.in_valid_i.value, dut.out_ready_i.value = random.getrandbits(1), random.getrandbits(1)
            dut.in_data_i.value = random.getrandbits(len(dut.in_data_i))
            await cocotb.triggers.Timer(10, "ps")
            assert (bool(dut.in_ready_o.value), bool(dut.out_valid_o.value), int(dut.out_data_o.value)) == was
        monitor.driven = None


@cocotb.test()
async def clear_drops_what_is_inside_and_what_comes(dut):
    """From the next clock on the buffer is empty and ready; later words pass in order."""
    monitor, words = await start(dut)
    for inside in (0, 1, 2):
        for coming in (False, True):
            for pulling in (False, True):
                for word in words[:inside]:
                    await monitor.clock(word, False)
                dut.in_valid_i.value, dut.out_ready_i.value, dut.clear_i.value = coming, pulling, 1
                dut.in_data_i.value = words[2]
                await monitor.edge
                dut.clear_i.value = dut.in_valid_i.value = 0
                await cocotb.triggers.Timer(10, "ps")
                assert (bool(dut.in_ready_o.value), bool(dut.out_valid_o.value)) == (True, False)
                monitor = watched(dut)
                await monitor.run(words[:20], pattern("bursts", random, 8), pattern("bursts", random, 8), 100)
                assert monitor.got == words[:20]
                SEEN["cleared with two inside"] += inside == 2


@cocotb.test()
async def coverage_is_complete(dut):
    Coverage("skid_buffer", f"{len(dut.in_data_i)}", SEEN).close()

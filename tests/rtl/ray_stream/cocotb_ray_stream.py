"""ray_stream in the simulator: what went in, what must come out under each of two displays."""

import json
import os
import random
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from rtl_coverage import Coverage
from streams import PAIRS, PATTERNS, Monitor, pattern

PLAN = json.loads(Path(os.environ["LIPPMANN_PLAN"]).read_text())
RAYS = PLAN["rays"]
EXITS = PLAN["exits"]  # of each display
DISPLAYS = PLAN["displays"]
SEEN = Monitor.seen


async def start(dut):
    Clock(dut.clk_i, 2, unit="ns").start()
    dut.valid_i.value = dut.ready_i.value = dut.ray_i.value = dut.apply_i.value = 0
    dut.config_i.value = DISPLAYS[0]

    monitor = Monitor(dut.clk_i, dut.valid_i, dut.ready_o, dut.valid_o, dut.ready_i, dut.exit_o, dut.ray_i)
    await reset(dut, monitor)
    return monitor, int(dut.latency_o.value)


async def reset(dut, monitor):
    dut.rst_ni.value = 0
    dut.valid_i.value = 0
    # The first edge of a simulation may come before any of the clock's rising ones.
    await monitor.edge
    for _ in range(3):
        await monitor.edge
        assert not dut.valid_o.value
    dut.rst_ni.value = 1
    monitor._stalled = None
    monitor.accepted, monitor.left, monitor.got = [], [], []
    assert dut.busy_o.value, "after reset the display is still to be copied"
    assert not dut.ready_o.value
    for _ in range(4):
        await monitor.clock(None, False)
    assert not dut.busy_o.value


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS))
async def traces_in_order(dut, idle, pressure):
    monitor, latency = await start(dut)
    stuck = 4 * latency + 40
    await monitor.run(RAYS, pattern(idle, random, stuck), pattern(pressure, random, stuck), 10 * latency + 400)
    assert monitor.got == EXITS[0]
    if idle == pressure == "always":
        assert monitor.accepted == list(range(monitor.accepted[0], monitor.accepted[0] + len(RAYS)))
        assert {out - into for into, out in zip(monitor.accepted, monitor.left, strict=True)} == {latency}


@cocotb.test()
@cocotb.parametrize(pressure=PATTERNS)
async def no_ray_sees_two_displays(dut, pressure):
    monitor, latency = await start(dut)
    take = pattern(pressure, random, 3 * latency)
    current, expected, offered, applied = 0, [], False, -1
    change = random.randrange(5, 60)
    while len(monitor.accepted) < len(RAYS):
        number = len(monitor.accepted)
        apply = number >= change and not dut.busy_o.value
        # New registers alone change nothing; they count from apply on, once all rays have left.
        if number >= change - 3:
            dut.config_i.value = DISPLAYS[1 - current] if not dut.busy_o.value else DISPLAYS[current]
        dut.apply_i.value = apply
        offered = offered or random.random() < 0.9
        if await monitor.clock(RAYS[number] if offered else None, next(take)):
            # A ray that comes in with apply still belongs to the old display.
            expected.append(EXITS[current][number])
            offered = False
        dut.apply_i.value = 0
        if apply:
            current, applied = 1 - current, monitor.clocks
            change = len(monitor.accepted) + random.randrange(5, 60)
            assert dut.busy_o.value
            SEEN["display changed with rays on the way"] += len(monitor.accepted) > len(monitor.left)
        if dut.busy_o.value:
            assert not dut.ready_o.value, "closed while rays of the old display are on the way"
            assert monitor.clocks - applied < 40 * latency
    for _ in range(8 * latency):
        await monitor.clock(None, True)
    assert monitor.got == expected
    both = [sum(e == EXITS[k][n] for n, e in enumerate(expected)) for k in (0, 1)]
    assert min(both) > 10, "both displays were in use"


@cocotb.test()
async def forgets_all_at_reset(dut):
    monitor, latency = await start(dut)
    for count in (1, 7, latency, 2 * latency):
        for n in range(count):
            await monitor.clock(RAYS[n % len(RAYS)], random.random() < 0.3)
        await reset(dut, monitor)
        await monitor.run(RAYS[:200], pattern("light", random, 0), pattern("light", random, 0), 10 * latency)
        assert monitor.got == EXITS[0][:200]


@cocotb.test()
async def coverage_is_complete(dut):
    Coverage("ray_stream", PLAN["case"], SEEN).close()

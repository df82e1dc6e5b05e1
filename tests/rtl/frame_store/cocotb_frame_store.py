"""frame_store in the simulator."""

import random

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge

PLACES = int(cocotb.plusargs["Width"]) * int(cocotb.plusargs["Height"])


@cocotb.test()
async def reads_what_was_written(dut):
    edge = FallingEdge(dut.clk_i)
    Clock(dut.clk_i, 2, unit="ns").start()
    await edge
    store, expected, compared, beside = {}, {"a": [], "b": []}, 0, 0
    for clock in range(4000):
        write = (random.getrandbits(1), random.randrange(PLACES)) if clock >= 2 * PLACES else divmod(clock, PLACES)
        rgb = random.getrandbits(24)
        for port, wanted in expected.items():
            getattr(dut, f"{port}_buffer_i").value, getattr(dut, f"{port}_at_i").value = place = (
                random.getrandbits(1), random.randrange(PLACES),
            )  # fmt: skip
            if random.random() < 0.2:
                getattr(dut, f"{port}_buffer_i").value, getattr(dut, f"{port}_at_i").value = place = write
                beside += place in store
            # In the clock of a write the old pixel is read.
            wanted.append(store.get(place))
            if len(wanted) > 2 and wanted[-3] is not None:
                assert int(getattr(dut, f"{port}_rgb_o").value) == wanted[-3]
                compared += 1
        dut.write_i.value = writes = clock < 2 * PLACES or random.random() < 0.5
        dut.write_buffer_i.value, dut.write_at_i.value = write
        dut.write_rgb_i.value = rgb
        if writes:
            store[write] = rgb
        await edge
    assert compared > 7000
    assert beside > 500

import random

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge, ReadOnly

WIDTH = int(cocotb.plusargs["Width"])


@cocotb.test()
async def copies_only_while_nothing_uses_it(dut):
    """Against a model: asked for by apply or reset, made in the clock after one in which nothing used the words."""
    edge = FallingEdge(dut.clk_i)
    Clock(dut.clk_i, 2, unit="ns").start()
    copies = after_reset = held = 0
    for _ in range(60):
        # The words in use, or none yet, must outlast a reset while something uses them.
        used = None if copies == 0 else int(dut.config_o.value)
        dut.rst_ni.value, dut.idle_i.value, dut.apply_i.value = 0, 0, 0
        dut.config_i.value = random.getrandbits(WIDTH)
        await edge
        await edge
        dut.rst_ni.value = 1
        pending, copying, first = True, False, True
        for _ in range(50):
            idle, apply = random.random() < 0.3, random.random() < 0.1
            word = random.getrandbits(WIDTH)
            dut.idle_i.value, dut.apply_i.value, dut.config_i.value = idle, apply, word
            await ReadOnly()
            hold = int(dut.hold_o.value)
            await edge
            if copying:
                used, copies = word, copies + 1
                after_reset += first
                first = False
            pending, copying = apply or (pending and not copying), pending and idle and not copying
            held += pending and not idle
            assert int(dut.busy_o.value) == pending == hold
            if used is not None:
                assert int(dut.config_o.value) == used
    assert copies > 200
    assert after_reset > 50
    assert held > 200

"""A writer that breaks its promise: more words than the fifo holds, none read."""

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge


@cocotb.test()
async def write_too_many(dut):
    Clock(dut.clk_i, 2, unit="ns").start()
    dut.write_i.value = dut.ready_i.value = dut.data_i.value = dut.rst_ni.value = 0
    for _ in range(3):
        await FallingEdge(dut.clk_i)
    dut.rst_ni.value = dut.write_i.value = 1
    for _ in range((1 << int(cocotb.plusargs["AddressBits"])) + int(cocotb.plusargs["more"])):
        await FallingEdge(dut.clk_i)
    dut.write_i.value = 0
    await FallingEdge(dut.clk_i)

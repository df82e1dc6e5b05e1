"""A writer that breaks its promise: more words than the fifo holds, none read."""

import cocotb
from cocotb.triggers import FallingEdge
from streams import start_and_reset


@cocotb.test()
async def write_too_many(dut):
    dut.write_i.value = dut.ready_i.value = dut.data_i.value = 0
    await start_and_reset(dut)
    dut.write_i.value = 1
    for _ in range((1 << int(cocotb.plusargs["AddressBits"])) + int(cocotb.plusargs["more"])):
        await FallingEdge(dut.clk_i)
    dut.write_i.value = 0
    await FallingEdge(dut.clk_i)

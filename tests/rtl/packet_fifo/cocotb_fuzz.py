"""Runs the bench to its end."""

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import RisingEdge, Timer, with_timeout


@cocotb.test()
async def ends(dut):
    dut.rst_ni.value = 0
    Clock(dut.clk_i, 2, unit="ns").start()
    await Timer(11, "ns")
    dut.rst_ni.value = 1
    await with_timeout(RisingEdge(dut.done_o), 2 * int(cocotb.plusargs["clocks"]), "ns")
    await Timer(4, "ns")

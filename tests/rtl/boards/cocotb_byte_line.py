"""board_with_store on a byte stream, in the simulator: a host that writes before the board's reset has ended."""

import random
import struct

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge, Timer
from packets import frame, with_crc

READ, REPLY, OK = 2, 0x80, 0
MAGIC = 0x4C495042


@cocotb.test()
async def no_byte_is_lost_at_a_reset(dut):
    dut.identity_i.value = dut.step_i.value = dut.in_data_i.value = dut.in_valid_i.value = 0
    dut.rx_i.value = dut.out_ready_i.value = 1
    dut.rst_ni.value = 0
    Clock(dut.clk_i, 2, unit="ns").start()
    for turn in range(30):
        request = frame(with_crc(struct.pack("<BHHB", READ, turn, 0, 1)))
        reply = frame(with_crc(struct.pack("<BHBI", REPLY | READ, turn, OK, MAGIC)))
        await FallingEdge(dut.clk_i)
        await Timer(random.randrange(1, 2000), "ps")
        dut.rst_ni.value = 0
        # The first byte is offered in the reset, at its end or soon after: until it is taken, as the rule is.
        end = random.randrange(2, 9)
        first = random.randrange(-end, 8)
        sent, got = 0, b""
        for clock in range(-end, 3000):
            await FallingEdge(dut.clk_i)
            if clock == 0:
                await Timer(random.randrange(1, 1900), "ps")  # before an edge, or behind it
                dut.rst_ni.value = 1
                continue
            offered = clock >= first and sent < len(request)
            dut.in_valid_i.value = offered
            dut.in_data_i.value = request[sent] if offered else random.randrange(256)
            await Timer(100, "ps")  # what hangs on the inputs settles
            assert clock > 0 or not dut.in_ready_o.value
            sent += bool(offered and dut.in_ready_o.value)
            if dut.out_valid_o.value:
                got += bytes([int(dut.out_data_o.value)])
            if got == reply:
                break
        assert (sent, got) == (len(request), reply), f"turn {turn}, offered from clock {first} on"

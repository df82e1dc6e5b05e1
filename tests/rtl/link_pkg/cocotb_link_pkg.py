"""The CRC of link_pkg in the simulator."""

import random
import zlib

import cocotb
from cocotb.triggers import Timer

ONES = 0xFFFFFFFF


@cocotb.test()
async def equals_zlib(dut):
    words = [0, ONES, *(1 << k for k in range(32)), *(random.getrandbits(32) for _ in range(2000))]
    states = [ONES, 0, *(1 << k for k in range(32))]
    for word in words:
        state = random.choice([*states, random.getrandbits(32)])
        dut.crc_i.value, dut.word_i.value = state, word
        await Timer(1, "ns")
        assert dut.start_o.value == ONES
        for out, data in (
            (dut.byte_o, bytes([word & 0xFF])),
            (dut.pixel_o, (word & 0xFFFFFF).to_bytes(3, "big")),
            (dut.word_o, word.to_bytes(4, "little")),
        ):
            assert int(out.value) == zlib.crc32(data, state ^ ONES) ^ ONES, (hex(state), data)

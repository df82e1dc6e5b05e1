"""slot_loader in the simulator, beside a memory of words and a memory of slots."""

import random
import zlib

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge

SLOTS, BLOCKS = (int(cocotb.plusargs[name]) for name in ("Slots", "Blocks"))
CURVE, CURVE_BLOCKS = 15, 8
PLACES = [(slot, block) for slot in range(SLOTS) for block in range(BLOCKS)] + [(CURVE, k) for k in range(CURVE_BLOCKS)]


class Bench:
    """Gives the words that are asked for two clocks later, and keeps what is written."""

    def __init__(self, dut):
        self.dut, self.edge = dut, FallingEdge(dut.clk_i)
        self.words, self.asked = [0] * 256, 0
        self.slots = {}
        self.written = []
        self.crcs = dict.fromkeys(PLACES, 0)

    async def reset(self):
        dut = self.dut
        Clock(dut.clk_i, 2, unit="ns").start()
        dut.start_i.value = 0
        dut.rst_ni.value = 0
        for _ in range(3):
            await self.clock()
        assert dut.busy_o.value
        assert not dut.done_o.value
        assert not dut.write_o.value
        dut.rst_ni.value = 1
        clocks = 0
        while dut.busy_o.value:
            await self.clock()
            clocks += 1
        assert clocks <= 8192
        self.crcs = dict.fromkeys(PLACES, 0)

    async def clock(self):
        dut = self.dut
        asked = int(dut.word_at_o.value) if dut.rst_ni.value else 0
        await self.edge
        dut.word_i.value = self.words[self.asked]
        self.asked = asked
        dut.start_i.value = 0
        if dut.write_o.value:
            place = int(dut.write_slot_o.value), int(dut.write_at_o.value)
            self.slots[place] = int(dut.write_data_o.value)
            self.written.append(place)

    async def load(self, slot, block, data):
        dut = self.dut
        self.words = [int.from_bytes(data[k : k + 4], "little") for k in range(0, 1024, 4)]
        self.written.clear()
        dut.start_i.value, dut.slot_i.value, dut.block_i.value = 1, slot, block
        # It holds nobody to what it was told.
        clocks = 0
        while clocks == 0 or not dut.done_o.value:  # it may begin in the clock in which the one before is done
            await self.clock()
            clocks += 1
            dut.slot_i.value, dut.block_i.value = random.getrandbits(4), random.getrandbits(8)
            if clocks == 5:
                assert await self.crc(slot, block) == 0, "whole before it is"
                clocks += 3
        assert clocks == 1030
        assert self.written == [(slot, 1024 * block + k) for k in range(1024)]
        assert bytes(self.slots[place] for place in self.written) == data
        self.crcs[slot, block] = zlib.crc32(data)

    async def crc(self, slot, block):
        self.dut.read_slot_i.value, self.dut.read_at_i.value = slot, block
        for _ in range(3):
            await self.clock()
        return int(self.dut.read_crc_o.value)


@cocotb.test()
async def blocks_and_their_crcs(dut):
    bench = Bench(dut)
    await bench.reset()
    some = [PLACES[0], (SLOTS - 1, BLOCKS - 1), (CURVE, 0), (CURVE, 7), *random.choices(PLACES, k=8)]
    for slot, block in [*some, *some[:3]]:
        data = random.choice([random.randbytes(1024), random.randbytes(1024), bytes(1024)])
        await bench.load(slot, block, data)
        for _ in range(random.choice([0, 1, 5])):
            await bench.clock()
    for slot, block in {*some, *random.choices(PLACES, k=40)}:
        assert await bench.crc(slot, block) == bench.crcs[slot, block], (slot, block)
    await bench.reset()
    for slot, block in some:
        assert await bench.crc(slot, block) == 0

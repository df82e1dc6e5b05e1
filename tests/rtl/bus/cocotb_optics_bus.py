"""optics_block behind each adapter, as a driver of a system has it: the rays equal the twin's."""

import logging
import os
import random
import struct

import cocotb
import numpy as np
from buses import WishboneMaster, pauses
from cocotb.triggers import FallingEdge, with_timeout
from cocotbext.axi import AxiLiteBus, AxiLiteMaster, AxiStreamBus, AxiStreamFrame, AxiStreamSink, AxiStreamSource
from lippmann.display.description import load_display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.raster import TABLE_ENTRIES, Raster, raster
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.registers import OPTICS_REGISTERS, build_of, optics_writes, raster_writes, write
from streams import start_and_reset

F = int(os.environ["BUS_F"])
DISPLAY = load_display(os.environ["BUS_DISPLAY"])
BUILD = Build.of(DISPLAY, "exact", F, True, 0)
OPTICS = configuration(DISPLAY, BUILD, "exact")


class Lite:
    """The registers behind AXI4-Lite, with pauses in each channel."""

    def __init__(self, dut):
        self.master = AxiLiteMaster(AxiLiteBus.from_prefix(dut, "s_axil"), dut.clk_i, dut.rst_ni, False)
        for side in (self.master.write_if, self.master.read_if):
            for name in ("aw_channel", "w_channel", "b_channel", "ar_channel", "r_channel"):
                if hasattr(side, name):
                    getattr(side, name).set_pause_generator(pauses())

    async def write(self, address, word):
        return (await self.master.write(address, word.to_bytes(4, "little"))).resp != 0

    async def read(self, address):
        got = await self.master.read(address, 4)
        return int.from_bytes(got.data, "little"), got.resp != 0


class Wish:
    """The registers behind Wishbone."""

    def __init__(self, dut):
        self.master = WishboneMaster(dut)

    async def write(self, address, word):
        _, error = await self.master.cycle(address // 4, word)
        await self.master.idle(random.randint(1, 3))  # without an end, a cycle would be asked for again and again
        return error

    async def read(self, address):
        answer = await self.master.cycle(address // 4)
        await self.master.idle(random.randint(1, 3))  # without an end, a cycle would be asked for again and again
        return answer


async def driver(dut, registers):
    """What software does: identify the block, write the optics, trace a frame of the raster and two of the stream."""
    source, sink = (
        kind(AxiStreamBus.from_prefix(dut, prefix), dut.clk_i, dut.rst_ni, False, byte_lanes=1)  # of whole transfers
        for kind, prefix in ((AxiStreamSource, "s_axis"), (AxiStreamSink, "m_axis"))
    )
    await start_and_reset(dut)
    await FallingEdge(dut.clk_i)
    for side in (source, sink):
        side.log.setLevel(logging.WARNING)
        side.set_pause_generator(pauses())

    async def settle(**wanted):
        for _ in range(2000):
            word, error = await registers.read(OPTICS_REGISTERS["status"].address)
            assert not error
            if all(OPTICS_REGISTERS["status"].values(word)[name] == value for name, value in wanted.items()):
                return
        raise AssertionError(f"status stays {word:#x}")

    async def put(writes):
        for address, word in writes:
            assert not await registers.write(address, word), f"{address:#x}"

    words = {}
    for name in ("identity", "version", "build"):
        words[name], error = await registers.read(OPTICS_REGISTERS[name].address)
        assert not error
    assert build_of(words) == BUILD
    # No such register, and one that cannot be written: an error, and it holds what it held.
    assert await registers.read(0x018) == (0, True)
    assert await registers.write(OPTICS_REGISTERS["identity"].address, 0)
    assert await registers.read(OPTICS_REGISTERS["identity"].address) == (words["identity"], False)

    async def same(rays):
        """A packet comes out: the rays of a frame as the twin traces them."""
        traced = ray_pipeline(rays.u, rays.v, rays.a, rays.b, OPTICS, BUILD)
        packet = await with_timeout(sink.recv(compact=False), 200, "us")
        got = [struct.unpack("<hhI6i", int(word).to_bytes(32, "little")) for word in packet.tdata]
        expected = [
            (int(i), int(j), int(status), *map(int, others)) for i, j, *others, status in zip(*traced, strict=True)
        ]
        assert len(got) == len(expected) > 0
        assert got == expected
        assert [int(mark) for mark in packet.tuser] == [1] + [0] * (len(got) - 1)
        return {row[2] for row in got}

    def frame():
        left, top = random.randrange(1900), random.randrange(1000)
        window = (left, left + random.randint(3, 9)), (top, top + random.randint(3, 9))
        return Raster(1920, 1080, *window, random.randint(1, 4), "lfsr", 0, random.getrandbits(32))

    table = np.zeros(TABLE_ENTRIES, np.int64)
    statuses = set()
    await put([*optics_writes(OPTICS), write("control", apply=1)])
    await settle(busy=0)
    walked = frame()
    await put([*raster_writes(walked), write("control", start=1)])
    statuses |= await same(raster(walked, table, F))
    await put([write("source", stream=1), write("control", apply=1)])
    await settle(busy=0, running=0)
    for _ in range(3):
        rays = raster(frame(), table, F)
        columns = [np.asarray(words).astype(int) for words in (rays.u, rays.v, rays.a, rays.b)]
        data = [int.from_bytes(struct.pack("<4i", *ray), "little") for ray in zip(*columns, strict=True)]
        source.send_nowait(AxiStreamFrame(data, tuser=[1] + [0] * (len(data) - 1)))
        statuses |= await same(rays)
    assert 0 in statuses
    await settle(occupied=0)


@cocotb.test()
async def behind_axi(dut):
    dut.wishbone_i.value = 0
    WishboneMaster(dut)
    await driver(dut, Lite(dut))


@cocotb.test()
async def behind_wishbone(dut):
    dut.wishbone_i.value = 1
    Lite(dut)
    await driver(dut, Wish(dut))

"""show_frame in the simulator, between a store that is as slow as it likes and a video that never waits."""

import itertools
import random
import zlib

import cocotb
from cocotb.triggers import FallingEdge, ReadOnly
from rtl_coverage import Coverage
from streams import start_and_reset

WIDTH, HEIGHT = int(cocotb.plusargs["Width"]), int(cocotb.plusargs["Height"])
PIXELS = WIDTH * HEIGHT
SEEN = Coverage("show_frame", f"{WIDTH}x{HEIGHT}")


class Bench:
    def __init__(self, dut):
        self.dut, self.edge = dut, FallingEdge(dut.clk_i)
        self.buffers = [[random.randint(1, (1 << 24) - 1) for _ in range(PIXELS)] for _ in range(2)]
        self.crcs = [self.crc(buffer) for buffer in (0, 1)]
        self.coming, self.speed = [], 1.0  # pixels of the request that runs; how often one comes
        self.wanted, self.waits = 0, False  # the buffer that a request asks for; whether it waits to be taken
        self.front = self.late = 0  # late: pixels that were, as the device counts them

    def crc(self, buffer):
        return zlib.crc32(b"".join(pixel.to_bytes(3) for pixel in self.buffers[buffer]))

    async def begin(self):
        dut = self.dut
        for name in ("begin_i", "front_i", "shown_i", "swapped_i", "crc_i", "ready_i", "pixel_valid_i", "want_i"):
            getattr(dut, name).value = 0
        await start_and_reset(dut)
        await self.edge

    async def clock(self, want=False):
        """A clock; the pixel that the video got in it."""
        dut = self.dut
        come = bool(self.coming) and random.random() < self.speed
        ready = not self.coming and random.random() < 0.5
        dut.want_i.value, dut.ready_i.value, dut.pixel_valid_i.value = want, ready, come
        dut.pixel_rgb_i.value = self.coming[0] if come else random.getrandbits(24)
        await ReadOnly()
        rgb = int(dut.rgb_o.value)
        taken = come and bool(dut.pixel_ready_o.value)
        valid = bool(dut.valid_o.value)
        if valid and not self.waits:  # a new request, which keeps its buffer however late it is taken
            self.wanted = self.front
        asked = ready and valid
        self.waits = valid and not ready
        request = int(dut.buffer_o.value), int(dut.first_o.value), int(dut.count_o.value)
        await self.edge
        self.late += int(dut.underflow_o.value)
        if taken:
            self.coming.pop(0)
        if asked:
            assert request == (self.wanted, 0, PIXELS)
            self.coming = list(self.buffers[self.wanted])
        return rgb

    async def frame(self, shown, swap, speed, gap=20):
        """A frame of the video: the pixels of its places."""
        dut = self.dut
        self.speed = speed
        dut.begin_i.value = 1
        await self.clock()
        dut.begin_i.value = 0
        self.front ^= swap
        dut.front_i.value, dut.shown_i.value, dut.swapped_i.value = self.front, shown, swap
        await self.clock()
        dut.swapped_i.value, dut.crc_i.value = 0, self.crcs[self.front]
        for _ in range(gap):
            await self.clock()
        places = []
        for _ in range(HEIGHT):
            places += [await self.clock(True) for _ in range(WIDTH)]
            for _ in range(random.choice([0, 3])):
                await self.clock()
        await self.clock()
        return places


@cocotb.test()
async def a_fast_store_shows_every_frame(dut):
    bench = Bench(dut)
    await bench.begin()
    for turn in range(12):
        shown = turn % 5 != 4
        places = await bench.frame(shown, random.getrandbits(1), 1.0)
        assert places == (bench.buffers[bench.front] if shown else [0] * PIXELS)
        assert bench.late == 0
        assert not dut.lost_o.value


@cocotb.test()
async def a_pixel_is_at_its_place_or_black_and_counted(dut):
    bench = Bench(dut)
    await bench.begin()
    for _ in range(80):
        missing, late = bool(bench.coming) or bool(dut.valid_o.value), bench.late
        shown, speed, gap = random.random() < 0.8, random.choice([1.0, 0.95, 0.7, 0.1]), random.choice([3, 30])
        places = await bench.frame(shown, random.getrandbits(1), speed, gap)
        wanted = bench.buffers[bench.front]
        dark = [got != pixel for got, pixel in zip(places, wanted, strict=True)]
        assert all(got in (0, pixel) for got, pixel in zip(places, wanted, strict=True))
        if shown:
            assert bench.late - late == sum(dark)
            late_then_not = (True, False) in itertools.pairwise(dark)
            SEEN.point("a pixel is late, and one after it is not", late_then_not or PIXELS == 1)
            SEEN.point("pixels of the frame before are missing: the frame is black", missing and all(dark))
        else:
            assert all(dark)
            assert bench.late == late
        # A late pixel is no sign of a lost frame.
        assert not dut.lost_o.value
    SEEN.close()


@cocotb.test()
async def a_frame_that_the_memory_lost_is_black_until_the_next(dut):
    bench = Bench(dut)
    await bench.begin()
    for _ in range(20):
        assert await bench.frame(True, 1, 1.0) == bench.buffers[bench.front]
        place, bit = random.randrange(PIXELS), random.randrange(24)
        bench.buffers[bench.front][place] ^= 1 << bit
        assert await bench.frame(True, 0, 1.0) == bench.buffers[bench.front]  # seen as it passes
        for _ in range(4):
            await bench.clock()
        assert dut.lost_o.value
        for _ in range(random.randint(1, 3)):
            assert await bench.frame(True, 0, 1.0) == [0] * PIXELS
            assert dut.lost_o.value
        bench.crcs[bench.front] = bench.crc(bench.front)
    assert bench.late == 0

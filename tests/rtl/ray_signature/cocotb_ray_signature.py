"""ray_signature in the simulator."""

import random
import zlib

import cocotb
import numpy as np
from cocotb.triggers import FallingEdge
from streams import PATTERNS, pattern, start_and_reset

WORDS = 9


class Bench:
    def __init__(self, dut):
        self.dut, self.edge, self.clocks = dut, FallingEdge(dut.clk_i), 0

    async def reset(self):
        self.dut.start_i.value = self.dut.ray_valid_i.value = 0
        await start_and_reset(self.dut)
        assert not self.dut.done_o.value

    async def clock(self, start=False, ray=None, last=None):
        """One clock, with a start or a ray offered; whether the ray was taken. What is not offered is noise."""
        dut = self.dut
        words = random.getrandbits(32 * WORDS) if ray is None else int.from_bytes(ray.astype("<i4").tobytes(), "little")
        dut.start_i.value, dut.ray_valid_i.value, dut.ray_i.value = start, ray is not None, words
        dut.ray_last_i.value = random.getrandbits(1) if last is None else last
        taken = ray is not None and bool(dut.ray_ready_o.value)
        await self.edge
        self.clocks += 1
        return taken

    async def send(self, rays, idle, last=True):
        """Offer rays, the last one marked; the clocks at which they were taken."""
        taken = []
        for k, ray in enumerate(rays):
            while not next(idle):
                await self.clock()
            while not await self.clock(ray=ray, last=last and k == len(rays) - 1):
                assert not self.dut.done_o.value
            taken.append(self.clocks)
            assert not self.dut.done_o.value
        return taken

    async def ends(self, rays):
        """The frame's end, within a ray's time, and that it stays."""
        for _ in range(WORDS):
            assert not self.dut.done_o.value
            await self.clock()
        assert self.dut.done_o.value
        for _ in range(random.choice([0, 1, 30])):
            await self.clock()
        assert self.dut.done_o.value
        assert int(self.dut.rays_o.value) == len(rays)
        assert int(self.dut.crc_o.value) == zlib.crc32(rays.astype("<i4").tobytes())


def random_rays(count):
    rng = np.random.default_rng(random.getrandbits(64))
    rays = rng.integers(-(1 << 31), 1 << 31, (count, WORDS))
    rays[rng.random((count, WORDS)) < 0.2] = 0
    return rays


@cocotb.test()
@cocotb.parametrize(idle=PATTERNS)
async def frames_one_after_the_other(dut, idle):
    bench = Bench(dut)
    await bench.reset()
    for count in [1, 1, 2, *(random.randint(1, 60) for _ in range(10))]:
        await bench.clock(start=True)
        assert not dut.done_o.value
        assert (int(dut.rays_o.value), int(dut.crc_o.value)) == (0, 0)
        rays = random_rays(count)
        taken = await bench.send(rays, pattern(idle, random, 40))
        assert idle != "always" or np.array_equal(np.diff(taken), np.full(count - 1, WORDS))
        await bench.ends(rays)


@cocotb.test()
async def a_start_within_a_frame_forgets_it(dut):
    bench = Bench(dut)
    await bench.reset()
    for last in (False, True):
        for wait in range(WORDS + 1):
            await bench.clock(start=True)
            await bench.send(random_rays(random.randint(1, 4)), pattern("light", random, 0), last)
            # Somewhere in its last ray, or behind it.
            for _ in range(wait):
                await bench.clock()
            await bench.clock(start=True)
            rays = random_rays(random.randint(1, 5))
            await bench.send(rays, pattern("bursts", random, 20))
            await bench.ends(rays)


@cocotb.test()
async def a_ray_with_the_start_is_forgotten(dut):
    bench = Bench(dut)
    await bench.reset()
    for last in (False, True):
        await bench.clock(start=True, ray=random_rays(1)[0], last=last)
        rays = random_rays(3)
        await bench.send(rays, pattern("light", random, 0))
        await bench.ends(rays)


@cocotb.test()
async def reset_forgets_a_frame(dut):
    bench = Bench(dut)
    await bench.reset()
    await bench.clock(start=True)
    await bench.send(random_rays(2), pattern("always", random, 0))
    await bench.clock()
    dut.rst_ni.value = 0
    await bench.clock()
    dut.rst_ni.value = 1
    for _ in range(2 * WORDS):
        assert not dut.done_o.value
        assert (int(dut.rays_o.value), int(dut.crc_o.value)) == (0, 0)
        await bench.clock()

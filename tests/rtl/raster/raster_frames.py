"""cocotb tests of raster: every ray of random frames equals the twin's, under random stalls."""

import itertools
import os
import random
from dataclasses import replace

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge
from lippmann.fixed.raster import TABLE_ENTRIES, Raster, raster
from rtl_coverage import Coverage

F = int(os.environ["RASTER_F"])
RANDOM = random.Random(int(os.environ["LIPPMANN_SEED"]))

#: Fields of raster_config_t, the lowest bits first, and their bits.
CONFIG = (
    ("seed", 32), ("table_first", 6), ("jitter", 2), ("samples", 16), ("height", 14), ("width", 14), ("last_row", 14),
    ("first_row", 14), ("last_column", 14), ("first_column", 14),
)  # fmt: skip


def packed(**values):
    """The bits of raster_config_t."""
    word, at = 0, 0
    for name, bits in CONFIG:
        assert 0 <= values[name] < 1 << bits
        word |= values[name] << at
        at += bits
    return word


def config_of(frame):
    values = {name: getattr(frame, name) for name in ("seed", "table_first", "height", "width")}
    values |= zip(("first_row", "last_row", "first_column", "last_column"), frame.rows + frame.columns, strict=True)
    return packed(jitter=("off", "table", "lfsr").index(frame.jitter), samples=frame.samples % (1 << 16), **values)


def window(size, most):
    """First and last of a random window, often at an edge."""
    length = RANDOM.randint(1, min(most, size))
    first = RANDOM.choice([0, size - length, RANDOM.randint(0, size - length)])
    return first, first + length - 1


def random_frame(jitter, seed):
    width, height = (RANDOM.choice([1, 2, 7, 1920, 2401, 16383, RANDOM.randint(1, 16383)]) for _ in "wh")
    windows = window(width, 9), window(height, 6)
    samples, first = RANDOM.choice([1, 1, 2, 3, 5, 70]), RANDOM.randrange(TABLE_ENTRIES)
    return Raster(width, height, *windows, samples, jitter, first, seed)


class Bench:
    def __init__(self, dut):
        self.dut = dut
        self.table = np.zeros(TABLE_ENTRIES, np.int64)

    async def begin(self):
        dut = self.dut
        for port in (dut.config_i, dut.start_i, dut.abort_i, dut.table_write_i, dut.table_at_i, dut.table_entry_i):
            port.value = 0
        dut.ray_ready_i.value = 0
        dut.rst_ni.value = 0
        cocotb.start_soon(Clock(dut.clk_i, 2, "ns").start())
        for _ in range(3):
            await FallingEdge(dut.clk_i)
        assert not dut.ray_valid_o.value
        assert not dut.running_o.value
        dut.rst_ni.value = 1
        await FallingEdge(dut.clk_i)

    async def fill_table(self):
        dut = self.dut
        for at in RANDOM.sample(range(TABLE_ENTRIES), TABLE_ENTRIES):
            self.table[at] = RANDOM.randrange(1 << 32)
            first = RANDOM.randrange(16)  # the bytes that are written first, the others after them
            for strobes in (first, 0xF & ~first):
                bits = sum(0xFF << 8 * byte for byte in range(4) if strobes >> byte & 1)
                dut.table_write_i.value, dut.table_at_i.value = strobes, at
                dut.table_entry_i.value = int(self.table[at]) & bits | RANDOM.randrange(1 << 32) & ~bits
                await FallingEdge(dut.clk_i)
        dut.table_write_i.value = 0

    async def start(self, config):
        self.dut.config_i.value = config
        self.dut.start_i.value = 1
        await FallingEdge(self.dut.clk_i)
        self.dut.start_i.value = 0

    def ray(self):
        dut = self.dut
        words = (dut.ray_u_o, dut.ray_v_o, dut.ray_a_o, dut.ray_b_o)
        flags = (dut.ray_first_o, dut.ray_last_o)
        return *(w.value.to_signed() for w in words), *(bool(f.value) for f in flags)

    async def frame(self, stall, meddle=True):
        """Take a frame's rays until it is over: the rays, and the clocks in which none came after the first."""
        dut = self.dut
        rays, bubbles, stalled, waited = [], 0, None, 0
        while dut.running_o.value:
            ready = RANDOM.random() >= stall
            dut.ray_ready_i.value = ready
            if meddle:
                # What the frame copied at its start may change now, and another start means nothing.
                dut.config_i.value = RANDOM.randrange(1 << 140)
                dut.start_i.value = RANDOM.random() < 0.2
            if dut.ray_valid_o.value:
                ray = self.ray()
                assert stalled in (None, ray), "a stalled ray changed"
                stalled = None if ready else ray
                if ready:
                    rays.append(ray)
                    if ray[-1]:
                        dut.start_i.value = 0
                waited = 0
            else:
                assert stalled is None, "a stalled ray was withdrawn"
                bubbles += bool(rays)
                waited += 1
                assert waited < 20, "the raster stopped"
            await FallingEdge(dut.clk_i)
        assert not dut.ray_valid_o.value
        dut.start_i.value = 0
        return rays, bubbles


def expected(frame, table):
    return [tuple(map(int, ray[:4])) + tuple(map(bool, ray[4:])) for ray in zip(*raster(frame, table, F), strict=True)]


@cocotb.test()
async def frames_equal_the_twin(dut):
    bench = Bench(dut)
    await bench.begin()
    coverage = Coverage("raster", f"F{F}")
    seen = set()
    for jitter, stall, turn in itertools.product(("off", "table", "lfsr"), (0.0, 0.3, 0.8), range(4)):
        await bench.fill_table()
        frame = random_frame(jitter, RANDOM.choice([0, 1, (1 << 32) - 1, RANDOM.randrange(1 << 32)]))
        if turn == 0:
            frame = replace(frame, columns=frame.columns[1:] * 2, rows=frame.rows[1:] * 2, samples=1)
        elif turn == 1:
            frame = replace(frame, samples=70)
        elif turn == 2:
            frame = replace(frame, seed=0)
        await bench.start(config_of(frame))
        rays, bubbles = await bench.frame(stall)
        assert not dut.refused_o.value
        assert rays == expected(frame, bench.table), frame
        assert bubbles == 0, "a bubble within a frame"
        seen.update(rays)
        coverage.point(f"jitter {jitter}", len(rays))
        coverage.point(f"stall {stall}", len(rays))
        coverage.point("one ray", frame.rays == 1)
        coverage.point("more samples than entries", frame.samples > TABLE_ENTRIES)
        coverage.point("right edge", frame.columns[1] == frame.width - 1)
        coverage.point("bottom edge", frame.rows[1] == frame.height - 1)
        coverage.point("odd panel", frame.width % 2)
        coverage.point("even panel", frame.width % 2 == 0)
    coverage.close()
    assert len(seen) > 500


@cocotb.test()
async def an_illegal_window_is_refused(dut):
    bench = Bench(dut)
    await bench.begin()
    legal = Raster(100, 80, (3, 4), (5, 6))
    good = config_of(legal)
    values = {
        "seed": 1, "table_first": 0, "jitter": 0, "samples": 1, "height": 80, "width": 100, "last_row": 6,
        "first_row": 5, "last_column": 4, "first_column": 3,
    }  # fmt: skip
    assert packed(**values) == good
    alone = {"first_column": 5, "last_column": 100, "first_row": 7, "last_row": 80, "width": 0, "height": 0}
    for wrong in (*({name: value} for name, value in alone.items()), {"first_column": 101, "last_column": 102}):
        dut.ray_ready_i.value = 1
        await bench.start(packed(**{**values, **wrong}))
        for _ in range(12):
            assert not dut.ray_valid_o.value
            await FallingEdge(dut.clk_i)
        assert dut.refused_o.value, wrong
        assert not dut.running_o.value
        await bench.start(good)
        assert not dut.refused_o.value
        rays, _ = await bench.frame(0.0, meddle=False)
        assert rays == expected(legal, bench.table)
        assert len(rays) == 4


@cocotb.test()
async def reset_ends_a_frame(dut):
    bench = Bench(dut)
    await bench.begin()
    frame = Raster(640, 480, (0, 639), (0, 479))
    await bench.start(config_of(frame))
    dut.ray_ready_i.value = 1
    for _ in range(50):
        await FallingEdge(dut.clk_i)
    assert dut.ray_valid_o.value
    dut.rst_ni.value = 0
    await FallingEdge(dut.clk_i)
    assert not dut.ray_valid_o.value
    assert not dut.running_o.value
    dut.rst_ni.value = 1
    small = Raster(640, 480, (7, 9), (7, 7))
    await FallingEdge(dut.clk_i)
    await bench.start(config_of(small))
    rays, _ = await bench.frame(0.5)
    assert rays == expected(small, bench.table)


@cocotb.test(skip="RASTER_LONG" not in os.environ)
async def sixty_five_thousand_samples(dut):
    bench = Bench(dut)
    await bench.begin()
    frame = Raster(3, 2, (1, 1), (1, 1), 65536, "lfsr", seed=RANDOM.randrange(1 << 32))
    await bench.start(config_of(frame))
    rays, bubbles = await bench.frame(0.0, meddle=False)
    assert rays == expected(frame, bench.table)
    assert bubbles == 0


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def an_abort_ends_a_frame_in_any_clock(dut):
    """From its start on: no ray follows, a start with it is lost, and the next frame is whole."""
    bench = Bench(dut)
    await bench.begin()
    await bench.fill_table()
    for wait in range(60):
        one, two = random_frame("lfsr", 5), replace(random_frame("table", 7), samples=2)
        await bench.start(config_of(one))
        for _ in range(RANDOM.choice([wait, wait // 8])):
            dut.ray_ready_i.value = RANDOM.random() < 0.5
            await FallingEdge(dut.clk_i)
        dut.ray_ready_i.value = RANDOM.random() < 0.5
        dut.abort_i.value, dut.start_i.value = 1, RANDOM.getrandbits(1)
        await FallingEdge(dut.clk_i)
        dut.abort_i.value = dut.start_i.value = 0
        for _ in range(RANDOM.choice([0, 1, 12])):
            assert not dut.running_o.value
            assert not dut.ray_valid_o.value
            await FallingEdge(dut.clk_i)
        await bench.start(config_of(two))
        rays, _ = await bench.frame(0.3)
        assert rays == expected(two, bench.table)

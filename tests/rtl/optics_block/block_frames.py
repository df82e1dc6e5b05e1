"""cocotb tests of optics_block: configured over its bus as software does, compared with the twin ray by ray."""

import os
import random
from pathlib import Path

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge
from lippmann.display.description import load_display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.raster import TABLE_ENTRIES, Raster, raster
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.registers import OPTICS_REGISTERS, build_of, optics_writes, raster_writes, table_writes, write
from pins import Pins
from rtl_coverage import Coverage
from streams import hold_reset

RANDOM = random.Random(int(os.environ["LIPPMANN_SEED"]))
F = int(os.environ["BLOCK_F"])
MODEL = os.environ["BLOCK_MODEL"]
WALK = int(os.environ["BLOCK_WALK"])
DISPLAY = load_display(Path(os.environ["BLOCK_DISPLAY"]))
OTHER = load_display(Path(os.environ["BLOCK_OTHER"]))
BUILD = Build.of(DISPLAY, MODEL, F, MODEL != "pinhole", WALK)
OPTICS = configuration(DISPLAY, BUILD, MODEL)
OTHER_OPTICS = configuration(OTHER, BUILD, MODEL)

WIDTH, HEIGHT = 1920, 1201
APPLY, START = {"apply": 1}, {"start": 1}


class Block:
    """Drives a block's ports at the clock's falling edge, where all of them are at rest."""

    def __init__(self, dut):
        Clock(dut.clk_i, 2, "ns").start()
        self.dut, self.edge = Pins(dut), FallingEdge(dut.clk_i)
        self.table = np.zeros(TABLE_ENTRIES, np.int64)
        self.stall = 0.0
        self.pause = None  # between two accesses, clocks; random when None
        self.exits, self.firsts, self.lasts = [], [], []

    @classmethod
    async def start(cls, top):
        """The block after a reset."""
        block = cls(top)
        dut = block.dut
        for name in ("psel", "penable", "pwrite", "pprot", "paddr", "pwdata", "pstrb"):
            getattr(dut, f"s_apb_{name}").value = 0
        for name in ("valid", "u", "v", "a", "b", "first", "last"):
            getattr(dut, f"ray_{name}_i").value = 0
        dut.exit_ready_i.value = 0
        await hold_reset(dut, block.edge)
        cocotb.start_soon(block._collect())
        await block.edge
        return block

    async def _collect(self):
        """Take exit rays, with pauses; a ray that waits must not change."""
        dut = self.dut
        words = [getattr(dut, f"exit_{name}_o") for name in ("i", "j", "x", "y", "z", "dx", "dy", "dz")]
        waiting = None
        while True:
            await self.edge
            ready = RANDOM.random() >= self.stall
            dut.exit_ready_i.value = ready
            if not dut.exit_valid_o.value:
                assert waiting is None, "a stalled ray was withdrawn"
                continue
            ray = (*(word.value.to_signed() for word in words), dut.exit_status_o.value.to_unsigned())
            ends = (bool(dut.exit_first_o.value), bool(dut.exit_last_o.value))
            assert waiting in (None, (ray, ends)), "a stalled ray changed"
            waiting = None if ready else (ray, ends)
            if ready:
                self.exits.append(ray)
                self.firsts.append(ends[0])
                self.lasts.append(ends[1])

    async def _access(self, address, word=None, strobes=0xF):
        """One APB4 access: the word read, and whether it was an error. No protection is refused."""
        dut = self.dut
        dut.s_apb_psel.value, dut.s_apb_penable.value = 1, 0
        dut.s_apb_pwrite.value = word is not None
        dut.s_apb_pprot.value = RANDOM.randrange(8)
        dut.s_apb_paddr.value = address
        dut.s_apb_pwdata.value = word or 0
        dut.s_apb_pstrb.value = 0 if word is None else strobes
        await self.edge
        dut.s_apb_penable.value = 1
        clocks = 2
        while not dut.s_apb_pready.value:
            await self.edge
            clocks += 1
            assert clocks < 10, f"no answer at 0x{address:03x}"
        assert clocks == (3 if address >= 0x100 else 5 if word is None else 4)
        answer = dut.s_apb_prdata.value.to_unsigned(), bool(dut.s_apb_pslverr.value)
        await self.edge
        dut.s_apb_psel.value = dut.s_apb_penable.value = 0
        # Back to back now and then.
        for _ in range(RANDOM.randrange(3) if self.pause is None else self.pause):
            await self.edge
        return answer

    async def write(self, writes):
        for address, word in writes:
            _, error = await self._access(address, word)
            assert not error, f"error at 0x{address:03x}"

    async def read(self, name):
        word, error = await self._access(OPTICS_REGISTERS[name].address)
        assert not error, name
        return word

    async def command(self, **fields):
        await self.write([write("control", **fields)])

    async def status(self):
        return OPTICS_REGISTERS["status"].values(await self.read("status"))

    async def settle(self, **wanted):
        for _ in range(20000):
            status = await self.status()
            if all(status[name] == value for name, value in wanted.items()):
                return
        raise AssertionError(f"status stays {status}")

    async def apply(self, optics, *more):
        """Write optics, and more registers, and have them take effect."""
        await self.write([*optics_writes(optics), *more])
        await self.command(**APPLY)
        await self.settle(busy=0)

    async def fill_table(self):
        # Aims within one and a half pitches, the range that the host promises.
        aims = [RANDOM.randrange(-1536, 1537) & 0xFFF for _ in range(2 * TABLE_ENTRIES)]
        places = [RANDOM.randrange(256) for _ in range(TABLE_ENTRIES)]
        self.table = np.array(
            [place | a << 8 | b << 20 for place, a, b in zip(places, aims[::2], aims[1::2], strict=True)], np.int64
        )
        # Byte by byte now and then, in any order, as the strobes say.
        for address, word in table_writes(self.table):
            split = RANDOM.choice([0xF, 0xF, RANDOM.randrange(16)])
            for strobes in (split, 0xF & ~split):
                other = RANDOM.randrange(1 << 32)
                bits = sum(0xFF << 8 * byte for byte in range(4) if strobes >> byte & 1)
                _, error = await self._access(address, word & bits | other & ~bits, strobes)
                assert not error

    async def offer(self, rays, n):
        """Offer a ray to the stream until it is taken."""
        dut = self.dut
        for name in ("u", "v", "a", "b", "first", "last"):
            port = getattr(dut, f"ray_{name}_i")
            port.value = int(getattr(rays, name)[n]) & ((1 << len(port)) - 1)
        dut.ray_valid_i.value = 1
        taken = False
        while not taken:
            taken = bool(dut.ray_ready_o.value)
            await self.edge
        dut.ray_valid_i.value = 0

    async def drain(self, rays):
        for _ in range(rays * 40 + 4000):
            if len(self.exits) >= rays:
                break
            await self.edge
        for _ in range(40):
            await self.edge

    def check(self, *frames):
        """The exits since the last check are those of frames, each traced by one set of optics."""
        expected, firsts, lasts = [], [], []
        for rays, optics in frames:
            traced = ray_pipeline(rays.u, rays.v, rays.a, rays.b, optics, BUILD)
            expected += [tuple(map(int, ray)) for ray in zip(*traced, strict=True)]
            firsts += rays.first.tolist()
            lasts += rays.last.tolist()
        assert len(self.exits) == len(expected) > 0
        assert self.exits == expected
        assert (self.firsts, self.lasts) == (firsts, lasts)
        self.forget()
        return expected

    def forget(self):
        self.exits, self.firsts, self.lasts = [], [], []


def frame_of(jitter="off", rays=60):
    columns, rows = RANDOM.randint(3, 12), RANDOM.randint(3, 8)
    left, top = RANDOM.randint(0, WIDTH - columns), RANDOM.randint(0, HEIGHT - rows)
    samples = max(rays // (columns * rows), 1)
    return Raster(
        WIDTH, HEIGHT, (left, left + columns - 1), (top, top + rows - 1), samples, jitter, RANDOM.randrange(64),
        RANDOM.randrange(1 << 32),
    )  # fmt: skip


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def registers_answer(dut):
    block = await Block.start(dut)
    words = {name: await block.read(name) for name in ("identity", "version", "build")}
    assert build_of(words) == BUILD
    # Reset values, then every bit of every register that is read and written, high and low.
    stored = {name: r for name, r in OPTICS_REGISTERS.items() if r.access == "read, write"}
    assert len(stored) == 46
    for name, register in stored.items():
        word = await block.read(name)
        assert word == sum((field.reset or 0) << field.low for field in register.fields.values()), name
    for _ in range(2):
        written = {name: RANDOM.randrange(1 << 32) for name in stored}
        for name, register in RANDOM.sample(list(stored.items()), len(stored)):
            await block.write([(register.address, written[name])])
        # Some bytes of each: those without a strobe keep their value.
        for name, register in RANDOM.sample(list(stored.items()), len(stored)):
            strobes, word = RANDOM.randrange(16), RANDOM.randrange(1 << 32)
            _, error = await block._access(register.address + RANDOM.randrange(4), word, strobes)
            assert not error
            bits = sum(0xFF << 8 * byte for byte in range(4) if strobes >> byte & 1)
            written[name] = written[name] & ~bits | word & bits
        for name, register in stored.items():
            mask = sum(((1 << field.width) - 1) << field.low for field in register.fields.values())
            assert await block.read(name) == written[name] & mask, name
    # A command without its strobe is none.
    assert not (await block._access(OPTICS_REGISTERS["control"].address, 0xFFFFFFFF, 0b1110))[1]
    assert not (await block.status())["running"]
    held = {name: await block.read(name) for name in stored}
    # What is not there, cannot be read or cannot be written, is an error and changes nothing.
    taken = {at for r in OPTICS_REGISTERS.values() for at in range(r.address, r.address + 4 * r.entries, 4)}
    for address in range(0, 512, 4):
        _, error = await block._access(address)
        readable = any(address == r.address and "read" in r.access for r in OPTICS_REGISTERS.values())
        assert error == (not readable), f"read 0x{address:03x}"
        if address not in taken:
            _, error = await block._access(address, 0xFFFFFFFF)
            assert error, f"write 0x{address:03x}"
    for name in ("identity", "version", "build", "status"):
        _, error = await block._access(OPTICS_REGISTERS[name].address, 0)
        assert error
    assert {name: await block.read(name) for name in stored} == held
    assert await block.read("identity") == words["identity"]


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def frames_equal_the_twin(dut):
    block = await Block.start(dut)
    coverage = Coverage("optics_block", f"{MODEL}-F{F}")
    await block.apply(OPTICS)
    statuses, wanted = set(), {0, 4} if BUILD.aims else {0}
    # A frame may lie beside the array, and rays that leave through a neighbour are rare on some displays: frames follow
    # until both were seen.
    for jitter, stall in (("off", 0.0), ("table", 0.3), ("lfsr", 0.7), *[("lfsr", 0.0)] * 30):
        if (jitter, stall) == ("lfsr", 0.0) and wanted <= statuses:
            break
        block.stall = stall
        frame = frame_of(jitter, 400)
        await block.fill_table()
        await block.write(raster_writes(frame))
        await block.command(**START)
        await block.settle(running=0)
        await block.drain(frame.rays)
        expected = block.check((raster(frame, block.table, F), OPTICS))
        statuses.update(ray[-1] for ray in expected)
        coverage.point(f"jitter {jitter}", len(expected))
    coverage.point("ok", 0 in statuses)
    if BUILD.aims:
        coverage.point("crosstalk", 4 in statuses)
    coverage.close()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def an_apply_waits_for_the_end_of_the_frame(dut):
    block = await Block.start(dut)
    await block.apply(OPTICS)
    optics = [OPTICS, OTHER_OPTICS]
    for turn in range(4):
        block.stall = RANDOM.choice([0.3, 0.7])
        now, after = optics[turn % 2], optics[1 - turn % 2]
        one, two = frame_of("lfsr", 1500), frame_of("lfsr", 200)
        await block.write(raster_writes(one))
        await block.command(**START)
        while len(block.exits) < 10:
            await block.edge
        # New optics and the next frame, while rays of the first one pour out.
        await block.write(optics_writes(after))
        if turn < 2:
            await block.write(raster_writes(two))
            await block.command(**APPLY, **START)
        else:
            await block.command(**APPLY)
        status = await block.status()
        assert status["busy"], "the frame ended too early for this test"
        assert status["running"]
        if turn >= 2:
            await block.settle(busy=0)
            await block.write(raster_writes(two))
            await block.command(**START)
        await block.settle(busy=0, running=0)
        await block.drain(one.rays + two.rays)
        rays = [raster(frame, block.table, F) for frame in (one, two)]
        torn = [ray_pipeline(*rays[k][:4], optics[(turn + 1 - k) % 2], BUILD) for k in (0, 1)]
        right = block.check((rays[0], now), (rays[1], after))
        wrong = [tuple(map(int, ray)) for part in torn for ray in zip(*part, strict=True)]
        assert sum(a != b for a, b in zip(right, wrong, strict=True)) > len(right) // 2


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def an_apply_as_a_frame_begins_does_not_tear_it(dut):
    """Whichever clock the apply falls on, all rays are of the old optics or all of the new."""
    block = await Block.start(dut)
    seen = set()
    for pause in range(12):
        block.pause = None
        await block.apply(OPTICS)
        frame = frame_of("lfsr", 40)
        await block.write([*raster_writes(frame), *optics_writes(OTHER_OPTICS)])
        block.pause = pause
        await block.command(**START)
        await block.command(**APPLY)
        await block.settle(busy=0, running=0)
        await block.drain(frame.rays)
        rays = raster(frame, block.table, F)
        old = ray_pipeline(rays.u, rays.v, rays.a, rays.b, OPTICS, BUILD)
        new = block.exits[0] != tuple(int(word[0]) for word in old)
        block.check((rays, OTHER_OPTICS if new else OPTICS))
        seen.add(new)
    assert seen == {False, True}


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def the_stream_at_the_port_is_traced(dut):
    block = await Block.start(dut)
    block.stall = 0.4
    await block.apply(OPTICS, write("source", stream=1))
    frames = [raster(frame_of("lfsr", 300), block.table, F) for _ in range(3)]
    asked = []

    async def ask():
        await block.write(optics_writes(OTHER_OPTICS))
        await block.command(**APPLY)
        asked.append(await block.status())

    for k, rays in enumerate(frames):
        for n in range(len(rays.u)):
            if (k, n) == (1, 5):
                asking = cocotb.start_soon(ask())
            if (k, n) == (1, len(rays.u) - 2):
                await asking
            while RANDOM.random() < 0.3:
                await block.edge
            await block.offer(rays, n)
    await block.drain(sum(len(rays.u) for rays in frames))
    assert asked[0]["busy"]
    block.check((frames[0], OPTICS), (frames[1], OPTICS), (frames[2], OTHER_OPTICS))

    # Frames of one ray, without a pause, while one apply follows another: none is lost or comes twice.
    async def apply_often():
        for _ in range(8):
            await block.command(**APPLY)
            await block.settle(busy=0)
        asked.append(None)

    cocotb.start_soon(apply_often())
    singles = []
    while len(asked) < 2:
        row = len(singles)
        singles.append(raster(Raster(WIDTH, HEIGHT, (5, 5), (row, row)), block.table, F))
        await block.offer(singles[-1], 0)
    await block.drain(len(singles))
    block.check(*((rays, OTHER_OPTICS) for rays in singles))


@cocotb.test(timeout_time=2, timeout_unit="ms")
async def an_abort_leaves_the_block_empty(dut):
    """At any moment of a frame, with a start remembered and an apply that waits, and with a stream that has no end."""
    block = await Block.start(dut)
    for turn in range(16):
        block.stall = RANDOM.choice([0.0, 0.5, 0.95])
        stream = turn % 4 == 3
        await block.apply(OPTICS, write("source", stream=0))
        await block.write(raster_writes(frame_of("lfsr", 60000)))
        if stream:  # a frame of the stream begins, one of the raster waits
            await block.write([write("source", stream=1)])
            await block.command(**APPLY)
            await block.settle(busy=0)
            rays = raster(frame_of("lfsr", 60), block.table, F)
            for n in range(3):
                await block.offer(rays, n)
        await block.command(**START)
        for _ in range(RANDOM.choice([0, 1, 7, 100, 700])):
            await block.edge
        await block.command(**START)
        await block.write(optics_writes(OTHER_OPTICS))
        await block.command(**APPLY)
        assert (await block.status())["busy"] or stream or not block.exits
        await block.write([write("source", stream=0)])
        await block.command(abort=1)
        assert not (await block.status())["running"]
        await block.settle(occupied=0, busy=0, running=0)
        left = len(block.exits)
        for _ in range(300):
            await block.edge
        assert len(block.exits) == left, "a ray came out of an empty block"
        assert not any(block.lasts)
        block.forget()
        # What comes next is whole, in the optics that the abort let in.
        frame = frame_of("lfsr", 60)
        await block.write(raster_writes(frame))
        if stream:
            await block.command(**APPLY)
            await block.settle(busy=0)
        await block.command(**START)
        await block.settle(running=0)
        await block.drain(frame.rays)
        block.check((raster(frame, block.table, F), OTHER_OPTICS))
        # Both at once: the frame ends, another begins.
        await block.write(raster_writes(frame_of("lfsr", 60000)))
        await block.command(**START)
        await block.write(raster_writes(frame))
        await block.command(abort=1, start=1)
        await block.settle(running=0, occupied=0)
        cut = len(block.exits) - frame.rays
        rays = [getattr(block, name)[cut:] for name in ("exits", "firsts", "lasts")]
        assert not any(block.lasts[:cut])
        block.exits, block.firsts, block.lasts = rays
        block.check((raster(frame, block.table, F), OTHER_OPTICS))

"""scene_block in the simulator: its registers after the tables in docs/reference, its slots after its comment."""

import random
import re
from pathlib import Path

import cocotb
from cocotb.triggers import FallingEdge
from streams import start_and_reset

LAYERS, WORD = (int(cocotb.plusargs[name]) for name in ("Layers", "Word"))
PAGE = Path(__file__).resolve().parents[3] / "docs/generated/scene-registers.md"
STATUS, FRAMES, UNDERFLOWS, SOURCE, BUILD = 0x28, 0x2C, 0x30, 0x0C, 0x08
CONFIG = 8 * 8 * 32 + 3 * 32 + 3 * 16


def masks():
    """By address the bits that can be written, and those that can be read only; of the layers that are there."""
    found = {}
    row = r"^\| `0x(\w+)` \| `\w+` \| (\d+)(?::(\d+))? \| `\w+` \| ([\w, ]+) \|"
    for at, high, low, access in re.findall(row, PAGE.read_text(), re.M):
        if int(at, 16) < 0x200 + 32 * LAYERS:
            write, read = found.get(int(at, 16), (0, 0))
            bits = (1 << int(high) + 1) - (1 << int(low or high))
            found[int(at, 16)] = (write | bits, read) if "write" in access else (write, read | bits)
    return found


MASKS = masks()


class Bench:
    def __init__(self, dut):
        self.dut, self.edge = dut, FallingEdge(dut.clk_i)
        self.words = dict.fromkeys(MASKS, 0)

    async def reset(self):
        dut = self.dut
        for handle in (dut.s_apb_psel, dut.s_apb_penable, dut.take_i, dut.shown_i, dut.drawn_i, dut.underflow_i):
            handle.value = 0
        dut.s_apb_pprot.value = 0
        await start_and_reset(dut)

    async def access(self, write, at, word=0, strobes=15):
        """An access; its word, or None for an error."""
        dut = self.dut
        dut.s_apb_psel.value, dut.s_apb_penable.value, dut.s_apb_pwrite.value = 1, 0, write
        dut.s_apb_paddr.value, dut.s_apb_pwdata.value, dut.s_apb_pstrb.value = at, word, strobes if write else 0
        await self.edge
        dut.s_apb_penable.value = 1
        for _ in range(8):
            if dut.s_apb_pready.value:
                break
            await self.edge
        else:
            raise AssertionError(f"{at:#x} does not answer")
        error, got = bool(dut.s_apb_pslverr.value), int(dut.s_apb_prdata.value)
        await self.edge
        dut.s_apb_psel.value = dut.s_apb_penable.value = 0
        await self.edge
        return None if error else got

    def config(self):
        """The bits of scene_config_t, as written: layers first, then the lattice and the background."""
        word = 0
        for layer in range(7, -1, -1):
            for k in range(8):
                word = word << 32 | (self.words[0x200 + 32 * layer + 4 * k] if layer < LAYERS else 0)
        for at in (0x10, 0x14, 0x18):
            word = word << 32 | self.words[at]
        for at in (0x1C, 0x20, 0x24):
            word = word << 16 | self.words[at]
        return word

    def named(self):
        looks = [self.words[0x21C + 32 * layer] for layer in range(LAYERS)]
        return sum({1 << (look >> 4 & 15) for look in looks if look & 1} | {1 << 15})


@cocotb.test()
async def every_register(dut):
    bench = Bench(dut)
    await bench.reset()
    assert await bench.access(0, 0) == 0x4C495053
    assert await bench.access(0, BUILD) == WORD
    for turn in range(3):
        places = list(range(0, 0x400, 4))
        random.shuffle(places)
        for at in places:
            word, strobes = random.getrandbits(32), 15 if turn < 2 else random.randrange(16)
            done = await bench.access(1, at, word, strobes)
            write, _ = MASKS.get(at, (0, 0))
            assert (done is not None) == bool(write), f"{at:#x}"
            if write:
                taken = sum(0xFF << 8 * k for k in range(4) if strobes >> k & 1) & write
                bench.words[at] = (bench.words[at] & ~taken) | (word & taken)
                assert int(dut.config_o.value) == bench.config(), f"{at:#x}"
                assert int(dut.source_o.value) == bench.words[SOURCE] & 1
        for at in places:
            got = await bench.access(0, at)
            assert (got is not None) == (at in MASKS), f"{at:#x}"
            if at in MASKS and MASKS[at][0]:
                assert got == bench.words[at], f"{at:#x}"


@cocotb.test()
async def state(dut):
    bench = Bench(dut)
    await bench.reset()
    taken, waits, frames, late, seen = 0, 0, 0, 0, set()
    for _ in range(300):
        chance = random.random()
        if chance < 0.4:
            look = 0x21C + 32 * random.randrange(LAYERS)
            at = random.choice([SOURCE, look, look, 0x10])
            word = random.getrandbits(32) & MASKS[at][0]
            assert await bench.access(1, at, word) is not None
            bench.words[at], waits = word, 1
        elif chance < 0.5:
            assert await bench.access(1, STATUS, 5) is None  # that changes nothing
        elif chance < 0.7:
            dut.take_i.value = 1
            taken, waits = bench.named(), 0
            await bench.edge
            dut.take_i.value = 0
            dut.shown_i.value = random.getrandbits(1)
            await bench.edge
        else:
            dut.drawn_i.value, dut.underflow_i.value = drawn, under = random.getrandbits(1), random.getrandbits(1)
            frames, late = frames + drawn, late + under
            await bench.edge
            dut.drawn_i.value = dut.underflow_i.value = 0
            await bench.edge
        shown, source = int(dut.shown_i.value), bench.words[SOURCE] & 1
        slots = (bench.named() if source else 0) | (taken if shown else 0)
        assert int(dut.slots_o.value) == slots
        assert await bench.access(0, STATUS) == slots << 16 | waits << 1 | shown
        assert await bench.access(0, FRAMES) == frames
        assert await bench.access(0, UNDERFLOWS) == late
        seen.add((shown, source, waits))
    assert len(seen) == 8

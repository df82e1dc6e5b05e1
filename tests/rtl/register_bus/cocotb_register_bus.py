"""register_bus in the simulator, between the kinds of registers."""

import random

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge
from rtl_coverage import Coverage

SEEN: list[str] = []
SCENE = bool(int(cocotb.plusargs["Scene"]))
BLOCKS = ["board", "optics"] + ["scene"] * SCENE


def block(at):
    """Where an address is, and its address there."""
    if at >= 0x400:
        return ("scene", at - 0x400) if SCENE else ("nowhere", at)
    return ("board", at) if at < 0x80 else ("optics", at - 0x200) if at >= 0x200 else ("nowhere", at)


class Bench:
    """Answers the accesses that arrive, checks both buses' contracts, and keeps what was asked."""

    def __init__(self, dut):
        self.dut, self.edge = dut, FallingEdge(dut.clk_i)
        self.access = None  # block, write, address, word
        self.left = 0  # clocks until it is answered
        self.answer = (0, 0)  # word, error
        self.asked = 0

    async def reset(self):
        dut = self.dut
        Clock(dut.clk_i, 2, unit="ns").start()
        dut.start_i.value = 0
        for name in ("board", "optics", "scene"):
            getattr(dut, f"m_apb_pready_{name}").value = 0
        dut.rst_ni.value = 0
        for _ in range(3):
            await self.edge
        for handle in (
            dut.done_o, dut.m_apb_psel_board, dut.m_apb_psel_optics, dut.m_apb_psel_scene, dut.m_apb_penable,
        ):  # fmt: skip
            assert not handle.value, handle._name
        dut.rst_ni.value = 1
        self.access = None

    async def clock(self):
        """Go on by a clock: see what is asked, answer what is due; noise on all that is not said."""
        await self.edge
        dut = self.dut
        dut.start_i.value = 0
        dut.write_i.value, dut.at_i.value = random.getrandbits(1), random.getrandbits(9) << 2
        dut.word_i.value = random.getrandbits(32)
        enable = bool(dut.m_apb_penable.value)
        selects = {name: bool(getattr(dut, f"m_apb_psel_{name}").value) for name in ("board", "optics", "scene")}
        assert SCENE or not selects["scene"]
        # Of a block that is not selected, and without an enable, ready means nothing.
        for name, select in selects.items():
            getattr(dut, f"m_apb_prdata_{name}").value = random.getrandbits(32)
            getattr(dut, f"m_apb_pslverr_{name}").value = random.getrandbits(1)
            getattr(dut, f"m_apb_pready_{name}").value = not (select and enable) and random.getrandbits(1)
        selected = [name for name, select in selects.items() if select]
        assert len(selected) <= 1, "two blocks were asked"
        assert selected or not enable
        name = selected[0] if selected else "none"
        asked = (name, *(int(h.value) for h in (dut.m_apb_pwrite, dut.m_apb_paddr, dut.m_apb_pwdata, dut.m_apb_pstrb)))
        if selected and self.access is None:
            assert not enable, "APB: no setup clock"
            assert int(dut.m_apb_pstrb.value) == (0xF if dut.m_apb_pwrite.value else 0), "APB: strobes"
            assert int(dut.m_apb_pprot.value) == 0
            self.access, self.left, self.asked = asked, self.left + 1, self.asked + 1
        elif selected:
            assert enable, "APB: two setup clocks"
            assert asked == self.access, "APB: the access changed"
        else:
            assert self.access is None, "APB: deselected before ready"
        if self.access is None:
            return
        if self.left > 0:
            self.left -= 1
            return
        word, error = self.answer
        getattr(dut, f"m_apb_pready_{name}").value = 1
        getattr(dut, f"m_apb_prdata_{name}").value = word
        getattr(dut, f"m_apb_pslverr_{name}").value = error
        self.answered, self.access = self.access[:4], None

    async def ask(self, write, at, word):
        """One access; what the block saw, and what came back. It begins in this clock."""
        dut, before = self.dut, self.asked
        self.left, self.answer = random.choice([0, 0, 1, 2, 20]), (random.getrandbits(32), random.getrandbits(1))
        self.answered = None
        dut.start_i.value, dut.write_i.value, dut.at_i.value, dut.word_i.value = 1, write, at, word
        for _ in range(40):
            await self.clock()
            if dut.done_o.value:
                break
        else:
            raise AssertionError("no answer")
        assert self.access is None
        assert self.asked - before == (self.answered is not None)
        return self.answered, int(dut.word_o.value), bool(dut.error_o.value)


async def access(bench, write, at):
    word = random.getrandbits(32)
    seen, got, error = await bench.ask(write, at, word)
    where, there = block(at)
    SEEN.append(f"{where} {'write' if write else 'read'}")
    if where == "nowhere":
        assert seen is None, f"{at:#x}"
        assert error
        return
    assert seen == (where, write, there, word), f"{at:#x}"
    assert error == bench.answer[1]
    if not write:
        assert got == bench.answer[0]
    SEEN.append(f"error {error}")


@cocotb.test()
async def every_address_both_ways(dut):
    bench = Bench(dut)
    await bench.reset()
    accesses = [(write, at) for write in (0, 1) for at in range(0, 0x800, 4)] * 2
    random.shuffle(accesses)
    for write, at in accesses:
        await access(bench, write, at)
        # The next one begins in the clock of this one's answer, or later.
        for _ in range(random.choice([0, 0, 1, 7])):
            await bench.clock()
            assert not dut.done_o.value
            assert bench.access is None


@cocotb.test()
async def reset_ends_an_access(dut):
    bench = Bench(dut)
    await bench.reset()
    for at in (0x000, 0x100, 0x200, 0x400):
        for clocks in (1, 2, 3):
            bench.left = 50
            dut.start_i.value, dut.write_i.value, dut.at_i.value = 1, 1, at
            for _ in range(clocks):
                await bench.clock()
            await bench.reset()
            bench.left = 0
            for _ in range(5):
                await bench.clock()
                assert not dut.done_o.value
                assert bench.access is None
            await access(bench, 0, 0x204)


@cocotb.test()
async def coverage_is_complete(dut):
    seen = Coverage("register_bus", f"scene {SCENE}")
    for where in (*BLOCKS, "nowhere"):
        seen.values("access", SEEN, [f"{where} read", f"{where} write"])
    seen.values("answer", SEEN, ["error True", "error False"])
    seen.close()

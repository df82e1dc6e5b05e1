"""What the tests of the adapters share: pauses, a model of apb_memory.sv, and the Wishbone master."""

import random
from collections.abc import Iterator

from cocotb.triggers import FallingEdge

WORDS = 128


def pauses() -> Iterator[bool]:
    """Whether one side of a channel pauses in the next clock: never, now and then, mostly, or in bursts."""
    while True:
        share = random.choice([0.0, 0.0, 0.2, 0.5, 0.9])
        for _ in range(random.choice([10, 40, 150])):
            yield random.random() < share


def wrong(word: int) -> bool:
    """Whether apb_memory.sv answers a word's address with an error."""
    return 0x140 <= 4 * word < 0x180


def merged(old: int, new: int, strobes: int) -> int:
    """A word after a write of some of its bytes."""
    bits = sum(0xFF << 8 * byte for byte in range(4) if strobes >> byte & 1)
    return old & ~bits | new & bits


class WishboneMaster:
    """A master of Wishbone B4 classic cycles, clock by clock, between the rising edges."""

    def __init__(self, dut):
        self.dut, self.edge, self.clocks = dut, FallingEdge(dut.clk_i), 0
        self.release()

    def release(self) -> None:
        """No cycle; what it does not drive is noise."""
        dut = self.dut
        dut.s_wb_cyc.value, dut.s_wb_stb.value = random.choice([(0, 0), (1, 0), (0, 1)])
        dut.s_wb_we.value, dut.s_wb_adr.value = random.getrandbits(1), random.getrandbits(7)
        dut.s_wb_dat_w.value, dut.s_wb_sel.value = random.getrandbits(32), random.getrandbits(4)

    async def idle(self, clocks: int) -> None:
        """No cycle for some clocks, and no answer to one."""
        for _ in range(clocks):
            self.release()
            await self.edge
            self.clocks += 1
            assert not self.dut.s_wb_ack.value
            assert not self.dut.s_wb_err.value

    async def cycle(self, word: int, write: int | None = None, select: int = 0xF, patience: int = 100):
        """One cycle: the word read, and whether it ended with an error; None when it was given up after `patience`.

        The next one may follow at once. `clocks` is then the number of clocks that it took.
        """
        dut = self.dut
        dut.s_wb_cyc.value = dut.s_wb_stb.value = 1
        dut.s_wb_we.value, dut.s_wb_adr.value, dut.s_wb_sel.value = write is not None, word, select
        dut.s_wb_dat_w.value = random.getrandbits(32) if write is None else write
        self.clocks = 0
        while self.clocks < patience:
            await self.edge
            self.clocks += 1
            ack, error = bool(dut.s_wb_ack.value), bool(dut.s_wb_err.value)
            if ack or error:
                assert not (ack and error)
                answer = int(dut.s_wb_dat_r.value), error
                await self.edge  # the edge at which the master takes it
                assert not dut.s_wb_ack.value
                assert not dut.s_wb_err.value
                return answer
        assert patience < 100, "no answer"
        await self.idle(1)
        return None

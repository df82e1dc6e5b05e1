"""uart_rx in the simulator."""

import random
from collections import Counter

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge, Timer
from pins import Pins
from rtl_coverage import Coverage
from streams import PATTERNS, pattern

CLOCK_PS = 10_000
#: Clocks a bit: the fewest, and baud rates that divide no clock.
RATES = (8.0, 8.68, 16.3, 33.33, 104.17)
SEEN: Counter[str] = Counter()


def count(name, seen=1):
    SEEN[name] += int(seen)


class Receiver:
    """The device, the line before it and what took its bytes."""

    def __init__(self, dut, clocks, mismatch=0.0):
        self.clock, self.edge = Clock(dut.clk_i, CLOCK_PS, unit="ps"), FallingEdge(dut.clk_i)
        self.dut, self.step = Pins(dut), round(65536 / clocks)
        #: A bit on the line, whose sender is off by `mismatch`.
        self.bit_ps = 65536 / self.step * CLOCK_PS / (1 + mismatch)
        self.whole_eighth_ps = int(65536 / self.step / 8) * CLOCK_PS
        self.got, self.framing, self.overflow = [], 0, 0
        self._late_ps = 0.0

    async def start(self, ready):
        dut = self.dut
        self.clock.start()
        dut.rx_i.value, dut.ready_i.value, dut.step_i.value, dut.rst_ni.value = 1, 0, self.step, 0
        await Timer(random.randrange(3, 5) * CLOCK_PS + random.randrange(CLOCK_PS), "ps")
        dut.rst_ni.value = 1
        cocotb.start_soon(self._take(ready))
        return self

    async def _take(self, ready):
        dut, held = self.dut, None
        while True:
            await self.edge
            valid, take = bool(dut.valid_o.value), next(ready)
            if held is not None:
                assert valid
                assert dut.data_o.value == held
            if valid and take:
                self.got.append(int(dut.data_o.value))
            held = int(dut.data_o.value) if valid and not take else None
            dut.ready_i.value = take
            self.framing += int(dut.framing_error_o.value)
            self.overflow += int(dut.overflow_o.value)

    async def level(self, value, bits=0.0, ps=0.0):
        """Hold the line; what is below a picosecond is made up for later."""
        self.dut.rx_i.value = value
        self._late_ps += bits * self.bit_ps + ps
        whole = int(self._late_ps)
        self._late_ps -= whole
        if whole:
            await Timer(whole, "ps")

    async def bit(self, value, noise, first=1 / 8, last=7 / 8):
        """One bit, perhaps with a spike that touches one of its samples."""
        if not noise or random.random() < 0.5:
            await self.level(value, 1)
            return
        count("spike")
        spike_ps = random.uniform(0.2, 0.98) * self.whole_eighth_ps
        before_ps = random.uniform(first * self.bit_ps, max(first, last) * self.bit_ps - spike_ps)
        before_ps = max(before_ps, first * self.bit_ps)
        await self.level(value, ps=before_ps)
        await self.level(1 - value, ps=spike_ps)
        await self.level(value, ps=self.bit_ps - before_ps - spike_ps)

    async def send(self, byte, noise=False, stop=1):
        # Spikes at the edge of a start bit move it; those in the second half of a stop bit are idle's.
        await self.bit(0, noise, first=2 / 8, last=6 / 8)
        for k in range(8):
            await self.bit((byte >> k) & 1, noise)
        await self.bit(stop, noise, first=1 / 8, last=4 / 8)


@cocotb.test()
@cocotb.parametrize(clocks=RATES, mismatch=[-0.02, 0.0, 0.02])
async def receives(dut, clocks, mismatch):
    line = await Receiver(dut, clocks, mismatch).start(pattern(random.choice(["always", "light"]), random, 0))
    sent = [0x00, 0xFF, 0x55, 0xAA, *random.randbytes(30)]
    for byte in sent:
        await line.send(byte, noise=random.random() < 0.5)
        pause = random.choice([0, random.uniform(0, 3)])
        count("no pause", pause == 0)
        await line.level(1, pause)
    await line.level(1, 2)
    assert line.got == sent
    assert (line.framing, line.overflow) == (0, 0)


@cocotb.test()
@cocotb.parametrize(ready=PATTERNS)
async def waits_to_be_taken(dut, ready):
    line = await Receiver(dut, 8.0).start(pattern(ready, random, 60))
    sent = list(random.randbytes(100))
    for byte in sent:
        await line.send(byte)
        await line.level(1, 8)
    await line.level(1, 10)
    assert line.got == sent
    assert (line.framing, line.overflow) == (0, 0)


@cocotb.test()
@cocotb.parametrize(clocks=RATES)
async def short_lows_are_noise(dut, clocks):
    line = await Receiver(dut, clocks).start(pattern("always", random, 0))
    sent = []
    for _ in range(40):
        await line.level(0, random.uniform(0.02, 0.5 - 1 / clocks))
        await line.level(1, random.uniform(1, 3))
        if random.random() < 0.3:
            sent.append(random.randrange(256))
            await line.send(sent[-1])
            await line.level(1, random.uniform(0, 2))
    await line.level(1, 2)
    count("noise rejected", 40)
    assert line.got == sent
    assert line.framing == 0


@cocotb.test()
@cocotb.parametrize(clocks=RATES)
async def longer_lows_start_a_byte(dut, clocks):
    line = await Receiver(dut, clocks).start(pattern("always", random, 0))
    for _ in range(10):
        await line.level(0, random.uniform(0.5 + 1 / clocks, 1.0))
        await line.level(1, 11)
    assert line.got == [0xFF] * 10


@cocotb.test()
@cocotb.parametrize(clocks=RATES)
async def a_low_stop_bit_loses_its_byte(dut, clocks):
    line = await Receiver(dut, clocks).start(pattern("always", random, 0))
    sent, broken = [], 0
    for _ in range(25):
        byte = random.randrange(256)
        if random.random() < 0.4:
            await line.send(byte, stop=0)
            # The line stays low for long, and rises: one error, and no byte.
            await line.level(0, random.choice([0, 0.3, 5, 40]))
            await line.level(1, random.uniform(0.1, 2))
            broken += 1
        else:
            await line.send(byte)
            sent.append(byte)
    await line.level(1, 2)
    count("framing error", broken)
    assert line.got == sent
    assert (line.framing, line.overflow) == (broken, 0)


@cocotb.test()
async def keeps_the_first_and_counts_the_lost(dut):
    taking = [False]

    def ready():
        while True:
            yield taking[0]

    line = await Receiver(dut, 12.5).start(ready())
    kept, lost = [], 0
    for _ in range(20):
        sent = list(random.randbytes(random.randrange(1, 6)))
        for byte in sent:
            await line.send(byte)
        await line.level(1, 2)
        kept.append(sent[0])
        lost += len(sent) - 1
        taking[0] = True
        await line.level(1, 2)
        taking[0] = False
        await line.level(1, 1)
    count("overflow", lost)
    assert line.got == kept
    assert (line.framing, line.overflow) == (0, lost)


@cocotb.test()
async def coverage_is_complete(dut):
    Coverage("uart_rx", "all", SEEN).close()

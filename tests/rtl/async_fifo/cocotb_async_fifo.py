import random

import cocotb
from cocotb.triggers import FallingEdge, RisingEdge, Timer
from cocotb.utils import get_sim_time
from streams import pattern
from two_clocks import RATIOS, periods, start

WIDTH, STAGES = int(cocotb.plusargs["Width"]), int(cocotb.plusargs["Stages"])
PLACES = 1 << int(cocotb.plusargs["AddressBits"])
WORDS = 12 * PLACES


class Bench:
    def __init__(self, dut, ratio):
        self.dut, self.halves = dut, periods(ratio)
        self.sent, self.got = [], []
        self.sent_ps, self.got_ps = [], []  # edges that took the words

    async def begin(self):
        dut = self.dut
        dut.in_rst_ni.value = dut.out_rst_ni.value = dut.in_valid_i.value = dut.out_ready_i.value = 0
        self.clocks = [start(dut.in_clk_i, self.halves[0]), start(dut.out_clk_i, self.halves[1])]
        await Timer(8 * max(self.halves) + 1, "ps")
        assert not dut.in_ready_o.value
        assert not dut.out_valid_o.value
        dut.in_rst_ni.value = dut.out_rst_ni.value = 1

    async def send(self, count, active):
        """Offer words until `count` were taken; what is offered stays offered."""
        dut, offered = self.dut, False
        while len(self.sent) < count:
            await FallingEdge(dut.in_clk_i)
            if not offered and next(active):
                dut.in_data_i.value = random.getrandbits(WIDTH)
                offered = True
            dut.in_valid_i.value = offered
            await RisingEdge(dut.in_clk_i)  # values of before the edge
            if offered and dut.in_ready_o.value:
                self.sent.append(int(dut.in_data_i.value))
                self.sent_ps.append(get_sim_time("ps"))
                offered = False
        await FallingEdge(dut.in_clk_i)
        dut.in_valid_i.value = 0

    async def receive(self, count, active):
        dut, held = self.dut, None
        while len(self.got) < count:
            await FallingEdge(dut.out_clk_i)
            valid, data = bool(dut.out_valid_o.value), int(dut.out_data_o.value)
            if held is not None:
                assert (valid, data) == (True, held), "a word changed during a stall"
            ready = next(active)
            dut.out_ready_i.value = ready
            held = data if valid and not ready else None
            if valid and ready:
                self.got.append(data)
                self.got_ps.append(get_sim_time("ps") + self.halves[1])
        await FallingEdge(dut.out_clk_i)
        dut.out_ready_i.value = 0

    async def run(self, words, sender, reader):
        sending = cocotb.start_soon(self.send(words, sender))
        await self.receive(words, reader)
        await sending
        assert self.got == self.sent


@cocotb.test(timeout_time=2, timeout_unit="ms")
@cocotb.parametrize(ratio=RATIOS, pauses=[("always", "always"), ("heavy", "light"), ("bursts", "bursts"),
                                          ("always", "heavy"), ("stuck", "light"), ("light", "stuck")])  # fmt: skip
async def nothing_is_lost_or_reordered(dut, ratio, pauses):
    bench = Bench(dut, ratio)
    await bench.begin()
    await bench.run(WORDS, *(pattern(name, random, 3 * PLACES) for name in pauses))


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(ratio=RATIOS)
async def it_holds_as_many_words_as_it_says(dut, ratio):
    bench = Bench(dut, ratio)
    await bench.begin()
    sending = cocotb.start_soon(bench.send(WORDS, pattern("always", random, 0)))
    await Timer(2 * (PLACES + 8) * sum(bench.halves) * 2, "ps")
    assert len(bench.sent) == PLACES + 1
    assert not dut.in_ready_o.value
    # A place is free Stages + 1 edges after a word was read: of it and of the one behind, which moves up.
    await bench.receive(WORDS, pattern("always", random, 0))
    late = (bench.sent_ps[PLACES + 1] - bench.got_ps[0]) / (2 * bench.halves[0])
    assert STAGES <= late <= STAGES + 2
    await sending
    assert bench.got == bench.sent


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(ratio=RATIOS)
async def a_word_comes_out_after_some_edges(dut, ratio):
    bench = Bench(dut, ratio)
    await bench.begin()
    for turn in range(1, 30):
        sending = cocotb.start_soon(bench.send(turn, pattern("always", random, 0)))
        await bench.receive(turn, pattern("always", random, 0))
        await sending
        # Taken a clock after it became valid.
        late = (bench.got_ps[-1] - bench.sent_ps[-1]) / (2 * bench.halves[1]) - 1
        assert STAGES <= late <= STAGES + 1, late
        await Timer(random.randrange(20_000), "ps")


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def a_word_passes_each_clock(dut):
    """From 16 places on, with clocks of one frequency."""
    for _ in range(5):
        bench = Bench(dut, 1.0)
        await bench.begin()
        await bench.run(20 * PLACES, pattern("always", random, 0), pattern("always", random, 0))
        gaps = {b - a for a, b in zip(bench.got_ps, bench.got_ps[1:], strict=False)}
        assert gaps == {2 * bench.halves[1]} or PLACES < 16
        for clock in bench.clocks:
            clock.cancel()

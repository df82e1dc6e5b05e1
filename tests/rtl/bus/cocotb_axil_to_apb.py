"""lipp_axil_to_apb between cocotbext-axi's channels, each with pauses of its own, and a memory with wait states.

sim/checks/lipp_axil_to_apb_checks.sv judges each clock beside it. Here: each request has its answer, in order.
"""

import os
import random
from itertools import pairwise

import cocotb
from buses import WORDS, merged, pauses, wrong
from cocotb.triggers import FallingEdge, with_timeout
from cocotbext.axi import AxiLiteBus, axil_channels
from rtl_coverage import Coverage
from streams import start_and_reset

TRANSFERS = int(os.environ["TRANSFERS"])
OKAY, SLVERR = 0, 2


class Bench:
    """The five channels, and the words that the memory must hold."""

    def __init__(self, dut):
        self.dut = dut
        bus = AxiLiteBus.from_prefix(dut, "s_axil")
        ports = {"clock": dut.clk_i, "reset": dut.rst_ni, "reset_active_level": False}
        self.aw = axil_channels.AxiLiteAWSource(bus.write.aw, **ports)
        self.w = axil_channels.AxiLiteWSource(bus.write.w, **ports)
        self.ar = axil_channels.AxiLiteARSource(bus.read.ar, **ports)
        self.b = axil_channels.AxiLiteBSink(bus.write.b, **ports)
        self.r = axil_channels.AxiLiteRSink(bus.read.r, **ports)
        self.words = [0] * WORDS
        self.strobes, self.answers = [], []

    async def begin(self, clocks):
        dut = self.dut
        dut.clocks_i.value = clocks
        await start_and_reset(dut)
        for ready in (dut.s_axil_awready, dut.s_axil_wready, dut.s_axil_arready):
            assert not ready.value
        await FallingEdge(dut.clk_i)

    def write(self, address, data, strobes):
        self.aw.send_nowait(axil_channels.AxiLiteAWTransaction(awaddr=address, awprot=random.randrange(8)))
        self.w.send_nowait(axil_channels.AxiLiteWTransaction(wdata=data, wstrb=strobes))
        word = address // 4
        if wrong(word):
            return SLVERR
        self.words[word] = merged(self.words[word], data, strobes)
        return OKAY

    def read(self, address):
        self.ar.send_nowait(axil_channels.AxiLiteARTransaction(araddr=address, arprot=random.randrange(8)))
        word = address // 4
        return (SLVERR, 0) if wrong(word) else (OKAY, self.words[word])

    async def answered(self, writes, reads):
        """The answers are these, in this order, and no more."""
        for response in writes:
            got = await with_timeout(self.b.recv(), 50, "us")
            assert int(got.bresp) == response
            self.answers.append(f"write {response}")
        for n, (response, data) in enumerate(reads):
            got = await with_timeout(self.r.recv(), 50, "us")
            assert int(got.rresp) == response, f"read {n}"
            if response == OKAY:  # beside SLVERR the data mean nothing
                assert int(got.rdata) == data, f"read {n}"
            self.answers.append(f"read {response}")
        assert self.b.empty()
        assert self.r.empty()


async def watch(dut, seen, clocks):
    """Count what happens on the channels at once."""
    for _ in range(clocks):
        await FallingEdge(dut.clk_i)
        offered = {c: bool(getattr(dut, f"s_axil_{c}valid").value) for c in ("aw", "w", "b", "ar", "r")}
        for channel, valid in offered.items():
            seen.point(f"{channel} waits", valid and not getattr(dut, f"s_axil_{channel}ready").value)
        seen.point("write and read together", offered["aw"] and offered["w"] and offered["ar"])
        seen.point("both answers together", offered["b"] and offered["r"])
        seen.point("address before data", offered["aw"] and not offered["w"])
        seen.point("data before address", offered["w"] and not offered["aw"])


@cocotb.test()
async def each_request_is_answered_once(dut):
    bench, seen = Bench(dut), Coverage("axil_to_apb", "random")
    await bench.begin(0)
    await bench.answered([bench.write(4 * word, random.getrandbits(32), 0xF) for word in range(WORDS)], [])
    for channel in (bench.aw, bench.w, bench.b, bench.ar, bench.r):
        channel.set_pause_generator(pauses())
    cocotb.start_soon(watch(dut, seen, 4000))
    done, parity = 0, 0
    while done < TRANSFERS:
        # Writes to every other word while the rest is read, so that the order of the two kinds is free.
        parity = 1 - parity
        writes, reads = [], []
        for _ in range(random.randint(0, 80)):
            address = random.randrange(WORDS // 2) * 8 + 4 * parity + random.randrange(4)
            bench.strobes.append(strobes := random.choice([0xF, random.randrange(16)]))
            writes.append(bench.write(address, random.getrandbits(32), strobes))
        for _ in range(random.randint(0, 80)):
            reads.append(bench.read(random.randrange(WORDS // 2) * 8 + 4 * (1 - parity) + random.randrange(4)))
        await bench.answered(writes, reads)
        done += len(writes) + len(reads)
    await bench.answered([], [bench.read(4 * word) for word in range(WORDS)])
    assert len(bench.answers) >= TRANSFERS
    seen.values("strobes", bench.strobes, range(16))
    seen.values("answer", bench.answers, [f"{kind} {response}" for kind in ("write", "read") for response in (0, 2)])
    seen.close()


@cocotb.test()
async def answers_take_the_clocks_that_are_said(dut):
    bench = Bench(dut)
    await bench.begin(1)
    await bench.answered([bench.write(4 * word, random.getrandbits(32), 0xF) for word in range(WORDS)], [])

    async def pulses(count):
        """The clocks at which requests are offered first and answers valid, from now on."""
        offered, answers = None, []
        for clock in range(1000):
            await FallingEdge(dut.clk_i)
            if offered is None and (dut.s_axil_awvalid.value or dut.s_axil_arvalid.value):
                offered = clock
            answers += [clock] * (bool(dut.s_axil_bvalid.value) + bool(dut.s_axil_rvalid.value))
            if len(answers) == count:
                return offered, answers
        raise AssertionError(answers)

    for n in (1, 2, 5, 16):
        dut.clocks_i.value = n
        for kinds in ("w", "r", "wr"):
            count = 12
            watching = cocotb.start_soon(pulses(count * len(kinds)))
            requests = [random.randrange(32) * 8 for _ in range(count)]
            writes = [bench.write(at, random.getrandbits(32), 0xF) for at in requests if "w" in kinds]
            reads = [bench.read(at + 4) for at in requests if "r" in kinds]
            await bench.answered(writes, reads)
            offered, answers = await watching
            assert answers[0] - offered == n + 3
            gaps = {b - a for a, b in pairwise(answers)}
            assert gaps == {n + 1 if kinds == "wr" else n + 2}, (n, kinds, answers)

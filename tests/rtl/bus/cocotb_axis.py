"""lipp_axis_to_rays and lipp_axis_from_rays: cocotbext-axi's source and sink on one side, plain rays on the other.

Any words, packets of any length, pauses at both ends; each field is packed here by the formulas of the headers.
"""

import logging
import os
import random
import struct

import cocotb
from buses import pauses
from cocotb.triggers import FallingEdge, with_timeout
from cocotbext.axi import AxiStreamBus, AxiStreamFrame, AxiStreamSink, AxiStreamSource
from rtl_coverage import Coverage
from streams import start_and_reset

TRANSFERS = int(os.environ["TRANSFERS"])
F = int(os.environ["BUS_F"])
#: Bits of the fields of a ray, of an exit ray, in the order of the bench's words.
RAY = (18, 18, F + 2, F + 2)
EXIT = (12, 12, F + 4, F + 4, F + 4, F + 2, F + 2, F + 2)


def packed(values, widths):
    word, at = 0, 0
    for value, bits in zip(values, widths, strict=True):
        word |= (value & ((1 << bits) - 1)) << at
        at += bits
    return word


def any_words(widths):
    """Signed words of some widths, often at an end of their range."""
    return [
        random.choice([-(1 << (n - 1)), (1 << (n - 1)) - 1, -1, 0, *(random.getrandbits(n) - (1 << (n - 1)),) * 6])
        for n in widths
    ]


def stream(kind, dut, prefix):
    """A source or a sink whose frames are lists of whole transfers."""
    bus = AxiStreamBus.from_prefix(dut, prefix)
    made = kind(bus, dut.clk_i, dut.rst_ni, False, byte_lanes=1)
    made.log.setLevel(logging.WARNING)
    return made


async def begin(dut):
    for port in (dut.s_axis_tvalid, dut.exit_valid_i, dut.ray_ready_i, dut.m_axis_tready):
        port.value = 0
    await start_and_reset(dut)
    for port in (dut.s_axis_tready, dut.exit_ready_o, dut.ray_valid_o, dut.m_axis_tvalid):
        assert not port.value
    await FallingEdge(dut.clk_i)


def lengths():
    """Lengths of packets, TRANSFERS together or a little more."""
    left = TRANSFERS
    while left > 0:
        length = random.choice([1, 1, 2, 3, random.randint(1, 200)])
        left -= length
        yield length


@cocotb.test()
async def rays_of_the_stream(dut):
    seen = Coverage("axis_to_rays", f"F{F}")
    source = stream(AxiStreamSource, dut, "s_axis")
    await begin(dut)
    source.set_pause_generator(pauses())
    expected = []
    for length in lengths():
        words, first = [], []
        for n in range(length):
            ray = any_words(RAY)
            # The bits above a word are its sign, or, for these are not read, noise.
            noise = random.choice([0, 0xFFFFFFFF])
            lanes = [w & ((1 << n) - 1) | (noise << n if random.random() < 0.2 else (w >> 31) << n)
                     for w, n in zip(ray, RAY, strict=True)]  # fmt: skip
            words.append(packed(lanes, (32, 32, 32, 32)))
            # tuser is a mark of its own: it need not be at the packet's first transfer.
            first.append(int(n == 0) ^ (random.random() < 0.05))
            expected.append(packed([*ray, first[-1], n == length - 1], (*RAY, 1, 1)))
            seen.point("first and last at once", first[-1] and n == length - 1)
        source.send_nowait(AxiStreamFrame(words, tuser=first))
    stall, got, waiting, clocks = pauses(), 0, None, 0
    while got < len(expected):
        ready = not next(stall)
        dut.ray_ready_i.value = ready
        valid = bool(dut.ray_valid_o.value)
        seen.point("output stalled", valid and not ready)
        seen.point("output wanted, nothing there", ready and not valid)
        seen.point("input stalled", dut.s_axis_tvalid.value and not dut.s_axis_tready.value)
        if valid:
            word = int(dut.ray_o.value)
            assert word == expected[got], f"ray {got}"
            got += ready
        else:
            assert waiting is None, "a stalled ray was withdrawn"
        waiting = (valid and not ready) or None
        await FallingEdge(dut.clk_i)
        clocks = 0 if valid else clocks + 1
        assert clocks < 1000
    dut.ray_ready_i.value = 1
    for _ in range(20):
        assert not dut.ray_valid_o.value, "one ray too many"
        await FallingEdge(dut.clk_i)
    seen.close()


@cocotb.test()
async def exit_rays_to_the_stream(dut):
    seen = Coverage("axis_from_rays", f"F{F}")
    sink = stream(AxiStreamSink, dut, "m_axis")
    await begin(dut)
    sink.set_pause_generator(pauses())
    words, expected = [], []
    for length in lengths():
        frame = ([], [])
        for n in range(length):
            i, j, *lengths_ = any_words(EXIT)
            status, first = random.randrange(5), int(n == 0) ^ (random.random() < 0.05)
            words.append(packed([i, j, *lengths_, status, first, n == length - 1], (*EXIT, 3, 1, 1)))
            # As the structure in C of the module's header.
            frame[0].append(int.from_bytes(struct.pack("<hhI6i", i, j, status, *lengths_), "little"))
            frame[1].append(first)
        expected.append(frame)

    async def offer():
        idle, sent, offered = pauses(), 0, False
        while sent < len(words):
            offered = offered or not next(idle)
            dut.exit_valid_i.value = offered
            if offered:
                dut.exit_i.value = words[sent]
            taken = offered and bool(dut.exit_ready_o.value)
            seen.point("input stalled", offered and not taken)
            seen.point("output stalled", dut.m_axis_tvalid.value and not dut.m_axis_tready.value)
            await FallingEdge(dut.clk_i)
            if taken:
                sent, offered = sent + 1, False
        dut.exit_valid_i.value = 0

    offering = cocotb.start_soon(offer())
    for n, (data, first) in enumerate(expected):
        got = await with_timeout(sink.recv(compact=False), 50, "us")
        assert list(got.tdata) == data, f"packet {n}"
        assert list(got.tuser) == first
    await offering
    for _ in range(20):
        await FallingEdge(dut.clk_i)
        assert not dut.m_axis_tvalid.value, "one ray too many"
    seen.point("packets", len(expected))
    seen.close()


@cocotb.test()
async def a_ray_passes_each_clock(dut):
    """Without pauses: out a clock after it came in, no clock is lost, whenever a reader stopped before."""
    await begin(dut)
    for stop in (0, 1, 2, 7):
        word, got = 0, []
        for clock in range(40):
            ready = not 10 <= clock < 10 + stop
            dut.s_axis_tvalid.value = dut.exit_valid_i.value = word < 20
            dut.s_axis_tdata.value = dut.exit_i.value = word
            dut.ray_ready_i.value = dut.m_axis_tready.value = ready
            assert dut.ray_valid_o.value == dut.m_axis_tvalid.value
            if dut.ray_valid_o.value and ready:
                assert int(dut.ray_o.value) & 0xFFF == int(dut.m_axis_tdata.value) & 0xFFF == len(got)
                got.append(clock)
            assert dut.s_axis_tready.value == dut.exit_ready_o.value
            word += bool(dut.s_axis_tready.value) and word < 20
            await FallingEdge(dut.clk_i)
        assert got == [*range(1, 10), *range(10 + stop, 21 + stop)]

"""lipp_axis_to_rays and lipp_axis_from_rays: any words, packets of any length, pauses at both ends.

Each field is packed here by the formulas of the headers. cocotb_optics_bus.py has cocotbext-axi's source and sink at
their streams.
"""

import os
import random
import struct
from collections import Counter

import cocotb
from packets import Joined
from rtl_coverage import Coverage
from streams import PAIRS, Monitor, pattern, start_and_reset

#: Transfers of one case, at least.
TRANSFERS = int(os.environ["TRANSFERS"]) // len(PAIRS)
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


def marks():
    """First and last of the transfers of packets; tuser is a mark of its own: it need not be at the first transfer."""
    count = 0
    while count < TRANSFERS:
        length = random.choice([1, 1, 2, 3, random.randint(1, 200)])
        count += length
        yield from ((int(n == 0) ^ (random.random() < 0.05), n == length - 1) for n in range(length))


def ray_of_the_stream(first, last):
    """A transfer, and the ray that it is."""
    ray = any_words(RAY)
    # The bits above a word are its sign, or, for these are not read, noise.
    noise = random.choice([0, 0xFFFFFFFF])
    lanes = [
        w & ((1 << n) - 1) | (noise << n if random.random() < 0.2 else (w >> 31) << n)
        for w, n in zip(ray, RAY, strict=True)
    ]
    return packed([*lanes, first, last], (32, 32, 32, 32, 1, 1)), packed([*ray, first, last], (*RAY, 1, 1))


def exit_ray(first, last):
    """An exit ray, and its transfer: as the structure in C of the module's header."""
    i, j, *lengths = any_words(EXIT)
    status = random.randrange(5)
    data = int.from_bytes(struct.pack("<hhI6i", i, j, status, *lengths), "little")
    return packed([i, j, *lengths, status, first, last], (*EXIT, 3, 1, 1)), packed([data, first, last], (256, 1, 1))


RAYS = {"axis_to_rays": ray_of_the_stream, "axis_from_rays": exit_ray}
SEEN = {module: Counter() for module in RAYS}


async def start(dut, module):
    dut.s_axis_tvalid.value = dut.exit_valid_i.value = dut.ray_ready_i.value = dut.m_axis_tready.value = 0
    await start_and_reset(dut)
    into, out = (Joined(*(getattr(dut, f"{end}_axis_{name}") for name in ("tlast", "tuser", "tdata"))) for end in "sm")
    if module == "axis_to_rays":
        handles = dut.s_axis_tvalid, dut.s_axis_tready, dut.ray_valid_o, dut.ray_ready_i, dut.ray_o, into.put
    else:
        handles = dut.exit_valid_i, dut.exit_ready_o, dut.m_axis_tvalid, dut.m_axis_tready, out, dut.exit_i
    monitor = Monitor(dut.clk_i, *handles)
    monitor.seen = SEEN[module]
    return monitor


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS), module=[*RAYS])
async def each_ray_passes_once(dut, module, idle, pressure):
    monitor = await start(dut, module)
    words, expected = zip(*(RAYS[module](*of_ray) for of_ray in marks()), strict=True)
    await monitor.run(words, pattern(idle, random, 20), pattern(pressure, random, 20), 500)
    assert monitor.got == list(expected)
    if idle == pressure == "always":  # out a clock after it came in, and no clock is lost
        assert monitor.left == list(range(monitor.accepted[0] + 1, monitor.accepted[0] + 1 + len(words)))


@cocotb.test()
async def coverage_is_complete(dut):
    for module, seen in SEEN.items():
        Coverage(module, f"F{F}", seen).close()

import random
import zlib

import cocotb
from cocotb.triggers import FallingEdge
from streams import PATTERNS, pattern, start_and_reset

PIXELS = int(cocotb.plusargs["Width"]) * int(cocotb.plusargs["Height"])
#: Clocks of a check beside one for each pixel: 7 of them are the block store's.
MORE = 9


async def begin(dut):
    """Random pixels in both buffers; their bytes."""
    dut.start_i.value = dut.buffer_i.value = dut.fill_i.value = dut.pause_i.value = 0
    await start_and_reset(dut)
    assert not dut.busy_o.value
    edge = FallingEdge(dut.clk_i)
    frames = [random.randbytes(3 * PIXELS) for _ in range(2)]
    for buffer, frame in enumerate(frames):
        dut.fill_buffer_i.value = buffer
        for at in range(PIXELS):
            dut.fill_at_i.value, dut.fill_rgb_i.value = at, int.from_bytes(frame[3 * at : 3 * at + 3])
            dut.fill_i.value = 1
            await edge
            while not dut.fill_done_o.value:
                await edge
            dut.fill_i.value = 0
            await edge
    return edge, frames


async def check(dut, edge, buffer, meddle, idle="always"):
    """The CRC of a buffer, and the clocks that it took."""
    dut.start_i.value, dut.buffer_i.value = 1, buffer
    clocks, active = 0, pattern(idle, random, 20)
    while clocks == 0 or not dut.done_o.value:
        dut.pause_i.value = not next(active)
        await edge
        clocks += 1
        # While it runs, a start means nothing, and neither does the buffer.
        dut.start_i.value = meddle and bool(dut.busy_o.value) and random.random() < 0.5
        dut.buffer_i.value = random.getrandbits(1)
        assert clocks < 20 * PIXELS + 400
    dut.pause_i.value = 0
    assert not dut.busy_o.value
    return int(dut.crc_o.value), clocks


@cocotb.test()
@cocotb.parametrize(idle=PATTERNS)
async def the_crc_of_either_buffer(dut, idle):
    edge, frames = await begin(dut)
    for turn in range(10):
        buffer = random.getrandbits(1)
        crc, clocks = await check(dut, edge, buffer, turn % 2, idle)
        assert crc == zlib.crc32(frames[buffer])
        assert idle != "always" or clocks == PIXELS + MORE
        # The next start may come with the end of this one.
        dut.start_i.value = 0
        for _ in range(random.choice([0, 0, 1, 5])):
            await edge
            assert not dut.done_o.value
            assert int(dut.crc_o.value) == crc


@cocotb.test()
async def reset_ends_a_check(dut):
    edge, frames = await begin(dut)
    for clocks in (1, 2, 3, 20, *range(PIXELS + 1, PIXELS + MORE)):
        dut.start_i.value = 1
        for _ in range(clocks):
            await edge
            dut.start_i.value = 0
        dut.rst_ni.value = 0
        await edge
        dut.rst_ni.value = 1
        for _ in range(PIXELS + MORE + 3):
            assert not dut.done_o.value
            assert not dut.busy_o.value
            await edge
        crc, _ = await check(dut, edge, 1, False)
        assert crc == zlib.crc32(frames[1])
        dut.start_i.value = 0
        await edge

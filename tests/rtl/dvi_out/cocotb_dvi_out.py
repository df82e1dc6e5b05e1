import random

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge, ReadOnly, RisingEdge, Timer
from tmds import CONTROLS, decoded

HALF_PS = 1346
#: Of a frame: pixels, and all of a line; lines, and all of a frame. Sync begins each line and each frame.
WIDTH, LINE, HEIGHT, LINES = 24, 44, 5, 8


def video(frames):
    """(de, hsync, vsync, rgb) of each pixel's time."""
    for _ in range(frames):
        for y in range(LINES):
            for x in range(LINE):
                active = x >= LINE - WIDTH and y >= LINES - HEIGHT
                yield active, x < 6, y < 2, random.getrandbits(24) if active else 0


def symbols_of(line):
    """The symbols of a wire's bits: the beginning is where most control symbols are."""
    cuts = [
        [sum(bit << k for k, bit in enumerate(line[n : n + 10])) for n in range(start, len(line) - 9, 10)]
        for start in range(10)
    ]
    return max(cuts, key=lambda cut: sum(symbol in CONTROLS for symbol in cut))


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(phase=[0.0, 0.3, 0.9])
async def frames_from_the_wires(dut, phase):
    dut.pixel_rst_ni.value = dut.shift_rst_ni.value = 0
    dut.de_i.value = dut.hsync_i.value = dut.vsync_i.value = dut.rgb_i.value = 0
    clocks = [cocotb.start_soon(Clock(dut.shift_clk_i, 2 * HALF_PS, "ps").start())]
    await Timer(20_000 + round(2 * HALF_PS * phase), "ps")
    clocks += [cocotb.start_soon(Clock(dut.pixel_clk_i, 10 * HALF_PS, "ps").start())]
    await Timer(40_000, "ps")
    dut.pixel_rst_ni.value = dut.shift_rst_ni.value = 1
    wires = [[] for _ in range(4)]

    async def listen():
        while True:
            await RisingEdge(dut.shift_clk_i)
            await ReadOnly()
            pairs = int(dut.pair_o.value)
            for k in range(4):
                wires[k] += [pairs >> 2 * k & 1, pairs >> 2 * k + 1 & 1]

    listening = cocotb.start_soon(listen())
    shown = list(video(3))
    for de, hsync, vsync, rgb in shown:
        await FallingEdge(dut.pixel_clk_i)
        dut.de_i.value, dut.hsync_i.value, dut.vsync_i.value, dut.rgb_i.value = de, hsync, vsync, rgb
    for _ in range(8):
        await FallingEdge(dut.pixel_clk_i)
    for task in (listening, *clocks):
        task.cancel()

    channels = [[decoded(symbol) for symbol in symbols_of(wire)] for wire in wires[:3]]
    expected = [
        (rgb & 255, rgb >> 8 & 255, rgb >> 16) if de else (256 + 2 * vsync + hsync, 256, 256)
        for de, hsync, vsync, rgb in shown
    ]
    # The first symbols may be lost while the count finds its place.
    for channel, column in zip(channels, zip(*expected, strict=True), strict=True):
        wanted = list(column)[10:]
        places = [n for n in range(len(channel)) if channel[n : n + len(wanted)] == wanted]
        assert len(places) == 1
    # The clock's wire: five bits high, five low, and high in the first bits of each symbol.
    begin = next(n for n in range(200, 210) if not wires[3][n - 1] and wires[3][n])
    assert all(wires[3][n] == ((n - begin) % 10 < 5) for n in range(200, len(wires[3])))
    # So the clock tells where symbols begin on the other wires.
    line = wires[0][begin:]
    blue = [sum(bit << k for k, bit in enumerate(line[n : n + 10])) for n in range(0, len(line) - 9, 10)]
    assert sum(symbol in CONTROLS for symbol in blue) >= len(shown) // 2

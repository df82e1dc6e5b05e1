"""scan_out in the simulator: every clock of small frames, with swaps, brightness and patterns between them."""

import random
import zlib

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge
from rtl_coverage import Coverage
from streams import hold_reset

T = {name: int(value) for name, value in cocotb.plusargs.items() if name[0] in "HVWGC"}
WIDTH, HEIGHT = T["Width"], T["Height"]
LEFT, TOP = T["HSync"] + T["HBack"], T["VSync"] + T["VBack"]
LINE, LINES = LEFT + WIDTH + T["HFront"], TOP + HEIGHT + T["VFront"]
OFF, VIEWS, CHECKER, RAMP = 0, 3, 4, 5
CLOCKS = T["ClocksPerPixel"]
H, V = T["HPositive"], T["VPositive"]


class Bench:
    def __init__(self, dut):
        self.dut, self.edge = dut, FallingEdge(dut.clk_i)
        self.release = 0  # clocks until the request for a swap is taken back

    async def reset(self):
        dut = self.dut
        self.shown = False  # no buffer was swapped in
        await hold_reset(dut)
        # Black, no sync, nothing swapped.
        assert int(dut.out_o.value) & ~(3 << 29) == (1 - V) << 26 | (1 - H) << 25

    async def begin(self):
        dut = self.dut
        dut.swap_i.value = dut.kind_i.value = dut.fill_i.value = dut.view_i.value = dut.scene_i.value = 0
        dut.key_i.value = 0
        dut.brightness_i.value = 255
        Clock(dut.clk_i, 2, unit="ns").start()
        await self.reset()
        dut.rst_ni.value = 0
        rng = np.random.default_rng(random.getrandbits(32))
        self.store = rng.integers(0, 256, (2, HEIGHT, WIDTH, 3), np.uint8)
        dut.fill_i.value = 1
        for buffer in (0, 1):
            dut.fill_buffer_i.value = buffer
            for at, rgb in enumerate(self.store[buffer].reshape(-1, 3)):
                dut.fill_at_i.value, dut.fill_rgb_i.value = at, int.from_bytes(rgb.tobytes())
                await self.edge
        dut.fill_i.value = 0
        await self.reset()

    async def to_vertical_sync(self):
        """From reset to the first clock of vertical sync."""
        for _ in range(40):
            out = int(self.dut.out_o.value)
            assert out >> 24 & 1 == 0
            if out >> 26 & 1 == V:
                return
            await self.edge
        raise AssertionError("no vertical sync")

    def picture(self, front, brightness, kind, view=0, key=None):
        """Pixels that must leave, (height, width, 3); the scene's, where it has a key."""
        pixels = self.store[front] * self.shown
        if key is not None:
            words = np.arange(WIDTH * HEIGHT, dtype=np.int64) * 0x9E3779 % (1 << 24) ^ key
            pixels = (words[:, None] >> np.array([16, 8, 0]) & 255).reshape(HEIGHT, WIDTH, 3)
        if kind == CHECKER:
            white = (np.arange(HEIGHT)[:, None] // 32 + np.arange(WIDTH) // 32) % 2
            pixels = np.repeat(255 * white[..., None], 3, 2)
        elif kind == VIEWS:
            pixels = np.broadcast_to([view, 128, 0], (HEIGHT, WIDTH, 3))
        elif kind == RAMP:
            pixels = np.broadcast_to(np.arange(WIDTH)[None, :, None] % 256, (HEIGHT, WIDTH, 3))
        return (pixels.astype(int) * (brightness + 1) >> 8).astype(np.uint8)

    async def frame(self, picture, at_line=None, settings=None):
        """Compare a frame from vertical sync to the next; change settings and ask for a swap on the way.

        Whether a swap came.
        """
        takes = 0
        dut, front, swapped = self.dut, None, False
        words = [[int.from_bytes(p.tobytes()) for p in row] for row in picture]
        frames = int(dut.frames_o.value)
        for y in range(LINES):
            if y == at_line:
                self.release = 0  # a request that begins now is not the one that was answered
                for name, value in settings.items():
                    getattr(dut, name).value = value
            for clock in range(LINE * CLOCKS):
                x = clock // CLOCKS
                out = int(dut.out_o.value)
                row, column = y - TOP, x - LEFT
                begins = clock % CLOCKS == 0
                assert out >> 30 == begins, f"line {y}, clock {clock}"
                takes += int(dut.want_o.value)
                shows = 0 <= row < HEIGHT and 0 <= column < WIDTH
                vsync, hsync = (y < T["VSync"]) == V, (x < T["HSync"]) == H
                wanted = (row == column == 0 and begins) << 3 | vsync << 2 | hsync << 1 | shows
                assert out >> 24 & 0b1111 == wanted, f"line {y}, clock {x}"
                assert out & 0xFFFFFF == (words[row][column] if shows else 0), f"row {row}, column {column}"
                # A swap comes with the next vertical sync, a few clocks ahead of the output.
                front = out >> 29 & 1 if front is None else front
                if out >> 28 & 1:
                    assert (LINES - y) * LINE * CLOCKS - clock == 2
                    self.release = random.randint(1, 4)
                    swapped, front, self.shown = True, 1 - front, True
                self.release -= 1
                if self.release == 0:
                    dut.swap_i.value = 0
                assert out >> 29 & 1 == front
                # Clocks behind the first one of the last pixel.
                done = ((row - HEIGHT + 1) * LINE - LEFT - WIDTH + 1) * CLOCKS + clock >= 2
                assert int(dut.frames_o.value) == frames + done, f"line {y}, clock {x}"
                if done:
                    assert int(dut.shown_crc_o.value) == zlib.crc32(picture.tobytes())
                await self.edge
        assert takes == WIDTH * HEIGHT, "pixels wanted"
        return swapped


@cocotb.test()
async def every_clock(dut):
    bench = Bench(dut)
    await bench.begin()
    await bench.to_vertical_sync()
    seen = Coverage("scan_out", f"{WIDTH}x{HEIGHT}-{T['Grid']}{H}{V}-{CLOCKS}")
    front, brightness, kind, view, key = 0, 255, OFF, 0, None
    for turn in range(14):
        picture = bench.picture(front, brightness, kind, view, key)
        seen.point("black before the first swap", not bench.shown and kind == OFF and key is None)
        seen.point("the scene", key is not None and kind == OFF)
        seen.point("a pattern before the scene", key is not None and kind != OFF)
        if (brightness, kind, key) == (255, OFF, None) and bench.shown:
            assert (picture == bench.store[front]).all()
            seen.point("the store, byte for byte", 1)
        swap = random.getrandbits(1)
        brightness_next = [255, 0, 128, 1, 254, 255, random.randrange(256)][turn % 7]
        kind_next = [OFF, CHECKER, VIEWS, VIEWS, RAMP][turn % 5]
        view_next = random.randrange(256)
        key_next = random.getrandbits(24) if [0, 0, 1, 0, 0, 1, 0, 1, 1, 0, 0, 1, 0, 0][turn] else None
        settings = {
            "swap_i": swap, "brightness_i": brightness_next, "kind_i": kind_next, "view_i": view_next,
            "scene_i": key_next is not None, "key_i": key_next or 0,
        }  # fmt: skip
        # Settings of the next frame, made at any line, do not show in this one.
        swapped = await bench.frame(picture, random.randrange(LINES), settings)
        assert swapped == bool(swap)
        seen.point("optics changed within their pattern", kind == VIEWS and view_next != view)
        front, brightness, kind, view, key = front ^ swap, brightness_next, kind_next, view_next, key_next
        seen.point("swap", swap)
        seen.point("no swap", not swap)
        seen.values("kind", kind, (OFF, VIEWS, CHECKER, RAMP))
    seen.close()


@cocotb.test()
async def reset_begins_a_frame(dut):
    bench = Bench(dut)
    await bench.begin()
    for clocks in (1, LINE // 2, (LINE * TOP + LEFT) * CLOCKS + 30, LINE * LINES * CLOCKS - 5):
        dut.swap_i.value = 1
        for _ in range(clocks):
            await bench.edge
        dut.swap_i.value = 0
        await bench.reset()
        assert int(dut.frames_o.value) == 0
        await bench.to_vertical_sync()
        await bench.frame(bench.picture(0, 255, OFF))

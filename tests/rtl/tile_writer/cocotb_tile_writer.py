"""tile_writer in the simulator, in front of a store that pauses.

What is written is watched at every clock; on small panels the whole store is read back as well.
"""

import random
import zlib
from itertools import product

import cocotb
import numpy as np
import qoi
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge
from pins import Pins
from rtl_coverage import Coverage
from streams import PATTERNS, hold_reset, pattern

WIDTH, HEIGHT = int(cocotb.plusargs["Width"]), int(cocotb.plusargs["Height"])
PLACE_BITS = (WIDTH * HEIGHT - 1).bit_length()
COLUMNS, ROWS = -(-WIDTH // 32), -(-HEIGHT // 32)
TILES = COLUMNS * ROWS
#: Clocks of a tile until its first byte is taken.
FIRST = 3 + max((ROWS - 1).bit_length(), 1)
#: Clocks of the store, which never pauses, for a row beside those of its pixels: asked, offered, settled.
ROW = 3
SMALL = WIDTH * HEIGHT < 5000
RAW, SOLID, QOI, COPY = range(4)
#: When bytes come, and when the store works.
ENDS = [
    *(("always", "always"), ("light", "heavy"), ("heavy", "light")),
    *(("bursts", "bursts"), ("stuck", "always"), ("always", "stuck")),
]
SEEN = Coverage("tile_writer", f"{WIDTH}x{HEIGHT}")


def box(tile):
    """Rows and columns of a tile."""
    top, left = tile // COLUMNS * 32, tile % COLUMNS * 32
    return slice(top, min(top + 32, HEIGHT)), slice(left, min(left + 32, WIDTH))


def shape(tile):
    rows, columns = box(tile)
    return rows.stop - rows.start, columns.stop - columns.start


def some_tiles():
    """The corners, and others."""
    corners = {0, COLUMNS - 1, TILES - COLUMNS, TILES - 1}
    return [*corners, *(random.randrange(TILES) for _ in range(4))]


def picture(height, width, kind):
    """Pixels (height, width, 3) that exercise all operations of QOI."""
    rng = np.random.default_rng(random.getrandbits(32))
    if kind == "noise":
        return rng.integers(0, 256, (height, width, 3), np.uint8)
    if kind == "black":
        return np.zeros((height, width, 3), np.uint8)
    if kind == "palette":
        return rng.integers(0, 256, (9, 3), np.uint8)[rng.integers(0, 9, (height, width))]
    # Steps of one, or in brightness, which wrap at 0 and 255; long runs between them.
    steps = rng.integers(-2, 2, (height * width, 3)) if kind == "small steps" else (
        rng.integers(-32, 32, (height * width, 1)) + rng.integers(-8, 8, (height * width, 3)) * [1, 0, 1]
    )  # fmt: skip
    steps[rng.random(height * width) < 0.3] = 0
    return np.cumsum(steps, 0).astype(np.uint8).reshape(height, width, 3)


KINDS = ("noise", "black", "palette", "small steps", "large steps")


def qoi_ops(pixels):
    return qoi.encode(np.ascontiguousarray(pixels))[14:-8]


def pixels_of(data):
    """How many pixels QOI's operations give, or None where they are cut short or not for RGB."""
    count = at = 0
    while at < len(data):
        op = data[at]
        if op == 0xFF:
            return None
        at += 4 if op == 0xFE else 2 if op >> 6 == 2 else 1
        count += (op & 63) + 1 if op >> 6 == 3 and op != 0xFE else 1
    return count if at == len(data) else None


class Bench:
    def __init__(self, dut):
        self.dut, self.edge = Pins(dut), FallingEdge(dut.clk_i)
        Clock(dut.clk_i, 2, unit="ns").start()
        self.store = np.zeros((2, HEIGHT, WIDTH, 3), np.uint8)
        self.pauses = "always"  # when the store works
        self.inputs = ("pause_i", "start_i", "tile_i", "coding_i", "buffer_i", "empty_i", "valid_i", "data_i", "last_i",
                       "fill_i", "at_buffer_i", "at_i", "rgb_i")  # fmt: skip

    async def begin(self):
        dut = self.dut
        for name in self.inputs:
            getattr(dut, name).value = 0
        await hold_reset(dut, self.edge)
        await self.fill()

    async def fill(self):
        """Random pixels everywhere, as far as the test can tell them."""
        dut = self.dut
        rng = np.random.default_rng(random.getrandbits(32))
        self.store = rng.integers(0, 256, self.store.shape, np.uint8)
        regions = [(slice(0, HEIGHT), slice(0, WIDTH))] if SMALL else map(box, {0, COLUMNS - 1, TILES - 1})
        dut.fill_i.value = 1
        for (rows, columns), buffer in product(regions, (0, 1)):
            dut.at_buffer_i.value = buffer
            for y, x in product(range(rows.start, rows.stop), range(columns.start, columns.stop)):
                dut.at_i.value, dut.rgb_i.value = y * WIDTH + x, int.from_bytes(self.store[buffer, y, x].tobytes())
                await self.edge
        dut.fill_i.value = 0

    async def read_back(self):
        """The whole store is as the test knows it."""
        if not SMALL:
            return
        dut, got = self.dut, []
        for at in range(2 * WIDTH * HEIGHT + 1):
            if at >= 1:
                got.append(int(dut.rgb_o.value))
            dut.at_buffer_i.value = at // (WIDTH * HEIGHT) % 2
            dut.at_i.value = at % (WIDTH * HEIGHT)
            await self.edge
        wanted = [int.from_bytes(p.tobytes()) for p in self.store.reshape(-1, 3)]
        assert got == wanted, "the store is not as written"

    async def tile(self, tile, coding, data, buffer, idle="always"):
        """Write a tile: whether it went well, its CRC, pixels written in order (place, colour), and clocks."""
        dut, idles, works = self.dut, pattern(idle, random, 20), pattern(self.pauses, random, 20)
        dut.tile_i.value, dut.coding_i.value, dut.buffer_i.value = tile, coding, buffer
        dut.start_i.value, dut.empty_i.value = 1, not data
        sent, written, clocks, offered = 0, [], 0, False
        # Bytes that wait before and behind the packet are none of the writer's business.
        dut.valid_i.value, dut.data_i.value, dut.last_i.value = 1, random.getrandbits(8), random.getrandbits(1)
        assert not dut.ready_o.value
        while True:
            await self.edge
            clocks += 1
            dut.start_i.value = 0
            dut.pause_i.value = not next(works)
            # What was copied at the start may change.
            dut.tile_i.noise(16)
            dut.coding_i.noise(8)
            dut.empty_i.noise(1)
            dut.buffer_i.noise(1)
            word = int(dut.written_o.value)
            if word >> (PLACE_BITS + 25):
                assert word >> (PLACE_BITS + 24) & 1 == buffer
                written.append((word >> 24 & ((1 << PLACE_BITS) - 1), word & 0xFFFFFF))
            ready = bool(dut.ready_o.value)
            if dut.done_o.value:
                assert not ready
                ended = bool(dut.ok_o.value), int(dut.crc_o.value)
                break
            if sent < len(data):
                offered = offered or next(idles)
                dut.valid_i.value, dut.data_i.value, dut.last_i.value = offered, data[sent], sent == len(data) - 1
                if offered and ready:
                    sent, offered = sent + 1, False
            else:
                assert not ready, "a byte of the next packet was taken"
                dut.valid_i.value = dut.last_i.value = 1
                dut.data_i.noise(8)
            assert clocks < 12 * (len(data) + 200) + (1100 if self.pauses == "always" else 25000), "no end"
        assert sent == len(data), "not all of the packet was taken"
        dut.valid_i.value = 0
        await self.edge
        assert not dut.done_o.value
        assert not int(dut.written_o.value) >> (PLACE_BITS + 25)
        return *ended, written, clocks

    async def good(self, tile, coding, data, pixels, buffer, idle="always"):
        """A tile that must become these pixels; clocks."""
        pixels = np.asarray(pixels, np.uint8)
        ok, crc, written, clocks = await self.tile(tile, coding, data, buffer, idle)
        assert ok, (tile, coding)
        assert crc == zlib.crc32(pixels.tobytes())
        rows, columns = box(tile)
        places = [y * WIDTH + x for y in range(rows.start, rows.stop) for x in range(columns.start, columns.stop)]
        assert [at for at, _ in written] == places
        assert [rgb for _, rgb in written] == [int.from_bytes(p.tobytes()) for p in pixels.reshape(-1, 3)]
        self.store[buffer, rows, columns] = pixels
        if WIDTH % 32 or HEIGHT % 32:
            SEEN.point("cut tile", shape(tile) != (32, 32))
        return clocks

    async def bad(self, tile, coding, data, buffer, idle="always"):
        """A tile that must be refused; what was written lies inside."""
        ok, _, written, _ = await self.tile(tile, coding, data, buffer, idle)
        assert not ok, (tile, coding, data[:40])
        self.inside(tile, written, buffer)
        return len(written)

    def inside(self, tile, written, buffer):
        if tile >= TILES:
            assert not written
            return
        rows, columns = box(tile)
        for at, rgb in written:
            y, x = divmod(at, WIDTH)
            assert rows.start <= y < rows.stop
            assert columns.start <= x < columns.stop
            self.store[buffer, y, x] = list(rgb.to_bytes(3))


@cocotb.test()
@cocotb.parametrize((("idle", "pauses"), ENDS))
async def good_tiles_become_their_pixels(dut, idle, pauses):
    bench = Bench(dut)
    await bench.begin()
    bench.pauses = pauses
    for turn, tile in enumerate(some_tiles()):
        height, width = shape(tile)
        pixels = picture(height, width, KINDS[turn % len(KINDS)])
        buffer = random.getrandbits(1)
        if turn % 2:
            await bench.good(tile, RAW, pixels.tobytes(), pixels, buffer, idle)
        colour = picture(1, 1, "noise")
        await bench.good(tile, SOLID, colour.tobytes(), np.broadcast_to(colour, pixels.shape), 1 - buffer, idle)
        data = qoi_ops(pixels)
        await bench.good(tile, QOI, data, pixels, buffer, idle)
        at = 0
        while at < len(data):
            name = "rgb" if data[at] == 0xFE else ("index", "diff", "luma", "run")[data[at] >> 6]
            SEEN.point(name, 1)
            at += {"rgb": 4, "luma": 2}.get(name, 1)
        assert at == len(data)
        SEEN.point(f"idle {idle}", 1)
    await bench.read_back()


@cocotb.test()
@cocotb.parametrize(pauses=PATTERNS)
async def a_tile_is_copied_from_the_other_buffer(dut, pauses):
    bench = Bench(dut)
    await bench.begin()
    bench.pauses = pauses
    for tile in sorted({0, COLUMNS - 1, TILES - 1} | (set(range(TILES)) if SMALL else set())):
        buffer = random.getrandbits(1)
        rows, columns = box(tile)
        if random.getrandbits(1):  # between tiles of another kind
            colour = picture(1, 1, "noise")
            await bench.good(tile, SOLID, colour.tobytes(), np.broadcast_to(colour, (*shape(tile), 3)), 1 - buffer)
        clocks = await bench.good(tile, COPY, b"", bench.store[1 - buffer, rows, columns].copy(), buffer)
        height, width = shape(tile)
        assert pauses != "always" or clocks == FIRST + height * (width + ROW + 1) - 1
        SEEN.point("copies", 1)
    await bench.read_back()


@cocotb.test()
async def operations_that_no_encoder_chooses(dut):
    """Any operation anywhere, as QOI's decoder reads it: runs broken up, the index where a difference would do."""
    bench = Bench(dut)
    await bench.begin()
    for _ in range(6):
        tile = random.choice(some_tiles())
        height, width = shape(tile)
        data, count, known = bytearray(), 0, {}
        last = (0, 0, 0)
        while count < height * width:
            op = random.choice(["rgb", "index", "diff", "luma", "run"])
            run = 1
            if op == "index":
                if not known:
                    continue
                at = random.choice(list(known))
                data.append(at)
                last = known[at]
            elif op == "rgb":
                last = tuple(random.randbytes(3))
                data += bytes([0xFE, *last])
            elif op == "diff":
                step = [random.randrange(4) for _ in range(3)]
                data.append(0x40 | step[0] << 4 | step[1] << 2 | step[2])
                last = tuple((p + s - 2) % 256 for p, s in zip(last, step, strict=True))
            elif op == "luma":
                green, red, blue = random.randrange(64), random.randrange(16), random.randrange(16)
                data += bytes([0x80 | green, red << 4 | blue])
                step = (green - 32 + red - 8, green - 32, green - 32 + blue - 8)
                last = tuple((p + s) % 256 for p, s in zip(last, step, strict=True))
            else:
                run = random.randint(1, min(62, height * width - count))
                data.append(0xC0 | run - 1)
            r, g, b = last
            known[(3 * r + 5 * g + 7 * b + 11 * 255) % 64] = last
            count += run
        header = b"qoif" + width.to_bytes(4) + height.to_bytes(4) + b"\x03\x00"
        pixels = qoi.decode(header + bytes(data) + b"\0\0\0\0\0\0\0\1")
        assert pixels.shape == (height, width, 3)
        await bench.good(tile, QOI, bytes(data), pixels, 1, "light")
    # An index that was never written is black.
    tile = TILES - 1
    size = np.prod(shape(tile))
    await bench.good(tile, QOI, b"\x07" * size, np.zeros((*shape(tile), 3)), 0)
    await bench.read_back()


@cocotb.test()
async def bad_data_are_refused(dut):
    bench = Bench(dut)
    await bench.begin()
    # All of them at a tile that is cut, and at any other.
    for tile in {TILES - 1, random.randrange(TILES)}:
        height, width = shape(tile)
        size = height * width
        raw = random.randbytes(3 * size)
        pixels = picture(height, width, random.choice(KINDS))
        ops = qoi_ops(pixels)
        runs, rest = divmod(size - 1, 62)
        run = b"\xfe123" + b"\xfd" * runs + (bytes([0xC0 | rest - 1]) if rest else b"")
        assert pixels_of(run) == size
        cases = {
            "raw short by a byte": (RAW, raw[:-1]),
            "raw short by a pixel": (RAW, raw[:-3]),
            "raw long by a byte": (RAW, raw + b"x"),
            "raw long by a row": (RAW, raw + raw[: 3 * width]),
            "raw empty": (RAW, b""),
            "solid of two bytes": (SOLID, b"ab"),
            "solid of four bytes": (SOLID, b"abcd"),
            "solid empty": (SOLID, b""),
            "qoi cut": (QOI, ops[: random.randrange(len(ops))]),
            "qoi cut by a byte": (QOI, ops[:-1]),
            "qoi empty": (QOI, b""),
            "qoi with a pixel more": (QOI, ops + b"\x00"),
            "qoi with half an operation more": (QOI, ops + b"\xfe"),
            "qoi with its end marker": (QOI, ops + b"\0\0\0\0\0\0\0\1"),
            "run over the end": (QOI, run + b"\xc0"),
            "last run too long": (QOI, b"\xfd" * (size // 62 + 1)),
            "alpha": (QOI, ops[:1] + b"\xff1234" + ops),
            "alpha at the end": (QOI, ops + b"\xff1234"),
            "copy with data": (COPY, b"a"),
            "coding 4": (4, raw),
            "coding 255": (255, b""),
        }
        for name, (coding, data) in cases.items():
            buffer = random.getrandbits(1)
            many = await bench.bad(tile, coding, bytes(data), buffer, random.choice(PATTERNS[:2]))
            SEEN.point(name, 1)
            SEEN.point("refused with the whole tile written", many == size)
            # The next one is as good as ever.
            if random.random() < 0.3:
                await bench.good(tile, QOI, ops, pixels, buffer)
        # Neither a tile that the panel lacks.
        for missing in (TILES, TILES + COLUMNS, 65535, random.randint(TILES, 65535)):
            for coding, data in ((RAW, raw[:300]), (SOLID, b"abc"), (QOI, b"\xc0" * 40), (COPY, b"")):
                await bench.bad(missing, coding, data, 0)
    await bench.read_back()


@cocotb.test()
async def random_bytes_stay_in_their_tile(dut):
    bench = Bench(dut)
    await bench.begin()
    good = False
    for turn in range(1000):
        if turn >= 50 and good:
            break
        tile, buffer = random.randrange(TILES + 1), random.getrandbits(1)
        size = np.prod(shape(tile)) if tile < TILES else 0
        data = random.randbytes(random.choice([3, random.randint(1, 60), random.randint(1, 3 * size + 1)]))
        # Save a few, they hold no QOI_OP_RGBA, and runs bring them to the tile's end, or nearly.
        if random.random() < 0.8:
            data = data.replace(b"\xff", b"\xfd")
        while random.random() < 0.98 and (count := pixels_of(data)) is not None and count < size:
            data += bytes([0xC0 | min(size - count, 62) - 1])
        coding = random.choice([RAW, SOLID, QOI, QOI, QOI])
        ok, crc, written, _ = await bench.tile(tile, coding, data, buffer, random.choice(PATTERNS))
        count = {RAW: len(data) / 3, SOLID: size if len(data) == 3 else None, QOI: pixels_of(data)}[coding]
        assert ok == (tile < TILES and count == size), (tile, coding, data)
        bench.inside(tile, written, buffer)
        if ok:
            rows, columns = box(tile)
            assert crc == zlib.crc32(bench.store[buffer, rows, columns].tobytes())
            assert len(written) == size
        good = good or ok
        SEEN.point("random data that are good", ok)
        SEEN.point("random data that are bad", not ok)
    await bench.read_back()


@cocotb.test()
async def a_pixel_a_clock(dut):
    """As fast as the bytes, or as the store's rows: each takes its pixels and three clocks."""
    bench = Bench(dut)
    await bench.begin()
    for tile in some_tiles():
        (height, width), size = shape(tile), np.prod(shape(tile))
        pixels = picture(*shape(tile), "noise")
        # Three clocks a pixel to bring its bytes, or those that the store takes for the rows: the slower of the two.
        clocks = max(3 * size, height * (width + ROW))
        assert await bench.good(tile, RAW, pixels.tobytes(), pixels, 0) == FIRST + clocks + 2
        solid = np.broadcast_to(np.array([200, 100, 50], np.uint8), (*shape(tile), 3))
        assert await bench.good(tile, SOLID, solid[0, 0].tobytes(), solid, 0) == FIRST + 2 + height * (width + ROW)
        # The first pixel takes four bytes, and runs a clock for each pixel.
        assert await bench.good(tile, QOI, qoi_ops(solid), solid, 0) == FIRST + 3 + height * (width + ROW)


@cocotb.test()
async def reset_ends_a_tile(dut):
    bench = Bench(dut)
    dut = bench.dut
    await bench.begin()
    for clocks in (1, 3, 9, 40):
        dut.tile_i.value, dut.coding_i.value, dut.buffer_i.value, dut.empty_i.value = 0, SOLID, 0, 0
        dut.start_i.value = dut.valid_i.value = 1
        dut.last_i.value = 0
        for _ in range(clocks):
            await bench.edge
            dut.start_i.value = 0
        dut.valid_i.value = dut.rst_ni.value = 0
        for _ in range(3):
            await bench.edge
        assert not int(dut.written_o.value) >> (PLACE_BITS + 25)
        dut.rst_ni.value = 1
        await bench.edge
        pixels = picture(*shape(0), "palette")
        await bench.good(0, QOI, qoi_ops(pixels), pixels, 0)


@cocotb.test()
async def coverage_is_complete(dut):
    SEEN.close()

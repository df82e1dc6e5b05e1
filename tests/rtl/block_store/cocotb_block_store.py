import random

import cocotb
from cocotb.triggers import ClockCycles, FallingEdge
from streams import pattern, start_and_reset

WIDTH, HEIGHT = int(cocotb.plusargs["Width"]), int(cocotb.plusargs["Height"])
PIXELS = WIDTH * HEIGHT
REQUESTS = 60
PATTERNS = ("always", "light", "heavy", "bursts")


class Store:
    """All values that each place ever had, and the number of the last one that is there for certain."""

    def __init__(self):
        self.values, self.settled = {}, {}

    def begin(self, place, pixel):
        """A request that writes this pixel runs: it may be there."""
        self.values.setdefault(place, []).append(pixel)

    def settle(self, place):
        self.settled[place] = len(self.values[place]) - 1

    def newest(self, place):
        return self.values[place][self.settled[place]]


class Bench:
    def __init__(self, dut):
        self.dut, self.store = dut, Store()

    def port(self, client, name):
        return getattr(self.dut, f"{client}_{name}")

    async def ask(self, client, buffer, first, count):
        """Offer a request until it is taken; between the two falling edges around the clock that takes it, return."""
        for name, value in (("valid_i", 1), ("buffer_i", buffer), ("first_i", first), ("count_i", count)):
            self.port(client, name).value = value
        while not self.port(client, "ready_o").value:
            await FallingEdge(self.dut.clk_i)
        await FallingEdge(self.dut.clk_i)
        self.port(client, "valid_i").value = 0

    async def read(self, client, buffer, first, count, active):
        """The pixels of a request, and the falling edges from its being taken to each of them."""
        places = [(buffer, first + n) for n in range(count)]
        since = [self.store.settled[place] for place in places]
        await self.ask(client, buffer, first, count)
        got, late, edges = [], [], 0
        while len(got) < count:
            assert not self.port(client, "ready_o").value, "the next request is taken too soon"
            ready = next(active)
            self.port(client, "pixel_ready_i").value = ready
            if ready and self.port(client, "pixel_valid_o").value:
                got.append(int(self.port(client, "rgb_o").value))
                late.append(edges)
            await FallingEdge(self.dut.clk_i)
            edges += 1
        self.port(client, "pixel_ready_i").value = 0
        assert not self.port(client, "pixel_valid_o").value, "a pixel too many"
        for place, pixel, known in zip(places, got, since, strict=True):
            assert pixel in self.store.values[place][known:], (client, place)
        return got, late

    async def write(self, buffer, first, pixels, active):
        places = [(buffer, first + n) for n in range(len(pixels))]
        for place, pixel in zip(places, pixels, strict=True):
            self.store.begin(place, pixel)
        await self.ask("write", buffer, first, len(pixels))
        sent = 0
        while sent < len(pixels):
            assert not self.dut.write_done_o.value
            offered = next(active)
            self.dut.write_pixel_valid_i.value = offered
            self.dut.write_rgb_i.value = pixels[sent]
            sent += bool(offered and self.dut.write_pixel_ready_o.value)
            await FallingEdge(self.dut.clk_i)
        self.dut.write_pixel_valid_i.value = 0
        assert self.dut.write_done_o.value
        for place in places:
            self.store.settle(place)

    async def write_all(self, buffer):
        """Fill a buffer; its pixels."""
        pixels = [random.getrandbits(24) for _ in range(PIXELS)]
        await self.write(buffer, 0, pixels, pattern("always", random, 0))
        return pixels


async def begin(dut):
    dut.show_valid_i.value = dut.write_valid_i.value = dut.read_valid_i.value = 0
    dut.show_pixel_ready_i.value = dut.read_pixel_ready_i.value = dut.write_pixel_valid_i.value = 0
    await start_and_reset(dut)
    return Bench(dut)


def span():
    count = random.choice([1, 2, random.randint(1, PIXELS), PIXELS])
    return random.randint(0, 1), random.randint(0, PIXELS - count), count


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def what_was_written_is_read(dut):
    bench = await begin(dut)
    for buffer in (0, 1):
        await bench.write_all(buffer)

    async def reads(client):
        for _ in range(REQUESTS):
            await bench.read(client, *span(), pattern(random.choice(PATTERNS), random, 20))
            for _ in range(random.choice([0, 0, 1, 5])):
                await FallingEdge(dut.clk_i)

    reading = [cocotb.start_soon(reads(client)) for client in ("show", "read")]
    while not all(task.done() for task in reading):
        buffer, first, count = span()
        pixels = [random.getrandbits(24) for _ in range(min(count, 32))]
        await bench.write(buffer, first, pixels, pattern(random.choice(PATTERNS), random, 20))
        if random.random() < 0.5:
            await ClockCycles(dut.clk_i, random.randrange(1, 60))
            await FallingEdge(dut.clk_i)
    for task in reading:
        task.result()
    for buffer in (0, 1):
        got, _ = await bench.read("read", buffer, 0, PIXELS, pattern("light", random, 0))
        assert got == [bench.store.newest((buffer, place)) for place in range(PIXELS)]


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def a_pixel_each_clock(dut):
    """7 clocks after the request, then without a pause; and a request with write_done sees what was written."""
    bench = await begin(dut)
    pixels = await bench.write_all(1)
    for client in ("read", "show"):
        got, late = await bench.read(client, 1, 0, PIXELS, pattern("always", random, 0))
        assert got == pixels
        assert late == list(range(6, 6 + PIXELS))


@cocotb.test(timeout_time=20, timeout_unit="ms")
async def reset_forgets_requests_and_keeps_pixels(dut):
    bench = await begin(dut)
    pixels = await bench.write_all(0)
    for wait in (1, 2, 5, 9, 14):
        await bench.ask("show", 0, 0, PIXELS)
        await bench.ask("write", 1, 0, PIXELS)
        await ClockCycles(dut.clk_i, wait)
        await FallingEdge(dut.clk_i)
        dut.rst_ni.value = 0
        await FallingEdge(dut.clk_i)
        assert not dut.show_pixel_valid_o.value
        dut.rst_ni.value = 1
        await FallingEdge(dut.clk_i)
        got, _ = await bench.read("show", 0, 0, PIXELS, pattern("bursts", random, 9))
        assert got == pixels

"""reply_writer in the simulator."""

import random

import cocotb
from packets import Joined
from rtl_coverage import Coverage
from streams import PAIRS, Monitor, pattern, start_and_reset

SIZE = int(cocotb.plusargs["Bytes"])
SEEN = Monitor.seen


class NotBusy:
    """The busy flag as a stream's ready."""

    def __init__(self, busy):
        self._busy = busy

    @property
    def value(self):
        return not self._busy.value


async def start(dut):
    dut.load_i.value = dut.ready_i.value = 0

    def put(load):
        data, last = load
        # What is above the bytes that count means nothing.
        rest = random.getrandbits(8 * SIZE) << 8 * len(data) & (1 << 8 * SIZE) - 1
        dut.bytes_i.value, dut.count_i.value = rest | int.from_bytes(data, "little"), len(data)
        dut.last_i.value = last

    out = Joined(dut.last_o, dut.data_o)
    monitor = Monitor(dut.clk_i, dut.load_i, NotBusy(dut.busy_o), dut.valid_o, dut.ready_i, out, put)
    await start_and_reset(dut)
    assert not dut.busy_o.value
    return monitor


def loads(count):
    sizes = [1, SIZE, *(random.randint(1, SIZE) for _ in range(count))]
    return [(random.randbytes(size), random.getrandbits(1)) for size in sizes]


def words(given):
    """What comes out, the last byte of a packet marked."""
    return [byte | (last and k == len(data) - 1) << 8 for data, last in given for k, byte in enumerate(data)]


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS))
async def sends_all_bytes_in_order(dut, idle, pressure):
    given = loads(40)
    monitor = await start(dut)
    wanted = words(given)
    await monitor.run(given, pattern(idle, random, 100), pattern(pressure, random, 100), 400, len(wanted))
    assert monitor.got == wanted
    if idle == pressure == "always":  # a byte each clock, and one for the load
        places = [clock + k for clock, (data, _) in zip(monitor.accepted, given, strict=True) for k in range(len(data))]
        assert monitor.left == [place + 1 for place in places]
        assert monitor.left[-1] == len(wanted) + len(given) - 1


@cocotb.test()
async def forgets_at_reset(dut):
    monitor = await start(dut)
    assert await monitor.clock((bytes(range(1, SIZE + 1)), True), False)
    await monitor.clock(None, True)
    dut.rst_ni.value = 0
    await monitor.edge
    assert not dut.valid_o.value
    assert not dut.busy_o.value
    dut.rst_ni.value = 1
    monitor.got, monitor._stalled = [], None
    given = loads(3)
    wanted = words(given)
    await monitor.run(given, pattern("light", random, 0), pattern("light", random, 0), 100, len(wanted))
    assert monitor.got == wanted


@cocotb.test()
async def coverage_is_complete(dut):
    names = ("output stalled", "output wanted, nothing there", "input closed")
    Coverage("reply_writer", cocotb.plusargs["Bytes"], {name: SEEN[name] for name in names}).close()

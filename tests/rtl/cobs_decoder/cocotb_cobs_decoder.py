import random

import cocotb
from cobs import cobs
from packets import Joined, decode_cut, edges, some_bytes
from rtl_coverage import Coverage
from streams import INFERRED, PAIRS, Monitor, pattern, start_and_reset, watched

SEEN = Monitor.seen
END, BAD = 0x200, 0x100
# An end's data does not matter.
NO_DATA = END | BAD


class Beats(Joined):
    """The decoder's output, with nothing in place of an end's data."""

    @property
    def value(self) -> int:
        word = super().value
        return word & NO_DATA if word & END else word & 0xFF


async def start(dut):
    dut.in_valid_i.value = dut.out_ready_i.value = dut.in_data_i.value = 0
    monitor = watched(dut, Beats(dut.out_end_o, dut.out_bad_o, dut.out_data_o), through=True)
    await start_and_reset(dut)
    return monitor


def cut(encoded):
    """A frame's end is lost."""
    return encoded[: random.randrange(len(encoded) + 1)]


def traffic():
    whole = [cobs.encode(body) for body in [b"", *edges(random, 800)]]
    whole += [cobs.encode(some_bytes(random, random.randrange(1, 400))) for _ in range(20)]
    random.shuffle(whole)
    frames = [cut(encoded) if random.random() < 0.4 else encoded for encoded in whole]
    return [encoded for each in frames for encoded in (each, *[b""] * random.choice([0, 0, 0, 1, 3]))]


def expected(encoded):
    if not encoded:
        return []
    data, bad = decode_cut(encoded)
    SEEN["cut"] += bad
    SEEN["no data"] += not data
    SEEN["full group"] += encoded[0] == 0xFF
    return [*data, END | BAD * bad]


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS))
async def decodes(dut, idle, pressure):
    frames = traffic()
    frames = frames[: 8 if "heavy" in (idle, pressure) else 20]
    wire = b"".join(encoded + b"\0" for encoded in frames)
    wanted = [beat for encoded in frames for beat in expected(encoded)]
    monitor = await start(dut)
    await monitor.run(list(wire), pattern(idle, random, 100), pattern(pressure, random, 100), 500, len(wanted))
    assert monitor.got == wanted
    if idle == pressure == "always":
        assert monitor.accepted == list(range(len(wire))), "a byte each clock"
        assert monitor.left[-1] == len(wire.rstrip(b"\0")) + 1


@cocotb.test()
async def coverage_is_complete(dut):
    Coverage("cobs_decoder", "all", {name: SEEN[name] for name in SEEN.keys() - INFERRED}).close()

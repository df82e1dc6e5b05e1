import random

import cocotb
from packets import CRC, CUT, LONG, LONGEST, SHORT, SHORTEST, TAKEN, Joined, marked, some_bytes, with_crc
from rtl_coverage import Coverage
from streams import INFERRED, PAIRS, Monitor, pattern, start_and_reset

SEEN = Monitor.seen
ROOM = 1 << int(cocotb.plusargs["AddressBits"])
CAUSES = TAKEN + LONG + CUT + SHORT + CRC
END, BAD = 0x200, 0x100


class Watched(Monitor):
    """A monitor that reads the pulses too."""

    def __init__(self, dut):
        put = Joined(dut.in_end_i, dut.in_bad_i, dut.in_data_i).put
        data = Joined(dut.out_last_o, dut.out_data_o)
        super().__init__(dut.clk_i, dut.in_valid_i, dut.in_ready_o, dut.out_valid_o, dut.out_ready_i, data, put)
        self.causes = ""
        self._pulses = [
            dut.accepted_o, dut.dropped_long_o, dut.dropped_cobs_o, dut.dropped_short_o, dut.dropped_crc_o
        ]  # fmt: skip

    async def clock(self, word, take):
        for cause, pulse in zip(CAUSES, self._pulses, strict=True):
            if pulse.value:
                self.causes += cause
        return await super().clock(word, take)


async def start(dut):
    for handle in (dut.in_valid_i, dut.out_ready_i, dut.in_data_i, dut.in_end_i, dut.in_bad_i):
        handle.value = 0
    monitor = Watched(dut)
    await start_and_reset(dut)
    await monitor.edge
    return monitor


def packets(count, longest):
    """Packets, each with its end's mark, its fate and what comes out."""
    for _ in range(count):
        cause = random.choice(CAUSES + 3 * TAKEN)
        body = some_bytes(random, random.choice([3, 4, 5, 6, 20, random.randrange(3, longest)]))
        packet, bad = with_crc(body), False
        if cause == LONG:
            # One byte too long, or many; its CRC is right, and its COBS may be wrong besides.
            size = LONGEST + random.choice([1, 1, 2, 100, 3000])
            packet, bad = with_crc(some_bytes(random, size - 4)), random.random() < 0.3
        elif cause == CUT:
            packet, bad = packet[: random.randrange(len(packet) + 1)], True
        elif cause == SHORT:
            size = random.randrange(SHORTEST)
            packet = with_crc(body[: size - 4]) if size >= 4 else body[: min(size, 3)]
        elif cause == CRC:
            wrong = bytearray(packet)
            wrong[random.randrange(len(wrong))] ^= 1 << random.randrange(8)
            packet = bytes(wrong)
        yield packet, END | BAD * bad, cause, body if cause == TAKEN else b""


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS))
async def gives_out_whole_packets_only(dut, idle, pressure):
    slow = "heavy" in (idle, pressure)
    beats, causes, wanted = [], "", []
    for packet, end, cause, body in packets(4 if slow else 10, 100 if slow else 800):
        beats += [*packet, end]
        causes += cause
        wanted += marked(body) if body else []
    monitor = await start(dut)
    await monitor.run(beats, pattern(idle, random, 500), pattern(pressure, random, 500), 2000, len(wanted))
    assert monitor.got == wanted
    assert monitor.causes == causes


@cocotb.test()
async def takes_the_longest_and_shortest(dut):
    """A byte each clock; a packet comes out four clocks after its end, and then each clock."""
    monitor = await start(dut)
    for size, cause in ((SHORTEST, TAKEN), (SHORTEST - 1, SHORT), (LONGEST, TAKEN), (LONGEST + 1, LONG)):
        body = some_bytes(random, size - 4)
        wanted = marked(body) if cause == TAKEN else []
        monitor.got, monitor.causes = [], ""
        beats = [*with_crc(body), END]
        await monitor.run(beats, pattern("always", random, 0), pattern("always", random, 0), 100, len(wanted))
        assert monitor.got == wanted
        assert monitor.causes == cause
        end = monitor.accepted[-1]
        assert monitor.accepted[-len(beats) :] == list(range(end + 1 - len(beats), end + 1))
        assert cause != TAKEN or monitor.left[-len(body) :] == list(range(end + 4, end + 4 + len(body)))


@cocotb.test()
async def holds_its_input_while_full_and_loses_nothing(dut):
    monitor = await start(dut)
    bodies = [some_bytes(random, random.randrange(3, 900)) for _ in range(2 * ROOM // 300)]
    beats = [beat for body in bodies for beat in (*with_crc(body), END)]
    sent = 0
    for _ in range(ROOM + 200):
        sent += await monitor.clock(beats[sent], False)
    # Full to a few bytes: what was sent, without the CRCs and ends of its packets and what waits outside.
    whole = monitor.causes.count(TAKEN)
    assert ROOM - 4 <= sent - 5 * whole - 5 + 3 <= ROOM + 4
    assert not dut.in_ready_o.value
    wanted = [word for body in bodies for word in marked(body)]
    await monitor.run(beats[sent:], pattern("always", random, 0), pattern("always", random, 0), 8000, len(wanted))
    assert monitor.got == wanted
    assert monitor.causes == TAKEN * len(bodies)


@cocotb.test()
async def swallows_what_is_too_long_while_full(dut):
    monitor = await start(dut)
    body = some_bytes(random, LONGEST - 4)
    packet = [*with_crc(body), END]
    first = packet * (ROOM // LONGEST)
    for beat in first:
        assert await monitor.clock(beat, False)
    # One byte too many is reached where there is room for it; then nothing holds the rest.
    words = marked(body) * (ROOM // LONGEST)
    for _ in range(len(words) - 800 + 4):
        if len(monitor.got) < len(words) - 800:
            await monitor.clock(None, True)
    long = [*some_bytes(random, 4 * ROOM), END]
    for beat in long:
        assert await monitor.clock(beat, False)
    await monitor.run(packet, pattern("always", random, 0), pattern("light", random, 0), 8000, 800 + LONGEST - 4)
    assert monitor.got == words + marked(body)
    assert monitor.causes == TAKEN * (ROOM // LONGEST) + LONG + TAKEN


@cocotb.test()
async def coverage_is_complete(dut):
    Coverage("packet_fifo", f"{ROOM}", {name: SEEN[name] for name in SEEN.keys() - INFERRED}).close()

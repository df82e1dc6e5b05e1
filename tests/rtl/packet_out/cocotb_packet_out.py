import random

import cocotb
from packets import Joined, edges, frame, marked, some_bytes, with_crc
from rtl_coverage import Coverage
from streams import INFERRED, PAIRS, Monitor, pattern, start_and_reset, watched

SEEN = Monitor.seen


async def start(dut):
    dut.in_valid_i.value = dut.out_ready_i.value = dut.in_data_i.value = dut.in_last_i.value = 0
    monitor = watched(dut, put=Joined(dut.in_last_i, dut.in_data_i).put)
    await start_and_reset(dut)
    return monitor


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS))
async def encodes(dut, idle, pressure):
    bodies = edges(random, 800)
    bodies += [some_bytes(random, random.randrange(1, 400)) for _ in range(20)]
    random.shuffle(bodies)
    bodies = bodies[: 5 if "heavy" in (idle, pressure) else 15]
    words = [word for body in bodies for word in marked(body)]
    wanted = b"".join(frame(with_crc(body)) for body in bodies)
    monitor = await start(dut)
    # The pause in front of a stream is longer than the banks are.
    await monitor.run(words, pattern(idle, random, 700), pattern(pressure, random, 700), 3000, len(wanted))
    assert bytes(monitor.got) == wanted


@cocotb.test()
@cocotb.parametrize(zeros=["none", "all", "every other", "random"])
async def keeps_its_rate(dut, zeros):
    body = {
        "none": bytes(random.choices(range(1, 256), k=2540)),
        "all": bytes(2000),
        "every other": bytes([7, 0] * 1000),
        "random": some_bytes(random, 2000),
    }[zeros]
    wanted = frame(with_crc(body))
    monitor = await start(dut)
    await monitor.run(marked(body), pattern("always", random, 0), pattern("always", random, 0), 300, len(wanted))
    assert bytes(monitor.got) == wanted
    # The first byte comes three clocks behind its group's end.
    code = wanted[0]
    assert monitor.left[0] == monitor.accepted[min(code, 254) - 1] + 3
    # A byte each clock while groups are alike; a CRC's, the last, may be longer than those before it.
    clocks = monitor.left[-1] - monitor.left[0] + 1
    assert clocks <= (2 * len(wanted) if zeros == "random" else len(wanted) + 6)


@cocotb.test()
async def coverage_is_complete(dut):
    Coverage("packet_out", "all", {name: SEEN[name] for name in SEEN.keys() - INFERRED}).close()

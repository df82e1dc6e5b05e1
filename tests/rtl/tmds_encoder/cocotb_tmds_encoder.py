"""tmds_encoder in the simulator, against the flow chart of DVI 1.0 and against a decoder that does not know it."""

import random
from collections import deque

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge
from tmds import decoded

LATENCY = 3
#: DVI 1.0, section 3.2.3: the four control symbols, bit 9 first.
CONTROL = [0b1101010100, 0b0010101011, 0b0101010100, 0b1010101011]


def by_the_flow_chart(byte, count):
    """The symbol and the next count of figure 3-5 of the standard; bit 0 of the symbol first in the list."""
    d = [byte >> k & 1 for k in range(8)]
    xnor = sum(d) > 4 or (sum(d) == 4 and d[0] == 0)
    q = [d[0]]
    for k in range(1, 8):
        q.append(1 - (q[-1] ^ d[k]) if xnor else q[-1] ^ d[k])
    q.append(0 if xnor else 1)
    ones, zeros = sum(q[:8]), 8 - sum(q[:8])
    flipped = [1 - bit for bit in q[:8]]
    if count == 0 or ones == zeros:
        out = (q[:8] if q[8] else flipped) + [q[8], 1 - q[8]]
        count += ones - zeros if q[8] else zeros - ones
    elif (count > 0 and ones > zeros) or (count < 0 and zeros > ones):
        out = [*flipped, q[8], 1]
        count += 2 * q[8] + zeros - ones
    else:
        out = [*q[:8], q[8], 0]
        count += -2 * (1 - q[8]) + ones - zeros
    return sum(bit << k for k, bit in enumerate(out)), count


async def encoded(dut, inputs):
    """The symbols of a list of bytes (0 to 255) and controls (256 to 259)."""
    symbols = []
    for one in [*inputs, *[256] * LATENCY]:
        dut.de_i.value = one < 256
        dut.data_i.value = one & 255 if one < 256 else random.getrandbits(8)
        dut.control_i.value = one & 3 if one >= 256 else random.getrandbits(2)
        await FallingEdge(dut.clk_i)
        symbols.append(int(dut.symbol_o.value))
    return symbols[LATENCY - 1 :][: len(inputs)]


async def begin(dut):
    dut.rst_ni.value = 0
    dut.de_i.value = dut.data_i.value = dut.control_i.value = 0
    cocotb.start_soon(Clock(dut.clk_i, 4, "ns").start())
    for _ in range(3):
        await FallingEdge(dut.clk_i)
    assert int(dut.symbol_o.value) == CONTROL[0]
    dut.rst_ni.value = 1


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def every_byte_at_every_balance(dut):
    await begin(dut)
    ways, waiting = {0: []}, deque([0])  # bytes that lead from a control symbol to each balance
    while waiting:
        count = waiting.popleft()
        for byte in range(256):
            reached = by_the_flow_chart(byte, count)[1]
            if reached not in ways:
                ways[reached] = [*ways[count], byte]
                waiting.append(reached)
    assert sorted(ways) == list(range(-8, 9, 2)), "the range that the module states, in whole ones and zeros"
    for count, way in ways.items():
        inputs = [one for byte in range(256) for one in (256, *way, byte)]
        symbols = await encoded(dut, inputs)
        for byte in range(256):
            assert symbols[(byte + 1) * (len(way) + 2) - 1] == by_the_flow_chart(byte, count)[0], (count, byte)


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def lines_of_video(dut):
    """Decoded, nothing differs; what a receiver needs of control periods and balance holds."""
    await begin(dut)
    for _ in range(30):
        kind = random.choice(["any", "few", "same"])
        few = [random.getrandbits(8) for _ in range(random.randrange(1, 4))]
        pixels = [
            random.getrandbits(8) if kind == "any" else random.choice(few) for _ in range(random.randrange(1, 900))
        ]
        controls = [256 + random.choice([0, 1, 2, 3]) for _ in range(random.randrange(12, 200))]
        inputs = [*pixels, *controls]
        symbols = await encoded(dut, inputs)
        assert [decoded(symbol) for symbol in symbols] == inputs
        assert symbols[len(pixels) :] == [CONTROL[one & 3] for one in controls]
        balance = 0
        for symbol in symbols[: len(pixels)]:
            balance += 2 * symbol.bit_count() - 10
            assert -8 <= balance <= 8
            # At most five changes within a symbol of a pixel; a control symbol has at least seven.
            assert ((symbol ^ symbol >> 1) & 0x1FF).bit_count() <= 5
        for symbol in CONTROL:
            assert ((symbol ^ symbol >> 1) & 0x1FF).bit_count() >= 7

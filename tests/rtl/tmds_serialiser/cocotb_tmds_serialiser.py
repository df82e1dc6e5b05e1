"""tmds_serialiser in the simulator: each symbol's ten bits, in order, whatever the phase of the clocks."""

import random

import cocotb
from cocotb.triggers import FallingEdge, ReadOnly, RisingEdge, Timer

#: Half a period of the shift clock; edges of the pixel clock come within JITTER_PS of their places.
HALF_PS, JITTER_PS = 1346, 150
SYMBOLS = 400


async def clock(signal, half_ps, phase_ps, jitter_ps=0, slip=(0, 0)):
    """A clock; before its n-th edge it stands still for some ps more, (n, ps)."""
    signal.value = 0
    await Timer(phase_ps + jitter_ps, "ps")
    late = edges = 0
    while True:
        for value in (1, 0):
            signal.value = value
            now = random.randint(-jitter_ps, jitter_ps)
            edges += 1
            await Timer(half_ps + now - late + slip[1] * (edges == slip[0]), "ps")
            late = now


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(
    phase=[0.0, 0.013, 0.21, 0.5, 0.77, 0.98, 1.0],  # of a shift clock
    slipped=[0, 2, 3],  # shift clocks by which the pixel clock comes later from symbol 100 on
)
async def every_symbol_leaves_whole(dut, phase, slipped):
    dut.pixel_rst_ni.value = dut.shift_rst_ni.value = 0
    dut.symbol_i.value = 0
    shift = cocotb.start_soon(clock(dut.shift_clk_i, HALF_PS, 10_000))
    slip = (2 * 100, 2 * HALF_PS * slipped)
    begin_ps = 10_000 + round(2 * HALF_PS * phase)
    pixel = cocotb.start_soon(clock(dut.pixel_clk_i, 5 * HALF_PS, begin_ps, JITTER_PS, slip))
    await Timer(50_000 + random.randrange(10_000), "ps")
    dut.pixel_rst_ni.value = dut.shift_rst_ni.value = 1
    channels = len(dut.pair_o) // 2
    sent, bits = [], [[] for _ in range(channels)]

    async def send():
        for _ in range(SYMBOLS):
            await FallingEdge(dut.pixel_clk_i)
            symbols = [random.getrandbits(10) for _ in range(channels)]
            dut.symbol_i.value = sum(symbol << 10 * k for k, symbol in enumerate(symbols))
            sent.append((dut_time(), symbols))

    async def listen():
        while True:
            await RisingEdge(dut.shift_clk_i)
            await ReadOnly()
            pairs = int(dut.pair_o.value)
            for k in range(channels):
                bits[k] += [(dut_time(), pairs >> 2 * k & 1), (dut_time(), pairs >> 2 * k + 1 & 1)]

    listening = cocotb.start_soon(listen())
    await send()
    await Timer(40_000, "ps")
    listening.cancel()
    # After some symbols the count has found its place; from then on it keeps it.
    first = 110 if slipped else 8
    for k in range(channels):
        expected = [symbol[k] >> bit & 1 for _, symbol in sent[first:] for bit in range(10)]
        line = [bit for _, bit in bits[k]]
        places = [n for n in range(len(line) - len(expected) + 1) if line[n : n + 200] == expected[:200]]
        assert len(places) == 1
        assert line[places[0] : places[0] + len(expected)] == expected
        late_ps = bits[k][places[0]][0] - sent[first][0]
        # The pixel's edge half a pixel later, then two or three shift clocks, and three.
        assert 15 * HALF_PS - 2 * JITTER_PS <= late_ps <= 17 * HALF_PS + 2 * JITTER_PS
    shift.cancel()
    pixel.cancel()


def dut_time():
    return cocotb.utils.get_sim_time("ps")

"""Two unrelated clocks for benches of rtl/common: any periods and phases, in picoseconds.

Their edges are on even picoseconds; a test that changes a signal on an odd one never does so at an edge.
"""

import random

import cocotb
from cocotb.triggers import Timer

#: Ratios of the second clock's period to the first's: far apart, close to 1, equal.
RATIOS = (0.13, 0.5, 0.97, 1.0, 1.003, 2.0, 5.7)


async def _clock(signal, half_ps):
    signal.value = 0
    await Timer(2 * random.randrange(1, half_ps), "ps")  # phase
    while True:
        signal.value = 1
        await Timer(half_ps, "ps")
        signal.value = 0
        await Timer(half_ps, "ps")


def start(signal, half_ps):
    """Start a clock with half a period of `half_ps` (even), at any phase."""
    assert half_ps % 2 == 0
    return cocotb.start_soon(_clock(signal, half_ps))


def periods(ratio):
    """Half periods of both clocks; for a ratio of 1 they are equal to the picosecond."""
    first = 2 * random.randrange(1000, 3000)
    return first, 2 * round(first * ratio / 2)

"""The receiver of the boards in simulation (sim/netlist/dvi.h) counts every illegal symbol, and no legal one.

It is judged by the flow chart of DVI 1.0 in Python (tmds.py), which judges the RTL too (tmds_encoder, dvi_out).
"""

import json
import random
import subprocess
from collections import deque
from itertools import accumulate
from pathlib import Path

import pytest
from lippmann.simulation.compilation import cached_file
from runner import BUILD, TOP, seed
from tmds import CONTROLS, by_the_flow_chart

MAIN = Path(__file__).with_name("main.cpp")
RECEIVER = TOP / "sim" / "netlist" / "dvi.h"
#: Pixels, then porches and syncs: front, sync, back; both syncs are low while they last.
WIDTH, HEIGHT = 40, 6
H, V = (5, 7, 9), (2, 3, 4)
COLUMNS, LINES = WIDTH + sum(H), HEIGHT + sum(V)
TIMING = (WIDTH, HEIGHT, *H, *V, 0, 0)
FRAMES = 3
#: The number of the second frame's first pixel of data.
FIRST = (LINES + V[1] + V[2]) * COLUMNS + H[1] + H[2]
#: Control symbols by their two bits.
CONTROL = [symbol for symbol, value in sorted(CONTROLS.items(), key=lambda item: item[1])]
FAULTS = ("symbol_slips", "bad_symbols", "illegal_symbols", "timing_breaks")


def build(program):
    subprocess.run(["g++", "-std=gnu++17", "-O1", "-Wall", "-Wextra", "-Werror", MAIN, "-o", program], check=True)


@pytest.fixture(scope="module")
def counts():
    """What the receiver counts in levels, as a function of them."""
    program = cached_file(BUILD / "dvi-receiver", [MAIN, RECEIVER], build)

    def of(levels):
        words = [program, *map(str, TIMING)]
        return json.loads(subprocess.run(words, input=bytes(levels), capture_output=True, check=True).stdout)

    return of


def faults(found):
    """Those of the counts that are not 0."""
    return {name: found[name] for name in FAULTS if found[name]}


def levels_of(pixels):
    """The levels of the pairs for pixels of three symbols, and of one more pixel, which ends the last."""
    return [
        (k < 5) << 3 | sum((symbols[channel] >> k & 1) << channel for channel in range(3))
        for symbols in [*pixels, pixels[-1]]
        for k in range(10)
    ]


def video(rng):
    """The three symbols of each pixel of some frames; their bytes, blue first; and the largest disparity."""
    pixels, shown, largest, count = [], [], 0, [0, 0, 0]
    few = [rng.randrange(256) for _ in range(3)]
    for place in range(FRAMES * LINES * COLUMNS):
        y, x = divmod(place % (LINES * COLUMNS), COLUMNS)
        if 0 <= x - H[1] - H[2] < WIDTH and 0 <= y - V[1] - V[2] < HEIGHT:
            shown.append([rng.choice([rng.randrange(256), *few]) for _ in range(3)])
            made = [by_the_flow_chart(*of) for of in zip(shown[-1], count, strict=True)]
            pixels.append([symbol for symbol, _ in made])
            count = [after for _, after in made]
            largest = max(largest, *map(abs, count))
        else:
            pixels.append([CONTROL[(x >= H[1]) + 2 * (y >= V[1])], CONTROL[0], CONTROL[0]])
            count = [0, 0, 0]
    return pixels, shown, largest


def test_right_video_is_right(counts):
    pixels, shown, largest = video(random.Random(seed()))
    assert len(shown) == FRAMES * WIDTH * HEIGHT
    found = counts(levels_of(pixels))
    assert faults(found) == {}
    assert found["largest_disparity"] == largest
    assert found["pixels"] == "".join(bytes(one[::-1]).hex() for one in shown)


def test_every_symbol_at_every_disparity(counts):
    """Of 1024 symbols the standard's encoder sends 256, and four of control: the others are illegal, each one."""
    ways, waiting = {0: []}, deque([0])  # symbols that lead from a control symbol to each disparity
    while waiting:
        at = waiting.popleft()
        for byte in range(256):
            symbol, after = by_the_flow_chart(byte, at)
            if after not in ways:
                ways[after] = [*ways[at], symbol]
                waiting.append(after)
    assert sorted(ways) == list(range(-8, 9, 2))
    for at, way in ways.items():
        legal = {by_the_flow_chart(byte, at)[0] for byte in range(256)}
        assert len(legal) == 256
        others = set(range(1024)) - legal - set(CONTROLS)
        for symbols, illegal in ((legal, 0), (others, 3 * len(others))):
            pixels = [3 * [one] for symbol in symbols for one in (CONTROL[0], *way, symbol)]
            found = counts(levels_of([3 * [CONTROL[0]], *pixels]))  # the first one tells where symbols begin
            assert found["illegal_symbols"] == illegal, at
            assert found["bad_symbols"] == found["symbol_slips"] == 0
        longest = max(abs(at + 2 * symbol.bit_count() - 10) for symbol in others)
        disparities = accumulate(2 * symbol.bit_count() - 10 for symbol in way)
        assert found["largest_disparity"] == max([longest, *map(abs, disparities)])


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_one_fault_is_counted_where_it_belongs(counts, channel):
    pixels, *_ = video(random.Random(seed()))
    blank = FIRST + WIDTH + 1  # before the horizontal sync

    def with_symbol(place, symbol):
        other = [list(symbols) for symbols in pixels]
        other[place][channel] = symbol
        return faults(counts(levels_of(other)))

    # Each line begins at disparity 0, where bit 9 is the complement of bit 8.
    assert with_symbol(FIRST, pixels[FIRST][channel] ^ 0x2FF)["illegal_symbols"] >= 1
    assert with_symbol(FIRST, CONTROL[2])["bad_symbols"] == 1
    assert with_symbol(blank, by_the_flow_chart(0x10, 0)[0])["bad_symbols"] == 1
    # Syncs at the wrong time, or control bits that DVI does not use.
    assert with_symbol(blank, CONTROL[2]) == ({"timing_breaks": 1} if channel == 0 else {"illegal_symbols": 1})


def test_a_line_of_another_length_breaks_the_timing(counts):
    pixels, *_ = video(random.Random(seed()))
    blank = FIRST + WIDTH + 1
    for other in (
        pixels[:blank] + pixels[blank + 1 :],  # a shorter blanking
        pixels[:blank] + pixels[blank : blank + 1] + pixels[blank:],  # a longer one
        [*pixels[: FIRST + WIDTH], pixels[blank], *pixels[FIRST + WIDTH :]],  # a longer one before the sync
        [*pixels[: FIRST + WIDTH - 1], pixels[blank], *pixels[FIRST + WIDTH :]],  # a pixel less, in a line as long
    ):
        assert faults(counts(levels_of(other))) == {"timing_breaks": 1}


@pytest.mark.parametrize("bits", [9, 11])
def test_a_symbol_of_another_length_slips(counts, bits):
    """It is counted once; what follows is judged again from the next control symbol on."""
    pixels, *_ = video(random.Random(seed()))
    levels = levels_of(pixels)
    place = 10 * FIRST + 10
    found = counts(levels[: place + 9] + (bits - 9) * levels[place + 8 : place + 9] + levels[place + 10 :])
    assert faults(found) == {"symbol_slips": 1}

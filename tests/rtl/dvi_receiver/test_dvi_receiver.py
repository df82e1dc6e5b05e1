"""The receiver of the boards in simulation (sim/netlist/dvi.h) counts every illegal symbol, and no legal one.

It is judged by the flow chart of DVI 1.0 in Python (tmds.py); then it judges the RTL, right and with faults.
"""

import json
import random
import subprocess
from collections import deque
from pathlib import Path

import pytest
from lippmann.simulation.compilation import cached_file
from runner import BUILD, TOP, compiled, seed
from tmds import CONTROLS, by_the_flow_chart

MAIN = Path(__file__).with_name("main.cpp")
RECEIVER = TOP / "sim" / "netlist" / "dvi.h"
CLOCKS = Path(__file__).parents[1] / "cells" / "main.cpp"
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
RIGHT = {"symbol_slips": 0, "bad_symbols": 0, "illegal_symbols": 0, "timing_breaks": 0}


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
    assert found == RIGHT | {
        "largest_disparity": largest, "pixels": "".join(bytes(one[::-1]).hex() for one in shown)
    }  # fmt: skip


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
        assert found["largest_disparity"] == max(longest, *map(abs, balances(way)))


def balances(symbols):
    """The disparity after each symbol."""
    sums = [0]
    for symbol in symbols:
        sums.append(sums[-1] + 2 * symbol.bit_count() - 10)
    return sums


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_one_fault_is_counted_where_it_belongs(counts, channel):
    pixels, *_ = video(random.Random(seed()))
    blank = FIRST + WIDTH + 1  # before the horizontal sync

    def with_symbol(place, symbol):
        other = [list(symbols) for symbols in pixels]
        other[place][channel] = symbol
        found = counts(levels_of(other))
        return {name: found[name] - good for name, good in RIGHT.items() if found[name] != good}

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
        found = counts(levels_of(other))
        assert found["timing_breaks"] == 1
        assert found["illegal_symbols"] == found["bad_symbols"] == found["symbol_slips"] == 0


@pytest.mark.parametrize("bits", [9, 11])
def test_a_symbol_of_another_length_slips(counts, bits):
    """It is counted once; what follows is judged again from the next control symbol on."""
    pixels, *_ = video(random.Random(seed()))
    levels = levels_of(pixels)
    place = 10 * FIRST + 10
    found = counts(levels[: place + 9] + (bits - 9) * levels[place + 8 : place + 9] + levels[place + 10 :])
    assert found["symbol_slips"] == 1
    assert found["illegal_symbols"] == found["bad_symbols"] == found["timing_breaks"] == 0


# ---- the RTL ----

#: Faults of the encoder: a text of its RTL, and what takes its place. Every pixel is decoded as it was, so only the
#: rules of the standard tell.
FAULTS = {
    "inverted": ("(balance_q < 0) == (more_q < 0)", "(balance_q < 0) != (more_q < 0)"),
    "tie": (" || (data_ones == 4'd4 && !data_i[0])", ""),
    "even": ("balance_q == '0 || more_q == '0 ?", "balance_q == '0 ?"),
    "kept": ("endcase\n      balance_q <= '0;", "endcase"),
    "added": ("$signed({3'd0, plain_q}) - more_q", "-more_q"),
}
#: The same video for every design: frames without end, of pixels some of which are like the one before.
BENCH = """
module bench #(
  parameter int Columns = 1, Lines = 1, HSync = 1, VSync = 1, Left = 1, Top = 1, Width = 1, Height = 1, Designs = 1
) (input logic clk_i);
  logic [2:0] fifth_q = '0;
  logic rst_n = 1'b0, pixel_clk = 1'b0, de, hsync, vsync;
  logic [15:0] x_q = '0, y_q = '0, count_q = '0;
  logic [23:0] rgb_q = '0;
  always_ff @(posedge clk_i) begin
    fifth_q <= fifth_q == 3'd4 ? '0 : fifth_q + 1'b1;
    pixel_clk <= fifth_q < 3'd2;
    count_q <= count_q == '1 ? count_q : count_q + 1'b1;
    rst_n <= count_q > 16'd100;
  end
  always_ff @(posedge pixel_clk) if (rst_n) begin
    x_q <= x_q == Columns - 1 ? '0 : x_q + 1'b1;
    if (x_q == Columns - 1) y_q <= y_q == Lines - 1 ? '0 : y_q + 1'b1;
    for (int k = 0; k < 3; k++) if ($urandom() & 1) rgb_q[8*k+:8] <= 8'($urandom());
  end
  assign hsync = x_q >= HSync;
  assign vsync = y_q >= VSync;
  assign de = x_q >= Left && x_q < Left + Width && y_q >= Top && y_q < Top + Height;
  logic [3:0][1:0] pairs[Designs];
  INSTANCES
  always_ff @(posedge clk_i) begin
    for (int k = 0; k < Designs; k++) $write("%x", pairs[k]);
    $write("\\n");
  end
endmodule
"""


@pytest.fixture(scope="module")
def wires():
    """The levels that the right encoder and each faulty one send, by name; every design gets the same video."""
    names = ["right", *FAULTS]
    encoder, out = ((TOP / "rtl" / "video" / f"lipp_{name}.sv").read_text() for name in ("tmds_encoder", "dvi_out"))
    ports = ".pixel_clk_i(pixel_clk), .pixel_rst_ni(rst_n), .de_i(de), .hsync_i(hsync), .vsync_i(vsync)"
    ports += ", .rgb_i(rgb_q), .shift_clk_i(clk_i), .shift_rst_ni(rst_n)"
    instances, modules = [], []
    for k, name in enumerate(names):
        module = "lipp_dvi_out" if name == "right" else f"{name}_out"
        instances.append(f"{module} i_{name} ({ports}, .pair_o(pairs[{k}]));")
        if name != "right":
            text, other = FAULTS[name]
            assert encoder.count(text) == 1, f"the encoder's RTL has changed: {text}"
            modules.append(encoder.replace(text, other).replace("lipp_tmds_encoder", f"{name}_encoder"))
            modules.append(out.replace("lipp_dvi_out", module).replace("lipp_tmds_encoder", f"{name}_encoder"))
    values = {
        "Columns": COLUMNS, "Lines": LINES, "HSync": H[1], "VSync": V[1], "Left": H[1] + H[2], "Top": V[1] + V[2],
        "Width": WIDTH, "Height": HEIGHT, "Designs": len(names),
    }  # fmt: skip
    bench = "".join(modules) + BENCH.replace("INSTANCES", "\n  ".join(instances))
    program = compiled("bench", values, bench, "dvi-receiver-rtl", CLOCKS)
    words = [program, str(5 * (FRAMES + 1) * COLUMNS * LINES), f"+verilator+seed+{seed() % 1000 + 1}"]
    lines = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()

    def levels(place):
        """Of each pair of bits the first, then the second, of all channels."""
        pairs = [int(line[2 * place : 2 * place + 2], 16) for line in lines]
        return [sum((pair >> 2 * k + half & 1) << k for k in range(4)) for pair in pairs for half in (0, 1)]

    return {name: levels(place) for place, name in enumerate(names)}


def test_the_rtl_is_legal(counts, wires):
    found = counts(wires["right"])
    assert len(found.pop("pixels")) >= 6 * FRAMES * WIDTH * HEIGHT
    assert 1 <= found.pop("largest_disparity") <= 8
    assert found.pop("symbol_slips") <= 1
    assert set(found.values()) == {0}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_encoder_is_illegal(counts, wires, fault):
    found = counts(wires[fault])
    assert found["illegal_symbols"] > 10
    assert found["bad_symbols"] == found["timing_breaks"] == 0

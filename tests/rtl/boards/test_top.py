"""The ULX3S's top, pins and all: cells as their library describes them, a chip of SDRAM behind its pads, a host.

A frame goes over the serial line into the SDRAM, and comes out of the GPDI pins, bit by bit; sim/netlist/dvi.h, which
tests/rtl/dvi_receiver judges, decodes it.
"""

import json
import random
import struct
import subprocess
import zlib
from pathlib import Path

import numpy as np
import pytest
from lippmann.board.fpga_boards import fpga_board
from lippmann.board.tiles import TileGrid, code_tile
from lippmann.display.description import load_display
from lippmann.simulation.compilation import FAST, cached_file, verilated
from lippmann.simulation.toolchain import needed, rtl_sources
from lippmann.simulation.virtual_board import step_of
from packets import frame, with_crc
from runner import BUILD, OPTIONS, TOP, seed
from tools.bitstream import plan

HERE = Path(__file__).parent
WIDTH, HEIGHT = 64, 32
#: Porches and syncs: front, sync, back; then the same in lines.
H, V = (8, 16, 24), (1, 2, 3)
COLUMNS, LINES = WIDTH + sum(H), HEIGHT + sum(V)
#: Optics as small as can be.
SMALL = {"Build": "16'h000e", "Scene": "26'h0"}
HELLO, TILE, PRESENT = 1, 4, 5


pytestmark = pytest.mark.full  # two minutes of compilation


@pytest.fixture(scope="module", params=["vga", "hd"])
def mode(request):
    """A PLL's setting and the program; both video modes' clocks, each with a small panel."""
    display = load_display(str(TOP / f"scenes/displays/{request.param}-square.toml"))
    pll = plan(fpga_board("ulx3s"), display, 0).pll
    clocks = pll.clocks_mhz
    clock_hz = round(clocks["system"] * 1_000_000)
    values = {
        **SMALL, **pll.parameters, "Width": WIDTH, "Height": HEIGHT,
        **dict(zip(("HFront", "HSync", "HBack", "VFront", "VSync", "VBack"), (*H, *V), strict=True)),
        "ClockHz": clock_hz, "MemoryHz": round(clocks["memory"] * 1_000_000),
        "Identity": "64'h0123456789abcdef", "UartStep": f"16'd{step_of(3_000_000, clock_hz)}",
    }  # fmt: skip
    own = {path.stem: path for path in sorted((TOP / "rtl/board/ulx3s").glob("*.sv"))}
    sources = [*needed("lipp_ulx3s", {path.stem: path for path in rtl_sources(TOP)} | own), HERE / "ecp5_cells.sv"]
    options = [*OPTIONS, "--pins-inout-enables"]

    def make(program):
        verilated(program, "lipp_ulx3s", sources, [HERE / "main.cpp"], values, options=options, flags=FAST)

    headers = [TOP / "sim" / name for name in ("board/sdram.h", "board/uart.h", "netlist/dvi.h")]
    inputs = [*sources, HERE / "main.cpp", *headers, repr(values), *options]
    return pll, cached_file(BUILD / f"top-{request.param}", inputs, make)


def played(mode, place, requests, pad_ps, lose=0):
    """Run the board: (replies before, packet) for each request; its figures, broken rules, and last frame."""
    pll, program = mode
    listed = b"".join(
        struct.pack("<BH", heard, len(data)) + data for heard, data in ((h, frame(with_crc(p))) for h, p in requests)
    )
    (place / "in").write_bytes(listed)
    half = round(1_000_000 / float(pll.vco_mhz) / 2)
    clock_hz = round(pll.clocks_mhz["system"] * 1_000_000)
    arguments = {
        "in": place / "in", "out": place / "out", "video": place / "video", "vco_ps": 2 * half, "pad_ps": pad_ps,
        "system_div": pll.system_div, "shift_div": pll.shift_div, "step": step_of(3_000_000, clock_hz),
        "frame_turns": COLUMNS * LINES * 2 * pll.system_div, "most_turns": 30_000_000, "replies": len(requests),
        "lose": lose, "width": WIDTH, "height": HEIGHT,
        **dict(zip(("h_front", "h_sync", "h_back", "v_front", "v_sync", "v_back"), (*H, *V), strict=True)),
    }  # fmt: skip
    words = [f"{key}={value}" for key, value in arguments.items()]
    words.append("+verilator+rand+reset+0")  # as an FPGA's registers begin
    run = subprocess.run([program, *words], capture_output=True, text=True, check=True)
    print(run.stdout)
    figures = dict(line.split("=") for line in run.stdout.splitlines() if "=" in line)
    broken = [line for line in run.stdout.splitlines() if line.startswith("violation")]
    last_frame = np.frombuffer((place / "video").read_bytes(), np.uint8).reshape(HEIGHT, WIDTH, 3)
    return {key: json.loads(value) for key, value in figures.items()}, broken, last_frame


def requests_of(image):
    """HELLO, the image's tiles, PRESENT: each waits for all replies to the ones before."""
    grid = TileGrid(WIDTH, HEIGHT)
    bodies = [struct.pack("<BHBI", HELLO, 0, 2, 7)]
    for tile in range(grid.count):
        coded = code_tile(grid.cut(image, tile))
        bodies.append(struct.pack("<BHHHB", TILE, len(bodies), 0, tile, coded.coding) + coded.data)
    bodies.append(struct.pack("<BHHI", PRESENT, len(bodies), 0, zlib.crc32(image.tobytes())))
    return list(enumerate(bodies))


def test_a_frame_from_the_line_to_the_pins(mode, tmp_path):
    """0 pixels differ, and no rule of the SDRAM's data sheet is broken, for the delays that lipp_ulx3s_memory tells."""
    chosen = seed()
    image = np.random.default_rng(chosen).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    image[:, 6:58] = image[:1, 6:7]  # shorter for the line
    delay = random.Random(chosen).choice([1_500, 4_000, 6_500])
    figures, broken, shown = played(mode, tmp_path, requests_of(image), delay)
    assert broken == []
    assert figures["replies"] == len(requests_of(image))
    assert figures["reads"] > WIDTH * HEIGHT
    assert (shown == image).all()
    counts = figures["counts"]
    assert counts["bad_symbols"] == counts["illegal_symbols"] == 0
    assert max(counts["symbol_slips"], counts["timing_breaks"]) <= 1  # the first symbol and frame, which are cut
    assert figures["led"] & 0b1110 == 0b1010  # locked, no error, a frame is shown


def test_a_lost_lock_is_black_and_told(mode, tmp_path):
    image = np.full((HEIGHT, WIDTH, 3), 200, np.uint8)
    figures, broken, shown = played(mode, tmp_path, requests_of(image), 4_000, lose=1)
    assert set(broken) <= {"violation: tCK: 1"}
    assert (shown == 0).all()
    assert figures["led"] & 0b1110 == 0b1100  # locked again, told, no frame is shown

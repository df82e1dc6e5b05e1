"""`make bitstream`: what a board cannot show is refused in one line, and what nextpnr says is read as it is meant."""

import re
import subprocess
import sys
from dataclasses import replace

import pytest
from click.testing import CliRunner
from lippmann.board.fpga_boards import FpgaBoard, fpga_board, fpga_boards
from lippmann.cli import run
from lippmann.dev import bitstream
from lippmann.display import load_display
from lippmann.errors import InputError
from lippmann.sim.tools import repository
from lippmann.toml import schema, tables

TOP = repository()
PANEL = """
name = "{width}x{height}"
gap_mm = 3.3
[panel]
width_px = {width}
height_px = {height}
dpi = 600
[array]
grid = "square"
pitch_mm = 1.0
focal_length_mm = 3.3
index = 1.5
"""


def shown(width, height, folder):
    path = folder / "panel.toml"
    path.write_text(PANEL.format(width=width, height=height))
    return path


def refused(capsys, *arguments):
    """The one line with which the command ends, exit code 2."""
    assert run([*map(str, arguments)], bitstream.main, None) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    return line


@pytest.mark.parametrize(
    ("board", "size", "said"),
    [
        ("ulx3s", (641, 480), "641 pixels wide; the SDRAM takes an even number"),
        ("ulx3s", (1920, 1080), "742.5 MHz for DVI's bits, ulx3s has 375 at most"),
        ("ulx3s", (3840, 2160), "two frames take 47.5 MiB, the SDRAM of ulx3s has 32"),
        ("ulx3s", (1280, 960), "MHz for DVI's bits, ulx3s has 375 at most"),
        ("ulx3s_lcd", (1920, 1080), "148.5 MHz for the system, ulx3s_lcd has 80 at most"),
        ("ulx3s", (16, 16384), "give a board at most 16383"),
    ],
)
def test_a_display_that_the_board_cannot_show(board, size, said, tmp_path, capsys):
    line = refused(capsys, "--board", board, "--display", shown(*size, tmp_path))
    assert said in line
    assert "; " in line


def test_a_display_of_other_bits_and_one_whose_line_is_too_slow(tmp_path, capsys):
    deep = shown(640, 480, tmp_path)
    deep.write_text(deep.read_text().replace("[panel]", "[panel]\nbits = 10"))
    assert "the panel has 10 bits a colour, ulx3s sends 8; give bits = 8" in refused(capsys, "--display", deep)
    line = refused(capsys, "--display", shown(480, 272, tmp_path))
    assert re.search(r"display '480x272' on ulx3s: 3000000 baud does not fit a clock of \d+ Hz", line)


def test_a_half_written_result_is_made_again(tmp_path, monkeypatch):
    """And a whole one is kept: the second time nothing is run."""
    ran = []
    monkeypatch.setattr(bitstream, "_work_folder", lambda made: tmp_path)
    monkeypatch.setattr(bitstream.flow, "synthesise", lambda *_: ran.append("yosys") or 7)

    def route(made, netlist, written, seed):
        (tmp_path / f"seed-{seed}.log").write_text(VGA_SAID)
        ran.append("nextpnr")
        return 7.0

    monkeypatch.setattr(bitstream, "_route", route)
    made = bitstream.plan(fpga_board("ulx3s"), load_display(str(shown(640, 480, tmp_path))))
    (tmp_path / "netlist.json").write_text("{}")
    (tmp_path / "written.json").write_text("")
    (tmp_path / "seed-1.json").write_text('{"seco')
    for _ in range(2):
        (row,) = bitstream.place(made, [1])
        assert (row["missed"], row["seconds"], row["memory_mhz"]) == ("", 7.0, 150.0)
    assert ran == ["yosys", "nextpnr"]


def test_a_panel_for_which_the_memory_is_too_slow(tmp_path, monkeypatch):
    """With the shares of the memory's clocks told: 90 % are there, and 720p takes 96 % of 97 MHz."""
    display = load_display(str(shown(1280, 720, tmp_path)))
    board = fpga_board("ulx3s")
    assert bitstream.plan(board, display).pll.memory_div == 6
    slow = type(board.limits)(**{**vars(board.limits), "memory_mhz": 97.0})
    narrow = type(board)(**{**vars(board), "limits": slow})
    with pytest.raises(InputError, match=r"takes 96% of the SDRAM's clocks in a line, 90% are there"):
        bitstream.plan(narrow, display)


def test_other_bad_input(tmp_path, capsys):
    assert "did you mean ulx3s?" in refused(capsys, "--board", "ulx3")
    assert "choose from ulx3s, ulx3s_lcd" in refused(capsys, "--board", "arty")
    assert "list of numbers" in refused(capsys, "--seeds", "1,x")
    assert "-2 is out of range; give numbers from 0 to" in refused(capsys, "--seeds", "1,-2")
    assert "99999999999 is out of range" in refused(capsys, "--seeds", "99999999999")
    assert "nothing is drawn" in refused(capsys, "--layers", "0", "--bilinear")
    assert "no such file" in refused(capsys, "--display", tmp_path / "none.toml")
    vga = repository() / "scenes/displays/vga-square.toml"
    assert "two files would be ulx3s-vga-square.bit" in refused(capsys, "--display", vga, "--display", vga)


def test_a_wrong_board_file_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("lippmann.board.fpga_boards.hardware", lambda: tmp_path)
    folder = tmp_path / "rtl" / "board" / "mine"
    folder.mkdir(parents=True)
    text = (TOP / "rtl/board/ulx3s/board.toml").read_text()
    for changed, said in (
        (text, 'name: "ulx3s" is not the folder\'s; write "mine"'),
        (text.replace('"ulx3s"', '"mine"', 1).replace("speed = 6", "speed = 9"), "fpga.speed"),
        (text.replace('"ulx3s"', '"mine"', 1) + "\ncolour = 1\n", "colour"),
    ):
        (folder / "board.toml").write_text(changed)
        fpga_boards.cache_clear()
        with pytest.raises(InputError, match=said):
            fpga_boards()
    fpga_boards.cache_clear()


def test_a_board_like_another_has_its_keys_in_tables_too(tmp_path, monkeypatch):
    monkeypatch.setattr("lippmann.board.fpga_boards.hardware", lambda: tmp_path)
    files = {
        "first": (TOP / "rtl/board/ulx3s/board.toml").read_text().replace('"ulx3s"', '"first"', 1),
        "second": 'name = "second"\nlike = "first"\n[memory]\nmegabytes = 64\n',
        "third": 'name = "third"\nlike = "second"\n[limits]\nsystem_mhz = 50.0\n',
    }
    for name, text in files.items():
        (tmp_path / "rtl/board" / name).mkdir(parents=True)
        (tmp_path / "rtl/board" / name / "board.toml").write_text(text)
    fpga_boards.cache_clear()
    third, first = fpga_board("third"), fpga_board("first")
    assert (third.memory.megabytes, third.memory.grade) == (64, first.memory.grade)
    assert (third.limits.system_mhz, third.limits.memory_mhz) == (50.0, first.limits.memory_mhz)
    (tmp_path / "rtl/board/first/board.toml").write_text('like = "third"\n' + files["first"])
    fpga_boards.cache_clear()
    with pytest.raises(InputError, match="end the circle"):
        fpga_boards()
    fpga_boards.cache_clear()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"top": "nosuch"}, "there is no nosuch.sv beside it"),
        ({"constraints": ["none.lpf"]}, "there is no file none.lpf"),
        ({"memory": {"grade": "Nonsense"}}, "memory.grade: 'Nonsense' is no grade; choose from Grade75, "),
    ],
)
def test_a_board_file_that_names_what_there_is_not(change, said):
    board = fpga_board("ulx3s")
    change = {k: replace(getattr(board, k), **v) if isinstance(v, dict) else v for k, v in change.items()}
    with pytest.raises(InputError, match=re.escape(said)):
        bitstream.plan(replace(board, **change), load_display(str(TOP / "scenes/displays/vga-square.toml")))


def test_every_key_of_a_board_file_is_documented():
    text = (TOP / "docs/reference/boards.md").read_text().split("| key |")[1]
    keys = {
        name.rsplit(".", 1)[-1] for name, table in tables(schema(FpgaBoard)) for name in (name, *table["properties"])
    }
    assert len(keys) > 20
    assert [key for key in keys - {""} if f"`{key}`" not in text] == []


#: nextpnr's lines after routing, 640 x 480: two clocks are equal to two others.
VGA_SAID = """
Info: Max frequency for clock '$glbnet$i_clocks.memory_clk_o': 150.00 MHz (PASS at 125.00 MHz)
Info: Max frequency for clock '$glbnet$i_clocks.shift_clk_o': 400.00 MHz (PASS at 125.00 MHz)
Info: Max frequency for clock 'clk_25mhz$TRELLIS_IO_IN': 500.00 MHz (PASS at 25.00 MHz)
Info: Max frequency for clock             '$glbnet$clk': 83.25 MHz (PASS at 25.00 MHz)
Info: Max delay posedge $glbnet$clk             -> posedge $glbnet$i_clocks.shift_clk_o : 3.27 ns
"""
#: The same of 720p.
SAID = """
Info: Max frequency for clock '$glbnet$clk': 61.00 MHz (FAIL at 75.00 MHz)
Info: Max frequency for clock '$glbnet$i_clocks.shift_clk_o': 400.00 MHz (PASS at 375.00 MHz)
Info: Max frequency for clock '$glbnet$i_clocks.memory_clk_o': 130.00 MHz (PASS at 125.00 MHz)
Info: Max frequency for clock 'clk_25mhz$TRELLIS_IO_IN': 500.00 MHz (PASS at 25.00 MHz)
Info: Max frequency for clock             '$glbnet$clk': 83.25 MHz (PASS at 75.00 MHz)
Info: Max delay posedge $glbnet$clk             -> posedge $glbnet$i_clocks.shift_clk_o : 3.27 ns
"""


def hd():
    return bitstream.plan(fpga_board("ulx3s"), load_display(str(TOP / "scenes/displays/hd-square.toml")))


def test_the_last_figure_of_each_clock_counts():
    met, missed = bitstream.clocks_met(hd(), SAID)
    assert met == {"system": 83.25, "shift": 400.0, "memory": 130.0, "oscillator": 500.0}
    assert missed == []


@pytest.mark.parametrize(
    ("old", "new", "missed"),
    [
        ("83.25 MHz (PASS", "74.10 MHz (FAIL", "system 74.1 of 75.0 MHz"),
        ("400.00 MHz (PASS", "371.00 MHz (FAIL", "shift 371.0 of 375.0 MHz"),
        ("PASS at 125.00", "PASS at 12.00", "memory_clk_o is constrained to 12 MHz, and the memory clock is 125 MHz"),
        ("PASS at 125.00", "PASS at 12.00", "nothing of the memory clock"),
        (": 3.27 ns", ": 5.40 ns", "symbols take 5.40 of 5.33 ns"),
        ("posedge $glbnet$i_clocks.shift_clk_o : 3.27 ns", "", "symbols take an unknown time"),
        ("Max frequency for clock 'clk_25mhz", "clock 'clk_25mhz", "nothing of the oscillator clock"),
    ],
)
def test_what_is_not_met_is_told(old, new, missed):
    assert SAID.count(old) >= 1
    assert missed in "; ".join(bitstream.clocks_met(hd(), SAID.replace(old, new))[1])


def test_seeds_are_tried_until_one_meets_every_clock(tmp_path, monkeypatch):
    """The flow with its tools replaced: what is packed is the first seed that is good, kept results are used again."""
    routed = []

    def route(netlist, written, options, seed, report, record):
        routed.append(seed)
        assert netlist.read_text() == f"anchored by {seed}"
        assert "--timing-allow-fail" not in options
        assert "--lpf-allow-unconstrained" not in options
        record.write_text(SAID.replace("83.25", "70.00") if seed < 3 else SAID)
        (netlist.parent / f"seed-{seed}.config").write_text(f".device LFE5U-85F\n.seed {seed}\n")
        if seed < 3:
            raise bitstream.LippmannError("nextpnr failed")
        return {"utilization": {cell: {"used": 1} for cell in
                                ("TRELLIS_COMB", "TRELLIS_FF", "MULT18X18D", "DP16KD", "TRELLIS_RAMW")}}  # fmt: skip

    def anchor(netlist, options, seed, output):
        assert "--package" in options
        output.write_text(f"anchored by {seed}")
        return 1

    def pack(command, record=None):
        *_, told, packed = command
        (tmp_path / packed).write_text((tmp_path / told).read_text())
        return ""

    monkeypatch.setattr(bitstream.flow, "synthesise", lambda source, netlist, record: 7)
    monkeypatch.setattr(bitstream.flow, "route", route)
    monkeypatch.setattr(bitstream, "anchor", anchor)
    monkeypatch.setattr(bitstream, "run_tool", pack)
    monkeypatch.setattr(bitstream, "repository", lambda: tmp_path)
    monkeypatch.setattr(bitstream.Plan, "constraints", property(lambda plan: []))
    display = str(TOP / "scenes/displays/hd-square.toml")
    for _ in range(2):
        done = CliRunner().invoke(bitstream.main, ["--display", display, "--seeds", "1 2,3,4"])
        assert done.exit_code == 0, done.output
        assert "seed 1" in done.output
        assert "not met: system 70.0 of 75.0 MHz" in done.output
        assert "build/bitstream/ulx3s-hd-square.bit: seed 3; program it with" in done.output
        assert routed == [1, 2, 3]
    lines = (tmp_path / "build/bitstream/ulx3s-hd-square.bit").read_text().splitlines()
    assert lines[0] == ".device LFE5U-85F"
    head = ".comment Lippmann board=ulx3s display=hd-square identity=507097880726521b design="
    assert re.fullmatch(re.escape(head) + r"[0-9a-f]{16} seed=3 sha256=[0-9a-f]{64}", lines[1])
    done = CliRunner().invoke(bitstream.main, ["--display", display, "--seeds", "1,2"])
    assert isinstance(done.exception, bitstream.TimingError)
    assert done.exception.exit_code == 1
    assert "no seed of 1,2 meets every clock; try others with --seeds" in str(done.exception)
    report = tmp_path / "report"
    report.mkdir()
    done = CliRunner().invoke(bitstream.main, ["--display", display, "--seeds", "3,4", "--report", str(report)])
    assert done.exit_code == 0, done.output
    assert routed[-1] == 4
    text = (report / "bitstream.md").read_text()
    assert "| 83.2 | 400 | 130 |" in text
    assert "375.00" in text
    assert "hd-square,3" in (report / "bitstream.csv").read_text()


def test_make_takes_no_display_from_the_environment():
    """X11 has a variable DISPLAY too."""
    make = ["make", "-n", "-o", ".venv/.ready", "bitstream"]
    environment = {"PATH": "/usr/bin:/bin", "DISPLAY": ":0"}
    plain = subprocess.run(make, cwd=TOP, env=environment, capture_output=True, text=True, check=True).stdout
    assert plain.split()[-1] == "lippmann.dev.bitstream"
    asked = ["BOARD=ulx3s_lcd", "DISPLAY=x.toml", "SEEDS=1,2", "LAYERS=0", "BILINEAR=1"]
    full = subprocess.run([*make, *asked], cwd=TOP, env=environment, capture_output=True, text=True, check=True).stdout
    assert full.strip().endswith(
        "lippmann.dev.bitstream --board ulx3s_lcd --display x.toml --seeds 1,2 --layers 0 --bilinear"
    )


def test_it_is_a_command(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "lippmann.dev.bitstream", "--board", "x"], cwd=tmp_path, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)

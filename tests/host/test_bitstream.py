"""`make bitstream`: what a board cannot show, what nextpnr says, and the cells that are placed first."""

import contextlib
import json
import re
import shlex
import shutil
import stat
import subprocess
from dataclasses import replace
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import pytest
from click.testing import CliRunner
from lippmann.base.toml import schema, tables
from lippmann.board.fpga_boards import FpgaBoard, fpga_board, fpga_boards
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import InputError, LippmannError
from lippmann.simulation.toolchain import repository
from scene_cases import small_toml
from tools import anchors, bitstream, flow

TOP = repository()


def shown(width, height, folder):
    path = folder / "panel.toml"
    path.write_text(f'name = "{width}x{height}"\n' + small_toml(width, height, "dpi = 600"))
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
        ("ulx3s", (641, 480), "641 pixels wide; choose an even width for the SDRAM"),
        ("ulx3s", (1920, 1080), "742.5 MHz for DVI's bits, ulx3s has 375 at most"),
        ("ulx3s", (3840, 2160), "two frames take 47.5 MiB, the SDRAM of ulx3s has 32"),
        ("ulx3s", (1280, 960), "MHz for DVI's bits, ulx3s has 375 at most"),
        ("ulx3s_lcd", (1920, 1080), "148.5 MHz for the system, ulx3s_lcd has 80 at most"),
        ("ulx3s", (16, 16384), "give a panel of at most 16383 x 16383"),
        ("ulx3s", (480, 272), "display '480x272' on ulx3s: 3000000 baud is not possible with a clock of "),
        ("ulx3s_lcd", (480, 272), f" baud, with the key baud of {TOP}/rtl/board/ulx3s_lcd/board.toml"),
    ],
)
def test_a_display_that_the_board_cannot_show(board, size, said, tmp_path, capsys):
    line = refused(capsys, "--board", board, "--display", shown(*size, tmp_path))
    assert said in line
    assert "; " in line


def test_a_display_of_other_bits(tmp_path, capsys):
    deep = shown(640, 480, tmp_path)
    deep.write_text(deep.read_text().replace("[panel]", "[panel]\nbits = 10"))
    assert "the panel has 10 bits a colour, ulx3s sends 8; set bits = 8" in refused(capsys, "--display", deep)


def test_a_panel_for_which_the_memory_is_too_slow(tmp_path, monkeypatch):
    """With the shares of the memory's clocks told: 90 % are there, and 720p takes 96 % of 97 MHz."""
    display = load_display(str(shown(1280, 720, tmp_path)))
    board = fpga_board("ulx3s")
    assert bitstream.plan(board, display).pll.memory_div == 6
    slow = replace(board, limits=replace(board.limits, memory_mhz=97.0))
    with pytest.raises(InputError, match=r"takes 96% of the SDRAM's clocks in a line, at most 90% are available"):
        bitstream.plan(slow, display)


def test_other_bad_input(tmp_path, capsys):
    assert "did you mean ulx3s?" in refused(capsys, "--board", "ulx3")
    assert "choose from ulx3s, ulx3s_lcd" in refused(capsys, "--board", "arty")
    assert "list of numbers" in refused(capsys, "--seeds", "1,x")
    assert "-2 is out of range; give numbers from 0 to" in refused(capsys, "--seeds", "1,-2")
    assert "99999999999 is out of range" in refused(capsys, "--seeds", "99999999999")
    assert "nothing is drawn" in refused(capsys, "--layers", "0", "--bilinear")
    assert "no such file" in refused(capsys, "--display", tmp_path / "none.toml")
    vga = TOP / "scenes/displays/vga-square.toml"
    assert "two bitstreams would be named ulx3s-vga-square.bit" in refused(capsys, "--display", vga, "--display", vga)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A checkout's boards: the ULX3S alone; further ones are made by `board`."""
    monkeypatch.setattr("lippmann.board.fpga_boards.hardware", lambda: tmp_path)
    monkeypatch.setattr(bitstream, "hardware", lambda: tmp_path)
    (tmp_path / "rtl/memory").mkdir(parents=True)
    shutil.copy(TOP / "rtl/memory/lipp_sdram_pkg.sv", tmp_path / "rtl/memory")
    shutil.copytree(TOP / "rtl/board/ulx3s", tmp_path / "rtl/board/ulx3s")
    return tmp_path / "rtl/board"


def board(folder, name, text):
    (folder / name).mkdir(exist_ok=True)
    (folder / name / "board.toml").write_text(text)


def test_a_wrong_board_file_is_named_and_hinders_no_other_board(folder):
    text = (folder / "ulx3s/board.toml").read_text()
    for changed, said in (
        (text, 'name: "ulx3s" is not the name of the folder; write "mine"'),
        (text.replace('"ulx3s"', '"mine"', 1).replace("speed = 6", "speed = 9"), "fpga.speed"),
        (text.replace('"ulx3s"', '"mine"', 1) + "\ncolour = 1\n", "colour"),
        ("name = ", "not TOML"),
        ("", "the key is missing"),
    ):
        board(folder, "mine", changed)
        with pytest.raises(InputError, match=said):
            fpga_boards()
        with pytest.raises(InputError, match=said):
            fpga_board("mine")
        assert fpga_board("ulx3s").baud == 3_000_000


def test_a_board_like_another_has_its_keys_its_pins_and_its_rtl(folder):
    """Keys in tables too; pins and RTL from the folders where they are; what it names itself is beside its own file."""
    board(folder, "second", 'name = "second"\nlike = "ulx3s"\n[memory]\nmegabytes = 64\n')
    board(folder, "third", 'name = "third"\nlike = "second"\nvideo = "parallel"\n[limits]\nsystem_mhz = 50.0\n')
    third, plain = fpga_board("third"), fpga_board("ulx3s")
    assert (third.memory.megabytes, third.memory.grade) == (64, plain.memory.grade)
    assert (third.limits.system_mhz, third.limits.memory_mhz) == (50.0, plain.limits.memory_mhz)
    board(folder, "fourth", 'name = "fourth"\nlike = "third"\nconstraints = ["../ulx3s/ulx3s.lpf", "own.lpf"]\n')
    board(folder, "fifth", 'name = "fifth"\nlike = "fourth"\n')
    (folder / "fourth/own.lpf").write_text("")
    pins = {
        name: [(folder / name / pins).resolve().relative_to(folder) for pins in one.constraints]
        for name, one in fpga_boards().items()
    }
    first = [Path("ulx3s/ulx3s.lpf"), Path("ulx3s/gpdi.lpf")]
    assert pins["ulx3s"] == pins["second"] == pins["third"] == first
    assert pins["fourth"] == pins["fifth"] == [Path("ulx3s/ulx3s.lpf"), Path("fourth/own.lpf")]
    chain = ["fifth", "fourth", "third", "second", "ulx3s"]
    for count in range(1, 6):
        assert fpga_board(chain[-count]).folders == [folder / name for name in chain[-count:]]
        bitstream.check_board(fpga_board(chain[-count]))


@pytest.mark.parametrize(
    ("like", "said"),
    [
        ('"nosuch"', 'mine/board.toml: like: "nosuch" is not a board; choose from mine, ulx3s'),
        ('"../../etc"', 'mine/board.toml: like: "../../etc" is not a board; choose from'),
        ('""', 'mine/board.toml: like: "" is not a board'),
        ("7", "mine/board.toml: like: 7 is not a board"),
        ('["ulx3s"]', 'mine/board.toml: like: ["ulx3s"] is not a board'),
        ('"mine"', "mine/board.toml: like: mine already inherits from this board; remove a `like` key"),
    ],
)
def test_a_board_like_none(folder, like, said):
    board(folder, "mine", f'name = "mine"\nlike = {like}\n')
    with pytest.raises(InputError, match=re.escape(said)):
        fpga_board("mine")


def test_boards_in_a_circle(folder):
    """Also where the board that is asked for is not in it, and where the circle has the length of all boards."""
    names = [f"b{number}" for number in range(12)]
    for name, other in zip(names, [*names[1:], "b3"], strict=True):
        board(folder, name, f'name = "{name}"\nlike = "{other}"\n')
    for name in names:
        with pytest.raises(InputError, match=r"b\d+/board.toml: like: b\d+ already inherits from this board; remove"):
            fpga_board(name)
    board(folder, "b11", 'name = "b11"\nlike = "ulx3s"\n')
    assert fpga_board("b0").folders == [*(folder / name for name in names), folder / "ulx3s"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"top": "nosuch"}, "its folder has no nosuch.sv"),
        ({"constraints": ["none.lpf"]}, "there is no file none.lpf"),
        ({"constraints": []}, "board.toml: constraints: is empty; list pin files (.lpf)"),
        ({"constraints": [str(TOP / "rtl/board/ulx3s/ulx3s.lpf")]}, "ulx3s.lpf is not a relative path to a file of"),
        ({"constraints": ["ulx3s.lpf", "../../../../mine.lpf"]}, "../../../../mine.lpf is not a relative path to"),
        ({"constraints": ["gpdi.lpf"]}, "oscillator_mhz: 25 MHz, and no pin file has a FREQUENCY PORT; give"),
        ({"oscillator_mhz": 48.0}, 'oscillator_mhz: 48 MHz, and FREQUENCY PORT "clk_25mhz" of ulx3s.lpf is 25 MHz; '),
        ({"fpga": {"device": "85f"}}, "fpga.device: '85f' is not a device of nextpnr; choose from 12k, 25k, 45k, "),
        ({"memory": {"grade": "Nonsense"}}, "memory.grade: 'Nonsense' is not a memory grade; choose from Grade75, "),
    ],
)
def test_a_board_file_that_names_what_there_is_not(change, said):
    board = fpga_board("ulx3s")
    change = {k: replace(getattr(board, k), **v) if isinstance(v, dict) else v for k, v in change.items()}
    with pytest.raises(InputError, match=re.escape(said)):
        bitstream.plan(replace(board, **change), load_display(str(TOP / "scenes/displays/vga-square.toml")))


@pytest.mark.parametrize(
    ("line", "good"),
    [
        ('FREQUENCY PORT "clk" 25 MHZ;', True),
        ("  frequency  port\n  clk 25000.0 kHz ;", True),
        ('IOBUF PORT "clk" IO_TYPE=LVCMOS33; FREQUENCY PORT "clk" 25000000 HZ;', True),
        ('FREQUENCY PORT "other" 48 MHZ; # it; is\nFREQUENCY PORT "clk" 25. MHZ; // its clock', True),
        ('FREQUENCY PORT "clk" 25 KHZ;', False),
        ('FREQUENCY PORT "clk" 25.1 MHZ;', False),
        ('# FREQUENCY PORT "clk" 25 MHZ;', False),
        ('FREQUENCY NET "clk" 25 MHZ;', False),
    ],
)
def test_the_oscillators_clock_in_a_file_of_pins(folder, line, good):
    board(folder, "mine", 'name = "mine"\nlike = "ulx3s"\nconstraints = ["own.lpf"]\n')
    (folder / "mine/own.lpf").write_text(line)
    refusal = pytest.raises(InputError, match="oscillator_mhz: 25 MHz, and ")
    with contextlib.nullcontext() if good else refusal:
        bitstream.check_board(fpga_board("mine"))


def test_every_key_of_a_board_file_is_documented():
    text = (TOP / "docs/reference/boards.md").read_text().split("| key |")[1]
    named = [(name, *table["properties"]) for name, table in tables(schema(FpgaBoard))]
    keys = {name.rsplit(".", 1)[-1] for names in named for name in names}
    assert len(keys) > 20
    assert [key for key in keys - {""} if f"`{key}`" not in text] == []


#: nextpnr's lines after routing, of 720p.
SAID = """
Info: Max frequency for clock '$glbnet$clk': 61.00 MHz (FAIL at 75.00 MHz)
Info: Max frequency for clock '$glbnet$i_clocks.shift_clk_o': 400.00 MHz (PASS at 375.00 MHz)
Info: Max frequency for clock '$glbnet$i_clocks.memory_clk_o': 130.00 MHz (PASS at 125.00 MHz)
Info: Max frequency for clock 'clk_25mhz$TRELLIS_IO_IN': 500.00 MHz (PASS at 25.00 MHz)
Info: Max frequency for clock             '$glbnet$clk': 83.25 MHz (PASS at 75.00 MHz)
Info: Max delay posedge $glbnet$clk             -> posedge $glbnet$i_clocks.shift_clk_o : 3.27 ns
"""


def plan(display="hd", board="ulx3s"):
    return bitstream.plan(fpga_board(board), load_display(str(TOP / f"scenes/displays/{display}-square.toml")))


def test_the_last_figure_of_each_clock_counts():
    found = {"system": 83.25, "shift": 400.0, "memory": 130.0, "oscillator": 500.0}
    assert bitstream.clocks_met(plan(), SAID) == (found, [])
    # Of 640 x 480 two clocks are equal to two others.
    said = SAID.replace("at 375.00", "at 125.00").replace("at 75.00", "at 25.00")
    assert bitstream.clocks_met(plan("vga"), said) == (found, [])


@pytest.mark.parametrize(
    ("old", "new", "missed"),
    [
        ("83.25 MHz (PASS", "74.10 MHz (FAIL", "system 74.1 of 75.0 MHz"),
        ("400.00 MHz (PASS", "371.00 MHz (FAIL", "shift 371.0 of 375.0 MHz"),
        ("PASS at 125.00", "PASS at 12.00", "memory_clk_o is constrained to 12 MHz, and the memory clock is 125 MHz"),
        ("PASS at 125.00", "PASS at 12.00", "reports no memory clock"),
        (": 3.27 ns", ": 5.40 ns", "symbols take 5.40 of 5.33 ns"),
        ("posedge $glbnet$i_clocks.shift_clk_o : 3.27 ns", "", "symbols take an unknown time"),
        ("Max frequency for clock 'clk_25mhz", "clock 'clk_25mhz", "reports no oscillator clock"),
    ],
)
def test_what_is_not_met_is_told(old, new, missed):
    assert SAID.count(old) >= 1
    assert missed in "; ".join(bitstream.clocks_met(plan(), SAID.replace(old, new))[1])


#: The same of 640 x 480 at a parallel panel.
LCD_SAID = """
Info: Max frequency for clock '$glbnet$i_clocks.memory_clk_o': 150.00 MHz (PASS at 125.00 MHz)
Info: Max frequency for clock 'clk_25mhz$TRELLIS_IO_IN': 500.00 MHz (PASS at 25.00 MHz)
Info: Max frequency for clock             '$glbnet$clk': 21.25 MHz (FAIL at 25.00 MHz)
"""


@pytest.fixture
def routed(tmp_path, monkeypatch):
    """A call: nextpnr says a text, writes its configuration or not, and ends with a line of shell; returns the rows."""
    monkeypatch.setattr(bitstream, "_work_folder", lambda made: tmp_path)
    made = plan("vga", "ulx3s_lcd")
    source = made.source
    for module in (bitstream, bitstream.flow):
        monkeypatch.setattr(module, "repository", lambda: tmp_path)
    monkeypatch.setattr(bitstream.Plan, "source", source)
    monkeypatch.setattr(bitstream.Plan, "constraints", [])
    (tmp_path / "netlist.json").write_text("{}")
    (tmp_path / "written.json").write_text("7")
    program = tmp_path / "nextpnr-ecp5"
    monkeypatch.setenv("NEXTPNR", str(program))

    def place(said, writes, ends, **options):
        (tmp_path / "said").write_text(said)
        config = "seed-1.config" if writes else "nowhere"
        program.write_text(f"#!/bin/sh\ncat said\necho configuration > {config}\n{ends}\n")
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        return bitstream.place(made, [1], **options)

    return place


@pytest.mark.parametrize(
    ("said", "writes", "ends", "told"),
    [
        ("Info: begins\nERROR: there is no site Z99\n", False, "exit 1", "ERROR: there is no site Z99"),
        ("Info: begins\n", False, "kill -9 $$", "ended by signal 9"),
        # Clocks are told after placement too.
        (LCD_SAID + "ERROR: routing failed\n", False, "exit 1", "ERROR: routing failed"),
        (LCD_SAID + "Info: Routing..\n", False, "kill -9 $$", "ended by signal 9"),
        (LCD_SAID.replace("Max frequency for clock 'clk", "'clk") + "ERROR: odd", True, "exit 1", "ERROR: odd"),
        (LCD_SAID.replace("21.25", "31.25") + "ERROR: no report", True, "exit 1", "ERROR: no report"),
    ],
)
def test_a_nextpnr_that_fails_is_no_clock_that_is_not_met(routed, tmp_path, said, writes, ends, told):
    """Nothing is kept of it, also where an earlier run has left a configuration: the next call runs it again."""
    (tmp_path / "seed-1.config").write_text("of an earlier run")
    for _ in range(2):
        with pytest.raises(bitstream.LippmannError, match=told):
            routed(said, writes, ends)
        assert not (tmp_path / "seed-1.json").exists()


def test_a_clock_that_is_not_met_is_kept(routed, tmp_path, monkeypatch):
    """What another run has written by half is made again; of a whole result nothing is run a second time."""
    synthesise = Mock(return_value=7)
    monkeypatch.setattr(bitstream.flow, "synthesise", synthesise)
    (tmp_path / "written.json").write_text("")
    (tmp_path / "seed-1.json").write_text('{"seco')
    (row,) = routed(LCD_SAID + "ERROR: Max frequency for clock '$glbnet$clk': 21.25 MHz (FAIL)\n", True, "exit 1")
    assert (row["missed"], row["system_mhz"], row["system_ratio"]) == ("system 21.2 of 25.0 MHz", 21.25, 0.85)
    assert routed("ERROR: is not called", False, "exit 1") == [row]
    assert synthesise.call_count == 1


def test_a_seed_that_is_never_routed_is_given_up(routed, tmp_path, monkeypatch):
    """It is kept, and tried again only with more patience; its clocks of before routing are not told."""
    endless = [LCD_SAID.replace("21.25", "31.25"), False, "sleep 60"]
    monkeypatch.setattr(bitstream.flow, "run_program", partial(_soon, bitstream.flow.run_program))
    for _ in range(2):
        (row,) = routed(*endless, patience_min=2)
        assert (row["missed"], row["system_mhz"]) == ("not routed after 2 min", None)
        (tmp_path / "nextpnr-ecp5").write_text("#!/bin/sh\nexit 1\n")
    (row,) = routed(*endless, patience_min=3)
    assert row["missed"] == "not routed after 3 min"
    assert "not routed after 3 min" in "\n".join(bitstream.describe(row))


def _soon(run_program, *arguments, timeout_s, **more):
    return run_program(*arguments, timeout_s=None if timeout_s is None else timeout_s / 500, **more)


def test_seeds_for_each_display(tmp_path, monkeypatch, capsys):
    tried = []

    def place(made, seeds, every, patience):
        tried.append((made.name, seeds))
        return [{"board": "ulx3s", "display": "d", "seed": seeds[0], "missed": "all", "seconds": 1.0}]

    monkeypatch.setattr(bitstream, "place", place)
    displays = [f"--display={TOP}/scenes/displays/{name}-square.toml" for name in ("vga", "hd")]
    run([*displays, "--seeds", "1,2", "--seeds", "4"], bitstream.main, None)
    run([*displays, "--seeds", "5"], bitstream.main, None)
    vga, hd = "ulx3s-vga-square", "ulx3s-hd-square"
    assert tried == [(vga, [1, 2]), (hd, [4]), (vga, [5]), (hd, [5])]
    assert run([*displays, *3 * ["--seeds", "1"]], bitstream.main, None) == 2
    assert "is given 3 times for 2 bitstreams; give --seeds once, or once for each bitstream" in capsys.readouterr().err


def test_seeds_are_tried_until_one_meets_every_clock(tmp_path, monkeypatch):
    """The flow with its tools replaced: what is packed is the first seed that is good, kept results are used again."""
    routed = []

    def route(netlist, written, options, seed, report, record, most_s):
        routed.append(seed)
        assert netlist.read_text() == f"anchored by {seed}"
        assert "--timing-allow-fail" not in options
        assert "--lpf-allow-unconstrained" not in options
        record.write_text(SAID.replace("83.25", "70.00") if seed < 3 else SAID)
        (netlist.parent / f"seed-{seed}.config").write_text(f".device LFE5U-85F\n.seed {seed}\n")
        if seed < 3:
            raise bitstream.LippmannError("nextpnr failed")
        cells = "TRELLIS_COMB", "TRELLIS_FF", "MULT18X18D", "DP16KD", "TRELLIS_RAMW"
        return {"utilization": {cell: {"used": 1} for cell in cells}}

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
    monkeypatch.setattr(bitstream.flow, "build_folder", lambda: tmp_path / "build")
    monkeypatch.setattr(bitstream.Plan, "constraints", property(lambda plan: []))
    words = ["--display", str(TOP / "scenes/displays/hd-square.toml"), "--seeds"]
    for _ in range(2):
        done = CliRunner().invoke(bitstream.main, [*words, "1 2,3,4"])
        assert done.exit_code == 0, done.output
        assert "seed 1" in done.output
        assert "not met: system 70.0 of 75.0 MHz" in done.output
        assert "build/bitstream/ulx3s-hd-square.bit: seed 3; program it with" in done.output
        assert routed == [1, 2, 3]
    lines = (tmp_path / "build/bitstream/ulx3s-hd-square.bit").read_text().splitlines()
    assert lines[0] == ".device LFE5U-85F"
    head = ".comment Lippmann board=ulx3s display=hd-square identity=507097880726521b design="
    assert re.fullmatch(re.escape(head) + r"[0-9a-f]{16} seed=3 sha256=[0-9a-f]{64}", lines[1])
    done = CliRunner().invoke(bitstream.main, [*words, "1,2"])
    assert isinstance(done.exception, bitstream.TimingError)
    assert done.exception.exit_code == 4
    assert "no seed of 1,2 meets every clock; try other seeds with --seeds" in str(done.exception)
    report = tmp_path / "report"
    report.mkdir()
    done = CliRunner().invoke(bitstream.main, [*words, "3,4", "--report", str(report)])
    assert done.exit_code == 0, done.output
    assert routed[-1] == 4
    text = (report / "bitstream.md").read_text()
    # Of 75, 375 and 125 MHz, as nextpnr is asked for.
    assert "| 83.2 | 400 | 130 | 500 | 1.11 | 1.07 | 1.04 |  |" in text
    assert "375.00" in text
    assert "hd-square,3" in (report / "bitstream.csv").read_text()


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ([], ""),
        (
            ["BOARD=ulx3s_lcd", "DISPLAY=x.toml", "SEEDS=1,2", "LAYERS=0", "BILINEAR=1"],
            "--board ulx3s_lcd --display x.toml --seeds 1,2 --layers 0 --bilinear",
        ),
        (["BOARD=", "DISPLAY=x.toml", "LAYERS=", "SEEDS= "], "--display x.toml"),
        (["SEEDS=1 2", "DISPLAY=my display's.toml"], """--display "my display's.toml" --seeds '1 2'"""),
    ],
)
def test_make_hands_its_values_on(asked, words):
    """Also with blanks and of no value; and no display from the environment: X11 has a variable DISPLAY too."""
    # Under make test this make is an inner one, which would tell the folders that it enters and leaves.
    make = ["make", "--no-print-directory", "-n", "-o", ".venv/.ready", "bitstream", *asked]
    environment = {"PATH": "/usr/bin:/bin", "DISPLAY": ":0"}
    said = subprocess.run(make, cwd=TOP, env=environment, capture_output=True, text=True, check=True).stdout
    assert shlex.split(said.rpartition("tools.bitstream")[2]) == shlex.split(words)


SLOW, FAST, IN, LUT, STILL = 10, 11, 12, 13, 14


def cell(kind, parameters=None, **pins):
    """A cell; pins that begin with q, z or clko are outputs."""
    outputs = ("q", "z", "clko")
    return {
        "type": kind,
        "parameters": parameters or {},
        "attributes": {},
        "connections": {name.upper(): bits for name, bits in pins.items()},
        "port_directions": {name.upper(): "output" if name.startswith(outputs) else "input" for name in pins},
    }


def cells():
    """A register of the slow clock, two of the fast one, the logic between, and a cell that nothing of it needs."""
    dividers = {"CLKOP_DIV": f"{10:032b}", "CLKOS_DIV": f"{2:032b}"}
    return {
        "pll": cell("EHXPLLL", dividers, clki=[IN], clkop=[SLOW], clkos=[FAST]),
        "slow": cell("TRELLIS_FF", clk=[SLOW], di=[LUT], q=[20]),
        "logic": cell("LUT4", a=[20], b=["0"], z=[21]),
        "first": cell("TRELLIS_FF", clk=[FAST], di=[21], q=[22]),
        "second": cell("TRELLIS_FF", clk=[FAST], di=[22], q=[23]),
        "pair": cell("ODDRX1F", sclk=[FAST], d0=[23], d1=[23], rst=["0"], q=[24]),
        "other": cell("LUT4", a=[20], z=[LUT]),
    }


def test_the_fastest_clock_and_the_logic_before_it():
    """The PLL's output with the least divider; logic that leads elsewhere and registers of other clocks are out."""
    some = cells()
    assert anchors.fastest(some) == {"logic", "first", "second", "pair"}
    # Of two fastest clocks the one of fewer cells.
    some["pll"]["parameters"]["CLKOP_DIV"] = f"{2:032b}"
    assert anchors.fastest(some) == {"slow", "other"}
    del some["pll"]
    with pytest.raises(LippmannError, match="0 PLLs"):
        anchors.fastest(some)


@pytest.fixture
def netlist(tmp_path, monkeypatch):
    """A netlist of those cells, a nextpnr that says what it is told to, and the netlists that it was given."""
    given, shares = [], iter([0.8, 0.9, 0.7, 0.9])

    def placed(command, record=None):
        trial, share = int(command[command.index("--seed") + 1]), next(shares)
        module = json.loads((tmp_path / command[command.index("--json") + 1]).read_text())["modules"]["top"]
        given.append((trial, module))
        for name, some in module["cells"].items():
            some["attributes"]["NEXTPNR_BEL"] = f"{name}/{trial}"
        found = {"modules": {"top": module}}
        (tmp_path / command[command.index("--write") + 1]).write_text(json.dumps(found))
        return f"Info: Max frequency for clock 'x': {share * 100} MHz (FAIL at 100.0 MHz)"

    monkeypatch.setattr(flow, "run_tool", placed)
    module = {
        "attributes": {"top": f"{1:032b}"},
        "ports": {"clock": {"direction": "input", "bits": [IN]}, "dark": {"direction": "input", "bits": [LUT]}},
        "cells": cells(),
        "netnames": {"q": {"bits": [23]}, "still": {"bits": [STILL]}},
    }
    whole = tmp_path / "whole.json"
    whole.write_text(json.dumps({"creator": "yosys", "modules": {"top": module}}))
    return whole, tmp_path / "anchored.json", given


def test_the_best_places_are_written(netlist):
    """The fastest of the trials; the part has its drivers, without their inputs, and no other cell or port."""
    whole, output, given = netlist
    assert anchors.anchor(whole, [], 2, output) == 3
    assert [trial for trial, _ in given] == [8, 9, 10, 11]
    part = given[0][1]
    assert set(part["cells"]) == {"pll", "slow", "logic", "first", "second", "pair"}
    assert part["cells"]["slow"]["connections"] == {"CLK": [SLOW], "Q": [20]}
    assert (set(part["ports"]), set(part["netnames"])) == ({"clock"}, {"q"})
    written = json.loads(output.read_text())["modules"]["top"]["cells"]
    places = {name: some["attributes"]["BEL"] for name, some in written.items() if "BEL" in some["attributes"]}
    assert places == {name: f"{name}/9" for name in ("logic", "first", "second")}
    assert {name: some["connections"] for name, some in written.items()} == {
        name: some["connections"] for name, some in cells().items()
    }

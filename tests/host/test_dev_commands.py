"""The commands behind make's targets, `python -m tools.*`: errors in one line, exit codes, and counted coverage."""

import contextlib
import io
import json
import runpy
import subprocess
import sys

import pytest
from click.testing import CliRunner
from lippmann.cli import run
from lippmann.errors import InputError
from lippmann.simulation.compilation import COVERAGE, TOGGLES, verilated
from lippmann.simulation.toolchain import repository
from tools import flow, mutation
from tools.code_coverage import check_reasons, host_rows, page, read_rtl, reasons, rtl_rows, share, toggles_page

COMMANDS = ("bitstream", "code_coverage", "crossings", "formal", "generate_registers", "host_mutation", "lint")
COMMANDS += ("mutation", "netlist", "synthesis", "test_record")
REPORTS = repository() / "docs/generated/reports"
VGA = repository() / "scenes/displays/vga-square.toml"


def called(place, module, *arguments):
    """Call a command in a folder; its exit code and lines of stdout and stderr. As `python -m`, but in this process."""
    name = f"tools.{module}"
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        patch.chdir(place)
        patch.setattr(sys, "argv", ["", *map(str, arguments)])
        patch.delitem(sys.modules, name, raising=False)  # runpy warns of a module that others have imported
        # pytest loads what is named test_* itself, in a way that runpy does not know.
        patch.setattr(
            sys, "meta_path", [one for one in sys.meta_path if not type(one).__module__.startswith("_pytest")]
        )
        with pytest.raises(SystemExit) as ended:
            runpy.run_module(name, run_name="__main__", alter_sys=True)
    return ended.value.code, out.getvalue().splitlines(), err.getvalue().splitlines()


@pytest.mark.parametrize("module", COMMANDS)
def test_an_unknown_option_is_refused_and_help_does_nothing(module, tmp_path):
    code, out, err = called(tmp_path, module, "--qqq")
    assert (code, out) == (2, [])
    (line,) = err
    assert line.startswith(f"lippmann: No such option '--qqq'. Usage: python -m tools.{module} ")
    code, out, err = called(tmp_path, module, "--help")
    assert (code, err) == (0, [])
    assert out[0].startswith(f"Usage: python -m tools.{module}")
    assert any(line.strip().startswith("Example: ") for line in out)
    assert not list(tmp_path.iterdir())


def test_a_report_that_cannot_be_written_is_refused_before_the_work(tmp_path):
    folder = tmp_path / "none"
    for module in ("host_mutation", "mutation", "synthesis"):
        said = f"lippmann: {folder / module}.md: the folder {folder} does not exist; make the folder first"
        assert called(tmp_path, module, "--report", folder) == (2, [], [said])


def test_a_run_of_some_designs_does_not_replace_the_page_of_all(tmp_path):
    said = f"lippmann: {REPORTS}: this run has only 1 of the page's designs; give another --report FOLDER"
    assert called(tmp_path, "synthesis", "pinhole-compact", "--report", REPORTS) == (2, [], [said])


def test_an_interrupt_leaves_no_traceback(tmp_path, monkeypatch, capfd):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(mutation, "fate", stopped)
    assert run(["--report", str(tmp_path)], mutation.main, None) == 130
    assert capfd.readouterr().err.strip() == "lippmann: interrupted; nothing half-written is left"
    assert not list(tmp_path.iterdir())


def test_no_fault_among_the_changes_that_were_tried_is_no_division_by_zero(tmp_path, monkeypatch):
    monkeypatch.setattr(mutation, "fate", lambda *_: "no fault: the same words")
    result = CliRunner().invoke(mutation.main, ["--count", "2", "--report", str(tmp_path)], catch_exceptions=False)
    assert result.exit_code == 0
    assert "0 of 0 faults caught" in result.stdout
    assert "2 other changes do not change any result" in (tmp_path / "mutation.md").read_text()


def test_faults_leave_elaboration_checks_alone():
    """Also where the condition stands on a line of its own, before the block's name."""
    source = mutation.repository() / "rtl/optics/lipp_ray_pipeline.sv"
    tried = [fault.was for fault in mutation.faults_of(source)]
    assert any("missed_q" in line for line in tried)
    assert not [line for line in tried if line.startswith(("  if (Walk > 4", "  if (Model > ModelExact"))]


#: A register that samples another clock's, as yosys writes it, with nothing that may be left out.
FLOP = {"type": "TRELLIS_FF", "parameters": {}, "port_directions": {"CLK": "input", "DI": "input", "Q": "output"}}
CROSSING = {
    "ports": {name: {"direction": "input", "bits": [bit]} for name, bit in (("a", 2), ("b", 3), ("d", 4))},
    "cells": {
        "one": FLOP | {"connections": {"CLK": [2], "DI": [4], "Q": [5]}},
        "two": FLOP | {"connections": {"CLK": [3], "DI": [5], "Q": [6]}},
    },
    "netnames": {name: {"bits": [bit]} for name, bit in (("a", 2), ("b", 3), ("d", 4), ("one_q", 5), ("two_q", 6))},
}


def test_a_netlist_without_attributes_is_checked(tmp_path):
    path = tmp_path / "netlist.json"
    path.write_text(json.dumps({"modules": {"top": CROSSING}}))
    code, _, err = called(tmp_path, "crossings", path, "--timed", "d")
    assert code == 4
    assert err == ["lippmann: one_q (a) reaches DI of two (b) without a synchroniser"]


@pytest.mark.parametrize(
    "modules",
    [[], {"top": 1}, {"top": {}}, {"top": CROSSING | {"ports": None}}, {"top": CROSSING | {"cells": {"one": {}}}}],
)
def test_what_is_no_netlist_is_told_in_one_line(tmp_path, modules):
    path = tmp_path / "netlist.json"
    path.write_text(json.dumps({"modules": modules}))
    said = f"lippmann: {path}: this is not a netlist of yosys; write it with synth_ecp5 -json"
    assert called(tmp_path, "crossings", path) == (2, [], [said])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ("--board", "ulx3s_lcd"),
            "--board ulx3s_lcd: it has lipp_ulx3s_lcd, parallel, Grade75; simulation needs lipp_",
        ),
        (("--board", "ulx3s", "--memory", "block"), "--memory: ulx3s stores frames in its SDRAM; omit --memory"),
        (("--board", "ulx3"), "ulx3: no such board; did you mean ulx3s?"),
    ],
)
def test_a_board_that_is_not_simulated_is_refused_before_synthesis(tmp_path, monkeypatch, options, said):
    def synthesise(*_):
        raise AssertionError("it is synthesised")

    monkeypatch.setattr(flow, "synthesise", synthesise)
    code, out, err = called(tmp_path, "netlist", *options, "--display", VGA)
    assert (code, out, len(err)) == (2, [], 1)
    assert err[0].startswith(f"lippmann: {said}")


RESULTS = """<testsuites><testsuite tests="4" time="90" timestamp="2026-01-02T03:04:05.6">
<testcase classname="tests.host.test_a" name="test_one" time="1.5"/>
<testcase classname="tests.host.test_a" name="test_two[x|y]" time="2.5"><failure message="no">E</failure></testcase>
<testcase classname="tests.rtl.b.test_b" name="test_three" time="70"/>
<testcase classname="tests.rtl.b.test_b" name="test_four" time="0"><skipped/></testcase>
</testsuite></testsuites>"""


def test_the_record_of_a_run_counts_what_pytest_left(tmp_path):
    results = tmp_path / "results.xml"
    results.write_text(RESULTS)
    code, out, err = called(tmp_path, "test_record", results, "--report", tmp_path)
    assert (code, out, err) == (0, [f"4 tests, 1 failed: {tmp_path}/tests.md"], [])
    page = (tmp_path / "tests.md").read_text()
    for said in ("- 4 tests ran", "; 1 failed, 1 were skipped", "took 2 minutes", "`test_three`, took 70 seconds",
                 "- date: 2026-01-02 03:04 UTC", "- `tests/host/test_a.py::test_two[x|y]`"):  # fmt: skip
        assert said in page, said
    rows = [line for line in (tmp_path / "tests.csv").read_text().splitlines() if line.startswith("tests/")]
    assert rows == ["tests/rtl/b/test_b.py,2,0,1,70.0", "tests/host/test_a.py,2,1,0,4.0"]


@pytest.mark.parametrize("text", [None, "<testsuites", "<testsuites><testsuite tests='0'/></testsuites>"])
def test_results_that_are_none_write_no_record(tmp_path, text):
    results = tmp_path / "results.xml"
    if text is not None:
        results.write_text(text)
    code, out, err = called(tmp_path, "test_record", results, "--report", tmp_path)
    assert (code, out, len(err)) == (2, [], 1)
    assert "run make test-full first" in err[0]
    assert not (tmp_path / "tests.md").exists()


RTL = """module one_branch(input logic clk, input logic [1:0] a, output logic [1:0] q);
  always_ff @(posedge clk) begin
    if (a == 2'd1) begin
      q <= 2'd3;
    end else begin
      q <= a;
    end
  end
endmodule
"""
#: Ten half clocks with a = 1 at each rising edge: line 4 runs, line 6 does not.
MAIN = """#include "Vtop.h"
int main() {
  VerilatedContext context;
  Vtop top{&context};
  for (int half = 0; half < 10; half++) { top.clk = half & 1; top.a = half & 1; top.eval(); }
  top.final();
}
"""


def point(file, line, kind, name, count, lines=""):
    keys = {"f": file, "l": line, "n": 3, "t": kind, "page": f"v_{kind}/m", "o": name}
    keys |= {"S": lines} if lines else {}
    return "C '" + "".join(f"\1{key}\2{value}" for key, value in keys.items()) + f"' {count}\n"


def test_counts_add_up(tmp_path):
    rtl = tmp_path / "rtl/core/one.sv"
    first = point(rtl, 4, "line", "if", 0, "4-5,9") + point(rtl, 6, "line", "else", 7, "6")
    first += point(rtl, 2, "toggle", "q[0]:0->1", 1) + point(tmp_path / "sim/bench.sv", 1, "line", "block", 0)
    second = point(rtl, 4, "line", "if", 0, "4-5,9") + point(rtl, 5, "line", "if", 2, "5")
    second += point(rtl, 2, "toggle", "q[0]:1->0", 0) + point(rtl, 2, "toggle", "q[0]:0->1", 3)
    for name, text in (("a.dat", first), ("b.dat", second)):
        (tmp_path / name).write_text("# SystemC::Coverage-3\n" + text)
    (row,) = rtl_rows(read_rtl([tmp_path / "a.dat", tmp_path / "b.dat"], tmp_path))
    assert row == {"file": "rtl/core/one.sv", "lines": 4, "met": 2, "toggles": 2, "toggled": 1, "missing": "4, 9"}
    assert (share([row]), share([row], "toggled", "toggles"), share([])) == (50.0, 50.0, 0.0)


@pytest.mark.full  # compiles three runtimes of its own
def test_a_simulation_tells_its_lines(tmp_path, monkeypatch):
    (tmp_path / "rtl/core").mkdir(parents=True)
    rtl, main = tmp_path / "rtl/core/small.sv", tmp_path / "main.cpp"
    rtl.write_text(RTL)
    main.write_text(MAIN)
    monkeypatch.setenv(COVERAGE, str(tmp_path))
    monkeypatch.setenv(TOGGLES, "1")
    verilated(tmp_path / "small", "one_branch", [rtl], [main], flags=["-O0"])
    for _ in range(2):
        subprocess.run([tmp_path / "small"], check=True)
    found = read_rtl(tmp_path.glob("*.dat"), tmp_path)["rtl/core/small.sv"]
    assert {line: count for line, count in found.lines.items() if line in (2, 3, 4, 6)} == {2: 10, 3: 10, 4: 10, 6: 0}
    assert {name: count for name, count in found.toggles.items() if name.startswith("1:clk")} == {
        "1:clk:0->1": 10, "1:clk:1->0": 8,
    }  # fmt: skip


def test_each_reason_is_of_a_file(tmp_path):
    assert "rtl/math/lipp_quadratic.sv" in reasons(repository())
    (tmp_path / "holes.toml").write_text('[[hole]]\nfiles = ["rtl/gone.sv"]\nwhy = "none"\n')
    with pytest.raises(InputError, match=r"hole\[0\]\.files: there is no file rtl/gone\.sv"):
        reasons(tmp_path, tmp_path / "holes.toml")


def test_the_page_lists_holes_with_reasons(tmp_path):
    summary = {"num_statements": 4, "covered_lines": 3}
    host = host_rows({"files": {"host/lippmann/a.py": {"summary": summary, "missing_lines": [7]}}})
    assert host == [{"file": "host/lippmann/a.py", "lines": 4, "met": 3, "missing": "7"}]
    rtl = [{"file": "rtl/a.sv", "lines": 10, "met": 9, "toggles": 4, "toggled": 2, "missing": "3"}]
    text = page({"date": "today"}, rtl, host, {"rtl/a.sv": "a fault only", "host/lippmann/a.py": "a reason"}).text()
    for said in ("90.0 % of 10 lines of the RTL.", "75.0 % of 4 statements", "| rtl/a.sv | 3 | a fault only |"):
        assert said in text
    assert "| host/lippmann/a.py | 7 | a reason |" in text


def test_the_page_of_toggles():
    rtl = [{"file": f"rtl/{name}.sv", "toggles": 10, "toggled": met} for name, met in (("a", 10), ("b", 6))]
    text = toggles_page({"date": "today"}, rtl, {"rtl/b.sv": "a table"}).text()
    assert "80.0 % of 20 toggles" in text
    assert "| rtl/b.sv | 10 | 4 | a table |" in text


def test_each_file_whose_bits_stand_still_has_a_reason():
    why = reasons(repository(), toggles=True)
    still = list(why)
    assert [file for file in still if not (repository() / file).is_file()] == []
    with pytest.raises(InputError, match=f"has no reason for holes in {still[0]}; add a table"):
        check_reasons(still, {file: text for file, text in why.items() if file != still[0]}, "still")

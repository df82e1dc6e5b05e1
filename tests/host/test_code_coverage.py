"""The counts of Verilator and coverage.py, added up by hand-made files and by a small simulation."""

import subprocess

import pytest
from lippmann.errors import InputError
from lippmann.simulation.compilation import COVERAGE, TOGGLES, verilated
from lippmann.simulation.toolchain import repository
from tools.code_coverage import check_reasons, host_rows, page, read_rtl, reasons, rtl_rows, share, toggles_page

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
    for said in ("RTL: 90.0 % of 10 lines.", "Host: 75.0 % of 4 statements", "| rtl/a.sv | 3 | a fault only |"):
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
    with pytest.raises(InputError, match=f"no reason is given for the holes in {still[0]}; add a still"):
        check_reasons(still, {file: text for file, text in why.items() if file != still[0]}, "still")

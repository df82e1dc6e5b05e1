"""What is compiled is compiled once, and again when what decides it has changed."""

from pathlib import Path

import pytest
from lippmann.simulation import compilation
from lippmann.simulation.compilation import RtlError, cached_file, verilated


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

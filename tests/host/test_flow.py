"""The open flow: which nextpnr it takes, what a failing tool says, and that no tool outlives the command."""

import stat
import sys

import pytest
from lippmann.errors import InputError, LippmannError, MissingLibraryError
from tools import flow


@pytest.fixture
def native(tmp_path, monkeypatch):
    """A program that stands for a native nextpnr; its text is the answer to any call."""

    def write(text):
        path = tmp_path / "nextpnr-ecp5"
        path.write_text(f"#!{sys.executable}\nprint({text!r})\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("NEXTPNR", str(path))
        return path

    return write


def test_pypis_nextpnr_is_the_default(monkeypatch):
    monkeypatch.delenv("NEXTPNR", raising=False)
    assert flow.placer().name == flow.PLACER
    assert set(flow.versions()) == {flow.SYNTHESISER, flow.PLACER}


def test_another_nextpnr(native):
    """The program that NEXTPNR names runs, and its version is told."""
    path = native('"nextpnr-ecp5" -- Next Generation Place and Route (Version 0.99-5+b1)')
    assert flow.placer() == path
    assert flow.versions()["native nextpnr-ecp5"] == "0.99-5+b1"
    assert "Version 0.99" in flow.run_tool([flow.PLACER, "--version"])


def test_a_nextpnr_that_is_none(native, monkeypatch):
    native("hello")
    with pytest.raises(InputError, match="the program prints no version"):
        flow.versions()
    monkeypatch.setenv("NEXTPNR", "no-such-program")
    with pytest.raises(InputError, match="NEXTPNR: 'no-such-program' is not a program"):
        flow.placer()


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("Info: begins\nERROR: no such cell\nInfo: ends", "ERROR: no such cell"),
        # What a tool says when its reader succeeds, before it fails.
        ("Build succeeded: 0 errors, 3 warnings\nerror: no such cell", "failed: error: no such cell"),
        ("Info: Routing..", "ended by signal 9"),
    ],
)
def test_a_tools_first_error_or_its_end_is_told(native, tmp_path, said, told):
    """And all that it said is kept."""
    path, record = native(""), tmp_path / "said.log"
    path.write_text(f"#!/bin/sh\necho '{said}'\nkill -9 $$\n")
    with pytest.raises(LippmannError, match=told):
        flow.run_tool([flow.PLACER], record)
    assert said in record.read_text()


@pytest.mark.parametrize("call", [flow.versions, lambda: flow.run_tool([flow.PLACER])])
def test_a_tool_of_another_machine(native, call):
    native("").write_bytes(b"\x7fELF, of another machine")
    with pytest.raises(MissingLibraryError, match=r"nextpnr-ecp5: cannot be run \(Exec format error\); install it"):
        call()


@pytest.mark.parametrize("ends", [None, KeyboardInterrupt, LippmannError])
def test_synthesis_leaves_no_count_behind(tmp_path, monkeypatch, ends):
    """Of multipliers, which yosys writes beside the netlist."""

    def yosys(command, record):
        (tmp_path / "netlist.multipliers").write_text("118 objects.\n")
        if ends is not None:
            raise ends

    monkeypatch.setattr(flow, "run_tool", yosys)
    monkeypatch.setattr(flow, "repository", lambda: tmp_path)
    arguments = flow.Source("top", {}, []), tmp_path / "netlist.json", tmp_path / "yosys.log"
    if ends is None:
        assert flow.synthesise(*arguments) == 118
    else:
        with pytest.raises(ends):
            flow.synthesise(*arguments)
    assert not list(tmp_path.iterdir())

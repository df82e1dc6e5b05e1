"""The open flow: which nextpnr it takes, what a failing tool says, and that no tool outlives the command."""

import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
from lippmann.errors import InputError, LippmannError, MissingLibraryError
from tools import flow


@pytest.fixture
def native(tmp_path, monkeypatch):
    """A program that stands for a native nextpnr; its text is the answer to any call."""

    def write(text, code=0):
        path = tmp_path / "nextpnr-ecp5"
        path.write_text(f"#!{sys.executable}\nimport sys\nprint({text!r})\nsys.exit({code})\n")
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
    with pytest.raises(InputError, match="does not tell its version"):
        flow.versions()
    monkeypatch.setenv("NEXTPNR", "no-such-program")
    with pytest.raises(InputError, match="NEXTPNR: 'no-such-program' is no program"):
        flow.placer()


def test_a_tools_first_error_is_told(native, tmp_path):
    """And where all that it said is kept."""
    native("Info: begins\nERROR: no such cell\nInfo: ends", code=1)
    record = tmp_path / "said.log"
    with pytest.raises(LippmannError, match="ERROR: no such cell"):
        flow.run_tool([flow.PLACER], record)
    assert "Info: ends" in record.read_text()


def test_a_count_of_errors_is_no_error(native):
    """What a tool says when its reader succeeds, before it fails."""
    native("Build succeeded: 0 errors, 3 warnings\nerror: no such cell\nInfo: ends", code=1)
    with pytest.raises(LippmannError, match="failed: error: no such cell"):
        flow.run_tool([flow.PLACER])


@pytest.mark.parametrize(("said", "told"), [("Info: Routing..", "ended by signal 9"), ("ERROR: no", "ERROR: no")])
def test_a_tool_that_is_killed_is_said_to_be(native, said, told):
    path = native("")
    path.write_text(f"#!/bin/sh\necho '{said}'\nkill -9 $$\n")
    with pytest.raises(LippmannError, match=told):
        flow.run_tool([flow.PLACER])


@pytest.mark.parametrize("call", [flow.versions, lambda: flow.run_tool([flow.PLACER])])
def test_a_tool_of_another_machine(native, call):
    native("").write_bytes(b"\x7fELF, of another machine")
    with pytest.raises(MissingLibraryError, match=r"nextpnr-ecp5: cannot be run \(Exec format error\); install it"):
        call()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_tool_too(native, tmp_path, number):
    """Sent to the command alone, as `kill` does."""
    told = tmp_path / "pid"
    native("").write_text(f"#!/bin/sh\necho $$ > {tmp_path}/part\nmv {tmp_path}/part {told}\nexec sleep 60\n")
    # In the background, where the tests may run, a shell has SIGINT ignored.
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    code += "from tools import flow; flow.run_tool([flow.PLACER])"
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.DEVNULL) as command:
        until = time.monotonic() + 30
        while not told.exists() and time.monotonic() < until:
            time.sleep(0.02)
        command.send_signal(number)
        assert command.wait(20) != 0
    assert not Path(f"/proc/{int(told.read_text())}").exists()


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

"""The open flow: which nextpnr it takes, and what a failing tool says."""

import stat
import sys

import pytest
from lippmann.dev import flow
from lippmann.errors import InputError, LippmannError


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

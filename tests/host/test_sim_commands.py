"""The commands behind make's targets, `python -m lippmann.dev.*`: errors in one line, exit codes as of `lippmann`."""

import subprocess
import sys

import pytest
from click.testing import CliRunner
from lippmann.cli import run
from lippmann.dev import mutation

COMMANDS = ("formal", "generate_registers", "lint", "mutation", "synthesis")


def called(place, module, *arguments):
    """Call a command in a folder; its exit code and lines of stdout and stderr."""
    command = [sys.executable, "-m", f"lippmann.dev.{module}", *map(str, arguments)]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False, timeout=60)
    return done.returncode, done.stdout.splitlines(), done.stderr.splitlines()


@pytest.mark.parametrize("module", COMMANDS)
def test_an_unknown_option_is_refused_and_help_does_nothing(module, tmp_path):
    code, out, err = called(tmp_path, module, "--qqq")
    assert (code, out, err) == (2, [], ["lippmann: No such option '--qqq'. (see --help)"])
    code, out, err = called(tmp_path, module, "--help")
    assert (code, err) == (0, [])
    assert out[0].startswith(f"Usage: python -m lippmann.dev.{module}")
    assert any(line.strip().startswith("Example: ") for line in out)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("module", ["mutation", "synthesis"])
def test_a_report_that_cannot_be_written_is_refused_before_the_work(module, tmp_path):
    folder = tmp_path / "none"
    code, out, err = called(tmp_path, module, "--report", folder)
    assert (code, out) == (2, [])
    assert err == [f"lippmann: {folder / module}.md: the folder {folder} does not exist; make it first"]


def test_an_interrupt_leaves_no_traceback(tmp_path, monkeypatch, capfd):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(mutation, "fate", stopped)
    assert run(["--report", str(tmp_path)], mutation.main, None) == 130
    assert capfd.readouterr().err.strip() == "lippmann: interrupted; nothing half-written is left"
    assert not list(tmp_path.iterdir())


def test_no_fault_among_the_changes_that_were_tried_is_no_division_by_zero(tmp_path, monkeypatch):
    monkeypatch.setattr(mutation, "fate", lambda *_: "survived")
    monkeypatch.setattr(mutation, "_counted", lambda *_: "no fault: the same words")
    result = CliRunner().invoke(mutation.main, ["--count", "2", "--report", str(tmp_path)], catch_exceptions=False)
    assert result.exit_code == 0
    assert "0 of 0 faults caught" in result.stdout
    assert "2 more changes are no faults" in (tmp_path / "mutation.md").read_text()


def test_faults_leave_elaboration_checks_alone():
    """Also where the condition stands on a line of its own, before the block's name."""
    tried = [fault.was for fault in mutation.faults_of(mutation.repository() / "rtl" / "optics" / "ray_pipeline.sv")]
    assert any("keep_q" in line for line in tried)
    assert not [line for line in tried if line.startswith("  if (Walk < 0") or line.startswith("  if (Model != ModelP")]

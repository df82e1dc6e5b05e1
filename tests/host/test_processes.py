"""Processes that share a measurement end when the command does, whatever ends it."""

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tools.processes import processes

PROGRAM = """
import time
from multiprocessing import active_children
from lippmann.base import interrupts
from tools.processes import processes

interrupts.install()
with processes(2) as pool:
    waits = [pool.submit(time.sleep, 120.0) for _ in range(4)]
    time.sleep(1.0)  # until they work
    print(*(one.pid for one in active_children()), flush=True)
    [one.result() for one in waits]
"""
#: Longest time that two processes take to end, s: this machine may be busy.
PATIENCE_S = 30.0


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT], ids=lambda one: one.name)
def test_none_outlives_the_command(number: signal.Signals) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as command:
        assert command.stdout is not None
        workers = [int(one) for one in command.stdout.readline().split()]
        assert len(workers) == 2
        assert all(map(_runs, workers))
        os.kill(command.pid, number)
        assert command.wait(PATIENCE_S) != 0
        until = time.monotonic() + PATIENCE_S
        while any(map(_runs, workers)):
            assert time.monotonic() < until, f"{[one for one in workers if _runs(one)]} still run"
            time.sleep(0.05)


def test_they_run_nothing_of_the_current_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("signal", "random"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('ran a file of the current folder')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONWARNINGS", "ignore::DeprecationWarning")
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    before = dict(os.environ)
    with processes(1) as pool:
        assert pool.submit(math.isqrt, 81).result() == 9
    assert dict(os.environ) == before


def _runs(process: int) -> bool:
    """Return whether a process is there and not merely unburied."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False

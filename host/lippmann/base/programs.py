"""Runs other programs, and suppresses what libraries print to stderr."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from lippmann.base import interrupts

#: Interval between two checks for received signals, s.
LOOK_S = 0.1
#: Time that a program gets to end before it is killed, s.
GRACE_S = 5.0


@contextlib.contextmanager
def starting_python() -> Iterator[None]:
    """Run a block whose child Pythons neither import from the current folder nor warn about semaphores.

    Dask's workers do not run the user's script, which may have no `__main__` guard.
    """
    from multiprocessing import spawn  # slow to load

    before, prepare = dict(os.environ), spawn.get_preparation_data
    quiet = ",".join(filter(None, [before.get("PYTHONWARNINGS"), "ignore:resource_tracker:UserWarning"]))

    def prepare_worker(name: str) -> dict[str, object]:
        data: dict[str, object] = prepare(name)
        if "Dask Worker" in name:
            data = {key: data[key] for key in data if "init_main" not in key}
        return data

    spawn.get_preparation_data = prepare_worker
    os.environ |= {"PYTHONSAFEPATH": "1", "PYTHONWARNINGS": quiet}
    try:
        yield
    finally:
        spawn.get_preparation_data = prepare
        for name in ("PYTHONSAFEPATH", "PYTHONWARNINGS"):
            os.environ.pop(name)
            os.environ |= {name: before[name]} if name in before else {}


def run_program(
    command: Sequence[str],
    *,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
    timeout_s: float | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a program without input; return exit code and output, with undecodable bytes replaced.

    A signal ends the program's process group before KeyboardInterrupt. Raises OSError
    if the program does not start, and subprocess.TimeoutExpired after `timeout_s`.
    """
    until = None if timeout_s is None else time.monotonic() + timeout_s
    with interrupts.hold_signals() as came:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            process_group=0,
        )
        try:
            while True:
                try:
                    out, err = process.communicate(timeout=LOOK_S)
                    break
                except subprocess.TimeoutExpired:
                    late = until is not None and time.monotonic() > until
                    # Outside the main thread, `came` stays empty.
                    if came or interrupts.received or late:
                        out, err = _end(process)
                        if late and timeout_s is not None:
                            raise subprocess.TimeoutExpired(command, timeout_s) from None
                        break
        except BaseException:
            _end(process)
            raise
    interrupts.check()
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def _end(process: subprocess.Popen[str]) -> tuple[str, str]:
    for name in ("SIGTERM", "SIGKILL"):
        with contextlib.suppress(ProcessLookupError):
            if hasattr(os, "killpg"):
                os.killpg(process.pid, signal.Signals[name])
            else:  # Windows has no process groups
                process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=GRACE_S)
    return "", ""


@contextlib.contextmanager
def silent_stderr() -> Iterator[None]:
    """Redirect the process's stderr to /dev/null."""
    if sys.stderr is None:  # if stderr is closed, descriptor 2 may be another file
        yield
        return
    sys.stderr.flush()
    saved = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)

"""Programs that a command runs and waits for: they end with it, and print any bytes; C libraries that print."""

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

#: Pause between two looks whether a signal came, s.
LOOK_S = 0.1
#: Time in which an ended program removes its own files, before it is killed, s.
GRACE_S = 5.0


@contextlib.contextmanager
def starting_python() -> Iterator[None]:
    """Have the processes that multiprocessing starts meanwhile import nothing from the current folder.

    Nor do they warn of semaphores that are left when a signal ends them all.
    """
    quiet = ",".join(filter(None, [os.environ.get("PYTHONWARNINGS"), "ignore:resource_tracker:UserWarning"]))
    before = dict(os.environ)
    os.environ |= {"PYTHONSAFEPATH": "1", "PYTHONWARNINGS": quiet}
    try:
        yield
    finally:
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
    """Run a program without input until it ends; return its exit code and what it printed, undecodable bytes marked.

    A signal that ends this command ends the program first, with all programs that it started: they are a process group
    of their own. Raises OSError when it cannot be run, subprocess.TimeoutExpired when it takes longer than `timeout_s`.
    """
    until = None if timeout_s is None else time.monotonic() + timeout_s
    with interrupts.held() as came:
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
                    # Other threads hold no signals; they see those of the main thread.
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
    """End a program and all that it started; return what it printed."""
    for name in ("SIGTERM", "SIGKILL"):
        with contextlib.suppress(ProcessLookupError):
            if hasattr(os, "killpg"):
                os.killpg(process.pid, signal.Signals[name])
            else:  # Windows has no groups of processes
                process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=GRACE_S)
    return "", ""


@contextlib.contextmanager
def silent_stderr() -> Iterator[None]:
    """Redirect the process's stderr to /dev/null."""
    if sys.stderr is None:  # closed; file number 2 may belong to another file
        yield
        return
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)

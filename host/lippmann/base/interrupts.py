"""Records Ctrl-C and SIGTERM, because some libraries drop KeyboardInterrupt."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType

#: Signal of a closed terminal; `None` on Windows.
HANGUP = getattr(signal, "SIGHUP", None)
ENDING = (signal.SIGINT, signal.SIGTERM, *([HANGUP] if HANGUP else []))

#: Numbers of the signals received so far.
received: list[int] = []


def install() -> None:
    """Make the signals in `ENDING` raise KeyboardInterrupt; under nohup, SIGHUP stays ignored."""
    for number in ENDING:
        if number != HANGUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, receive)


def ignore() -> None:
    """Ignore the signals in `ENDING` while Python shuts down."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)


def receive(number: int, frame: FrameType | None) -> None:
    """Record the signal's number and raise KeyboardInterrupt."""
    received.append(number)
    raise KeyboardInterrupt


def check() -> None:
    """Raise KeyboardInterrupt if this process received a signal."""
    if received:
        raise KeyboardInterrupt


def exit_code() -> int:
    """Return 128 plus the number of the first received signal, such as 130 after Ctrl-C."""
    return 128 + (received[0] if received else signal.SIGINT)


def leave(code: int) -> None:
    """End the process without closing libraries; return only if the output cannot be flushed."""
    with contextlib.suppress(OSError, ValueError):
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:  # the parent process may have closed the stream
                stream.flush()
        os._exit(code)


@contextlib.contextmanager
def hold_signals() -> Iterator[list[int]]:
    """Delay the signals in `ENDING` until the block ends; provide a list of the received signals.

    KeyboardInterrupt would break C++ libraries while they load, and subprocess while it
    holds a lock. A signal mask would not help: other threads would get the signals.
    """
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in ENDING}
    # Only the main thread can set handlers, and only Python handlers can be restored.
    if threading.current_thread() is not threading.main_thread() or None in before.values():
        yield came
        return
    for number, handler in before.items():
        if handler != signal.SIG_IGN:
            signal.signal(number, lambda number, _: came.append(number))
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


@contextlib.contextmanager
def blocked_in_children() -> Iterator[None]:
    """Block the signals in `ENDING` in new child processes.

    This process ends its children itself. On Windows, no signal is blocked.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker  # slow to load

    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        resource_tracker.ensure_running()  # the tracker's start unblocks signals
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

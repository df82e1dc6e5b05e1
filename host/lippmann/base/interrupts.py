"""Ctrl-C and SIGTERM, remembered: some libraries drop the exception while they load; long work asks between steps."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType

#: The signal of a terminal that is lost; Windows has none.
HANGUP = getattr(signal, "SIGHUP", None)
#: Signals that end a command: Ctrl-C, the end that another program asks for, and the loss of the terminal.
ENDING = (signal.SIGINT, signal.SIGTERM, *([HANGUP] if HANGUP else []))

#: Signals received.
received: list[int] = []


def install() -> None:
    """Have each signal of `ENDING` raise KeyboardInterrupt; SIGHUP stays ignored under nohup."""
    for number in ENDING:
        if number != HANGUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, receive)


def ignore() -> None:
    """Let signals of `ENDING` change nothing any more: while Python ends, it would die of them."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)


def receive(number: int, frame: FrameType | None) -> None:
    """Keep the signal's number and raise KeyboardInterrupt, as Python's own handler does for SIGINT."""
    received.append(number)
    raise KeyboardInterrupt


def check() -> None:
    """Raise KeyboardInterrupt again when a signal was received."""
    if received:
        raise KeyboardInterrupt


def exit_code() -> int:
    """Return the exit code of a command that a signal ended: 128 and the first signal, 130 after Ctrl-C."""
    return 128 + (received[0] if received else signal.SIGINT)


def leave(code: int) -> None:
    """End the process without taking down its libraries; return if what was printed cannot be written."""
    with contextlib.suppress(OSError, ValueError):
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:  # closed by who called
                stream.flush()
        os._exit(code)


@contextlib.contextmanager
def held(*numbers: int) -> Iterator[list[int]]:
    """Let signals, those of `ENDING` unless others are named, wait until the block ends; yields those that came.

    For code that an exception at any place would break: C++ that loads, and subprocess, whose lock would stay taken.
    To block the signals would not do: other libraries' threads take them, and Python answers in this one.
    """
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in numbers or ENDING}
    # Only the main thread has handlers, and those that are not Python's cannot be put back.
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
    """Block the signals of `ENDING` in processes that multiprocessing starts meanwhile: this process ends them.

    A terminal sends its signals to all of them. Windows has no signal masks; there the context does nothing.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker  # slow to load

    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        resource_tracker.ensure_running()  # it unblocks some signals, so it starts before the other processes
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

"""Ctrl-C, noted: some libraries drop the exception while they load, so work that takes long asks between its steps."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

#: Signals received.
received: list[int] = []


def note(number: int, frame: FrameType | None) -> None:
    """Note a signal and raise KeyboardInterrupt, as Python's own handler does."""
    received.append(number)
    raise KeyboardInterrupt


def check() -> None:
    """Raise KeyboardInterrupt again when a signal was received."""
    if received:
        raise KeyboardInterrupt


@contextlib.contextmanager
def held(*numbers: int) -> Iterator[list[int]]:
    """Let signals, SIGINT unless others are named, wait until the block ends; yields the list of those that came.

    For code that an exception at any place would break: C++ that loads, and subprocess, whose lock would stay taken.
    To block the signals would not do: other libraries' threads take them, and Python answers in this one.
    """
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in numbers or (signal.SIGINT,)}
    # Only the main thread has handlers, and those that are not Python's cannot be put back.
    if threading.current_thread() is not threading.main_thread() or None in before.values():
        yield came
        return
    for number in before:
        signal.signal(number, lambda number, _: came.append(number))
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])

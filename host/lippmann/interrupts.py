"""Ctrl-C, noted: some libraries drop the exception while they load, so long work asks again between its steps."""

from __future__ import annotations

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

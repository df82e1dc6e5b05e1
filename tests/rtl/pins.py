"""Ports of a design that are quick to write."""

import random


class Pin:
    """A handle that is written only when its value changes: cocotb takes microseconds to write one.

    From then on nothing else may write the handle.
    """

    def __init__(self, handle):
        self._handle, self._written, self._told = handle, None, True

    def __len__(self) -> int:
        return len(self._handle)

    @property
    def value(self):
        return self._handle.value

    @value.setter
    def value(self, value: int) -> None:
        self._told = True
        self._write(value)

    def noise(self, bits: int) -> None:
        """A random word in the place of what was told, and now and then another."""
        if self._told or not random.getrandbits(2):
            self._told = False
            self._write(random.getrandbits(bits))

    def _write(self, value: int) -> None:
        if value != self._written:
            self._handle.value = self._written = value


class Pins:
    """The ports of a design. All writes of a port go through this object, which remembers the last one.

    cocotb takes as long to find a port as to read it, so each is found once.
    """

    def __init__(self, dut):
        self._dut = dut

    def __getattr__(self, name: str) -> Pin:
        pin = Pin(getattr(self._dut, name))
        setattr(self, name, pin)
        return pin

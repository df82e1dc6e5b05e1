"""Ports of a design that are quick to write."""

import random


class Pin:
    """A handle that is written only when its value changes: cocotb takes microseconds to write one."""

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
        """Another word than what was told, and now and then another again."""
        if self._told or not random.getrandbits(2):
            self._told = False
            self._write(random.getrandbits(bits))

    def _write(self, value: int) -> None:
        if value != self._written:
            self._handle.value = self._written = value


class Pins:
    """A design's ports. Who writes one writes it here: what was written last is known.

    Each is looked for once, which takes as long as to read it.
    """

    def __init__(self, dut):
        self._dut = dut

    def __getattr__(self, name: str) -> Pin:
        pin = Pin(getattr(self._dut, name))
        setattr(self, name, pin)
        return pin

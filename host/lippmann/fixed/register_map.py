"""The registers of the optics block, of the board and of its scene, read from the data that `make registers` writes.

`optics.json`, `board.json` and `scene.json` are generated from rtl/registers.rdl; an item with its default value is
left out of them.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from importlib.resources import files

import msgspec


@dataclass(frozen=True)
class Field:
    """Bits `low` to `low + width - 1` of a register; `reset` is None where the hardware drives the value.

    `fraction` is the number of fraction bits, or its formula in F, the build's fraction bits. Where only some values
    have a meaning, `names` holds those with their names.
    """

    low: int
    width: int
    reset: int | None = None
    signed: bool = False
    fraction: str = ""
    unit: str = ""
    description: str = ""
    names: tuple[tuple[int, str], ...] = ()

    @property
    def mask(self) -> int:
        """The field's bits in its register's word."""
        return ((1 << self.width) - 1) << self.low

    @property
    def limits(self) -> tuple[int, int]:
        """The smallest and the largest value."""
        low = -(1 << (self.width - 1)) if self.signed else 0
        return low, low + (1 << self.width) - 1

    def value(self, word: int) -> int:
        """Return the field's value in its register's word."""
        value = (word & self.mask) >> self.low
        return value - (1 << self.width) if value > self.limits[1] else value

    def bits(self, value: int) -> int:
        """Return the word that holds a value, which is within the limits, in this field and 0 elsewhere."""
        return value << self.low & self.mask


@dataclass(frozen=True)
class Register:
    """A register of 32 bits at a byte address, or a memory of `entries` such words, which has no fields.

    `access` is "read", "write" or "read, write". `group` is the part of the name that the registers of a group share,
    or empty; `title` is the heading of the register's table in the documentation.
    """

    address: int
    entries: int = 1
    access: str = "read, write"
    group: str = ""
    title: str = ""
    description: str = ""
    fields: dict[str, Field] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True)
class _File:
    registers: dict[str, Register]


def _load(name: str) -> dict[str, Register]:
    return msgspec.json.decode(files("lippmann.fixed").joinpath("generated", name).read_bytes(), type=_File).registers


#: Registers by name, those of a group with the group's name in front; byte addresses from the block's own base on.
OPTICS_REGISTERS = _load("optics.json")
BOARD_REGISTERS = _load("board.json")
SCENE_REGISTERS = _load("scene.json")

"""Load the register maps of optics block, board and scene, and compute register writes.

`make registers` generates the maps, generated/*.json, from rtl/registers.rdl.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import NamedTuple, get_args

import msgspec

from lippmann.display.description import Grid
from lippmann.errors import InputError
from lippmann.fixed.build import Build, HardwareModel
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.raster import TABLE_ENTRIES, Jitter, Raster
from lippmann.fixed.words import Ints


@dataclass(frozen=True)
class Field:
    """A register's bits `low` to `low + width - 1`; `reset` is None if the hardware drives the value.

    `fraction` is the number of fraction bits, or a formula with the build's F. `names`,
    unless empty, lists the allowed values and their names.
    """

    low: int
    width: int
    reset: int | None = None
    signed: bool = False
    fraction: str = ""
    names: tuple[tuple[int, str], ...] = ()

    @property
    def mask(self) -> int:
        """Mask of the field's bits in the register's word."""
        return ((1 << self.width) - 1) << self.low

    @property
    def limits(self) -> tuple[int, int]:
        """Minimum and maximum of the field's value."""
        low = -(1 << (self.width - 1)) if self.signed else 0
        return low, low + (1 << self.width) - 1

    def value(self, word: int) -> int:
        """Return the field's value in the register's word."""
        value = (word & self.mask) >> self.low
        return value - (1 << self.width) if value > self.limits[1] else value

    def bits(self, value: int) -> int:
        """Return the register word with `value` in this field and 0 elsewhere."""
        return value << self.low & self.mask


@dataclass(frozen=True)
class Register:
    """A 32-bit register at a byte address, or a memory of `entries` 32-bit words without fields.

    `access` is "read", "write" or "read, write".
    """

    address: int
    entries: int = 1
    access: str = "read, write"
    fields: dict[str, Field] = dataclasses.field(default_factory=dict)

    def values(self, word: int) -> dict[str, int]:
        """Return the value of each field in the register's word."""
        return {name: field.value(word) for name, field in self.fields.items()}

    def word(self, **values: int) -> int:
        """Return the word that contains the given value of each field."""
        return sum(field.bits(values[name]) for name, field in self.fields.items())


def _load(name: str) -> dict[str, Register]:
    items = json.loads(files("lippmann.fixed").joinpath("generated", name).read_bytes())
    return msgspec.convert(items["registers"], dict[str, Register])


#: Registers keyed by name (`raster_panel`); addresses are byte offsets in the block.
OPTICS_REGISTERS = _load("optics.json")
BOARD_REGISTERS = _load("board.json")
SCENE_REGISTERS = _load("scene.json")

#: Boolean parameters of `Build` that are also fields of the register `build`.
_FLAGS = ("viewer", "aims", "cross_cells", "converge", "shear")


class Write(NamedTuple):
    """One write of a 32-bit word to a byte address."""

    address: int
    word: int


def write(name: str, **values: int) -> Write:
    """Return the write that sets fields of a register; other fields get their reset values.

    Raises InputError for an unknown register or field, and for a value out of range.
    """
    if name not in OPTICS_REGISTERS:
        raise InputError(f"there is no register '{name}'; see docs/generated/registers.md")
    register = OPTICS_REGISTERS[name]
    if unknown := values.keys() - register.fields.keys():
        raise InputError(f"register {name} has no field {', '.join(sorted(unknown))}")
    values = {key: field.reset or 0 for key, field in register.fields.items()} | values
    for key, value in values.items():
        low, high = register.fields[key].limits
        if not low <= value <= high:
            raise InputError(f"register {name}, field {key}: {value} is outside its range [{low}, {high + 1})")
    return Write(register.address, register.word(**values))


def optics_writes(config: Configuration) -> list[Write]:
    """Return the writes of a display's configuration; the command `apply` activates the values."""
    writes = []
    for field, value in dataclasses.asdict(config).items():
        name = f"optics_{field}"
        if name in OPTICS_REGISTERS:
            writes.append(write(name, value=value))
        else:  # the value is too wide for one register
            high, low = divmod(value, 1 << 32)
            writes += [write(f"{name}_low", value=low), write(f"{name}_high", value=high)]
    return writes


def raster_writes(frame: Raster) -> list[Write]:
    """Return the writes of a frame's window and jitter; the command `start` starts the frame."""
    mode = get_args(Jitter).index(frame.jitter)
    return [
        write("raster_columns", first=frame.columns[0], last=frame.columns[1]),
        write("raster_rows", first=frame.rows[0], last=frame.rows[1]),
        write("raster_panel", width=frame.width, height=frame.height),
        write("raster_jitter", samples=frame.samples & 0xFFFF, mode=mode, table_first=frame.table_first),
        write("raster_seed", value=frame.seed),
    ]


def table_writes(table: Ints, first: int = 0) -> list[Write]:
    """Return the writes of jitter entries (N,) from index `first`; refuse entries beyond the table."""
    if not 0 <= first <= TABLE_ENTRIES - len(table):
        raise InputError(f"jitter table: {len(table)} entries from {first} do not fit; the table has {TABLE_ENTRIES}")
    start = OPTICS_REGISTERS["jitter_table"].address + 4 * first
    return [Write(start + 4 * k, int(word)) for k, word in enumerate(table)]


def build_of(words: Mapping[str, int]) -> Build:
    """Return an optics block's RTL build from its registers `identity`, `version` and `build`.

    Raises InputError if a word is missing, or if this host does not support the block.
    """
    if missing := [name for name in ("identity", "version", "build") if name not in words]:
        raise InputError(f"register {', '.join(missing)} was not read; read identity, version and build")
    identity = OPTICS_REGISTERS["identity"].fields["letters"].reset
    if words["identity"] != identity:
        raise InputError(f"no optics block answers: the identity is 0x{words['identity']:08X}, not 0x{identity:08X}")
    version = OPTICS_REGISTERS["version"].values(words["version"])["major"]
    version_here = OPTICS_REGISTERS["version"].fields["major"].reset
    if version != version_here:
        raise InputError(
            f"the optics block has register map {version}, this host supports {version_here}; update block or host"
        )
    fields = OPTICS_REGISTERS["build"].values(words["build"])
    models, model = get_args(HardwareModel), fields["model"]
    if model >= len(models):
        known_models = f"this host, which supports 0 to {len(models) - 1}"
        raise InputError(f"register build, field model: {model} is unknown to {known_models}; update the host")
    flags = {name: bool(fields[name]) for name in _FLAGS}
    grid = get_args(Grid)[fields["grid"]]
    return Build(fields["fraction_bits"], grid, models[model], max_cell_steps=fields["walk"], **flags)


def build_word(build: Build) -> int:
    """Return the word of the optics register `build`, which is also the RTL's parameter `Build`."""
    return OPTICS_REGISTERS["build"].word(
        fraction_bits=build.fraction_bits,
        grid=get_args(Grid).index(build.grid),
        model=get_args(HardwareModel).index(build.model),
        walk=build.max_cell_steps,
        **{name: int(getattr(build, name)) for name in _FLAGS},
    )

"""Reads a netlist of ECP5 cells as a graph, from yosys' flattened JSON after `synth_ecp5`."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from lippmann.errors import InputError, LippmannError, input_error, reason

#: A bit: its number in yosys' JSON, or a constant "0", "1", "x" or "z".
Bit = int | str

#: The inputs on which an unclocked cell's outputs depend, keyed by cell type and output.
_CARRY = ("CIN", "A0", "B0", "C0", "D0")
COMBINATIONAL: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "LUT4": {"Z": ("A", "B", "C", "D")},
    "PFUMX": {"Z": ("ALUT", "BLUT", "C0")},
    "L6MUX21": {"Z": ("D0", "D1", "SD")},
    "CCU2C": {"S0": _CARRY, **dict.fromkeys(("S1", "COUT"), (*_CARRY, "A1", "B1", "C1", "D1"))},
    "INV": {"Z": ("A",)},
}
#: Cell types that buffer a clock, with their input and output.
CLOCK_BUFFERS = {"DCCA": ("CLKI", "CLKO")}
#: Cell types that output clocks, each with those of its outputs that are levels.
CLOCK_SOURCES = {"EHXPLLL": {"LOCK", "INTLOCK", "REFCLK"}, "OSCG": set[str]()}
#: Cell types at the chip's pins, with their port at the pin.
PINS = {"BB": "B", "TRELLIS_IO": "B", "IB": "I", "OB": "O", "OBZ": "O"}
#: Cell types that output two bits per clock: ports of clock, bits and asynchronous reset.
OUTPUT_CELLS = {"ODDRX1F": ("SCLK", ("D0", "D1"), "RST")}


class Pin(NamedTuple):
    """A pin of a cell: one bit of a port, with the index `place`."""

    cell: str
    port: str
    place: int = 0


@dataclass(frozen=True)
class Cell:
    """A cell instance: type, parameters as yosys writes them, and the bits at each port."""

    kind: str
    parameters: Mapping[str, str]
    connections: Mapping[str, list[Bit]]
    # File and line in the RTL, if yosys reports them.
    source: str = ""

    def bit(self, port: str) -> Bit:
        """Return the bit at a one-bit port, or "0" if unconnected."""
        return self.connections.get(port, ["0"])[0]

    def choice(self, name: str) -> str:
        """Return a text parameter, or "" if the cell lacks it."""
        return self.parameters.get(name, "").strip()

    def number(self, name: str) -> int:
        """Return a binary parameter, or 0 if the cell lacks it."""
        return int(self.parameters.get(name, "0"), 2)


class Register(NamedTuple):
    """A flip-flop: its name, cell and clock, and the bit `data` that it samples."""

    name: str
    cell: Cell
    clock: Bit
    data: Bit

    @property
    def control(self) -> tuple[Bit, str, Bit]:
        """The register's clock and enable."""
        return self.clock, self.cell.choice("CEMUX"), self.cell.bit("CE")


class Sampled(NamedTuple):
    """A sampled input: its pin, bit and clock."""

    pin: Pin
    bit: Bit
    clock: Bit


class Source(NamedTuple):
    """A source of logic: a register, the content of a memory (`memory`), or a level (`clock` is None)."""

    name: str
    clock: Bit | None
    cell: str | None
    memory: bool = False


class Netlist:
    """A flat netlist. Each bit has one driver and any number of readers."""

    def __init__(self, module: Mapping[str, Any]) -> None:
        """Read a module of yosys' JSON; raise LippmannError for a cell type unknown to gates.py."""
        self.cells = {
            name: Cell(cell["type"], cell["parameters"], cell["connections"], _source(cell.get("attributes", {})))
            for name, cell in module["cells"].items()
            if not cell["type"].startswith("$scopeinfo")
        }
        if unknown := ", ".join(sorted({cell.kind for cell in self.cells.values()} - _KNOWN)):
            raise LippmannError(f"the netlist has unknown cell types ({unknown}); add them to gates.py")
        self.driver: dict[Bit, Pin] = {}
        self.readers: dict[Bit, list[Pin]] = {}
        for name, cell in self.cells.items():
            directions = module["cells"][name]["port_directions"]
            for port, bits in cell.connections.items():
                for index, bit in enumerate(bits):
                    if directions[port] == "output":
                        self.driver[bit] = Pin(name, port, index)
                    elif isinstance(bit, int):
                        self.readers.setdefault(bit, []).append(Pin(name, port, index))
        self.outputs = {
            bit for port in module["ports"].values() if port["direction"] != "input" for bit in port["bits"]
        }
        self.names: dict[Bit, str] = {}
        for name, net in module["netnames"].items():
            for text, bit in _indexed(name, net["bits"]):
                if bit not in self.names or _rank(text) < _rank(self.names[bit]):
                    self.names[bit] = text
        for name, port in module["ports"].items():
            if port["direction"] != "output":
                self.names |= {bit: text for text, bit in _indexed(name, port["bits"])}
        self.synchronisers = {
            name: net["bits"]
            for name, net in module["netnames"].items()
            if "async_reg" in net.get("attributes", {}) and not net.get("hide_name")
        }

    def clock(self, bit: Bit) -> Bit:
        """Return the net before a clock's buffers."""
        while bit in self.driver and self.cells[self.driver[bit].cell].kind in CLOCK_BUFFERS:
            cell = self.cells[self.driver[bit].cell]
            bit = cell.bit(CLOCK_BUFFERS[cell.kind][0])
        return bit

    def name(self, bit: Bit | None) -> str:
        """Return a bit's shortest name in the RTL, or the cell that drives an unnamed bit."""
        name = self.names.get(bit, str(bit)) if bit is not None else "pin"
        if not _is_made(name) or bit not in self.driver:
            return name
        return self.described(self.driver[bit].cell)

    def described(self, cell: str) -> str:
        """Return a cell's name or, if yosys composed the name, the cell's type and line in the RTL."""
        source = self.cells[cell].source
        return f"{self.cells[cell].kind} of {source}" if source and _is_made(cell) else cell

    def sampled(self) -> Iterator[Sampled]:
        """Yield the inputs that clocks sample, except asynchronous resets."""
        for name, cell in self.cells.items():
            for port, clock in _clocks_of_inputs(cell).items():
                where = self.clock(clock)
                for index, bit in enumerate(cell.connections.get(port, [])):
                    yield Sampled(Pin(name, port, index), bit, where)

    def block_memories(self) -> Iterator[tuple[str, Bit, Bit]]:
        """Yield the names of block memories whose write and read clocks differ, with both clocks."""
        for name, cell in self.cells.items():
            if cell.kind == "DP16KD":
                clocks = self.clock(cell.bit("CLKA")), self.clock(cell.bit("CLKB"))
                if clocks[0] != clocks[1] and "0" not in clocks:
                    yield name, *clocks

    def asynchronous_resets(self) -> Iterator[Sampled]:
        """Yield all inputs of asynchronous resets, each with the clock of the reset cell."""
        for name, cell in self.cells.items():
            if cell.kind == "TRELLIS_FF" and cell.choice("SRMODE") == "ASYNC":
                yield Sampled(Pin(name, "LSR"), cell.bit("LSR"), self.clock(cell.bit("CLK")))
            elif cell.kind in OUTPUT_CELLS:
                clock, _, port = OUTPUT_CELLS[cell.kind]
                yield Sampled(Pin(name, port), cell.bit(port), self.clock(cell.bit(clock)))

    def register(self, bit: Bit) -> Register | None:
        """Return the flip-flop that drives a bit, or None."""
        pin = self.driver.get(bit)
        if pin is None or self.cells[pin.cell].kind != "TRELLIS_FF":
            return None
        cell = self.cells[pin.cell]
        return Register(pin.cell, cell, self.clock(cell.bit("CLK")), cell.bit("DI"))

    def before(self, bit: Bit) -> tuple[list[Bit], list[Source]]:
        """Return the inputs of the logic that drives a bit, and the sources that drive the bit."""
        if not isinstance(bit, int):
            return [], []
        pin = self.driver.get(bit)
        if pin is None:
            return [], [Source(self.name(bit), None, None)]
        cell = self.cells[pin.cell]
        inner: list[Bit] = []
        sources: list[Source] = []
        if cell.kind in COMBINATIONAL:
            inner = [cell.bit(port) for port in COMBINATIONAL[cell.kind][pin.port]]
        elif cell.kind in CLOCK_BUFFERS:
            inner = [cell.bit(CLOCK_BUFFERS[cell.kind][0])]
        elif cell.kind in PINS:
            sources = [Source(self.name(cell.bit(PINS[cell.kind])), None, None)]
        elif cell.kind in CLOCK_SOURCES:
            level = pin.port in CLOCK_SOURCES[cell.kind]
            sources = [Source(f"{pin.cell}.{pin.port}", None if level else bit, pin.cell)]
        elif cell.kind == "TRELLIS_DPR16X4":
            inner = list(cell.connections["RAD"])
            sources = [Source(pin.cell, self.clock(cell.bit("WCK")), pin.cell, memory=True)]
        elif (clock := _clock_of_output(cell, pin.port)) is None:  # a multiplier that uses no registers
            inner = [one for port, bits in cell.connections.items() if re.match(r"[AB]\d", port) for one in bits]
        else:
            sources = [Source(self.name(bit), self.clock(clock), pin.cell)]
        return inner, sources

    @cached_property
    def _order(self) -> list[Bit]:
        """All bits that cells read or drive, each after the bits on which it depends."""
        graph = {bit: self.before(bit)[0] for bit in (*self.driver, *self.readers)}
        try:
            return list(TopologicalSorter(graph).static_order())
        except CycleError as error:
            loop = self.name(error.args[1][0])
            raise LippmannError(f"the netlist has a loop of logic at {loop}; break the loop with a register") from None

    def collect(self, value: Callable[[Source], Bit | None]) -> dict[Bit, frozenset[Bit | None]]:
        """Return a set for each bit: `value(source)` of every source of the logic before the bit."""
        values: dict[Bit, frozenset[Bit | None]] = {}
        for bit in self._order:
            inner, sources = self.before(bit)
            values[bit] = frozenset(map(value, sources)).union(*(values[one] for one in inner))
        return values

    @cached_property
    def clocks(self) -> dict[Bit, frozenset[Bit | None]]:
        """The clocks of the sources before each bit that a cell reads or drives; None for levels such as pins."""
        return self.collect(lambda source: source.clock)

    def ends(self, bits: Iterable[Bit]) -> dict[Bit, list[Source]]:
        """Search the logic before `bits` for bits that have sources; return the sources, keyed by bit."""
        ends: dict[Bit, list[Source]] = {}
        visited: set[Bit] = set()
        todo = list(bits)
        while todo:
            bit = todo.pop()
            if bit not in visited:
                visited.add(bit)
                inner, sources = self.before(bit)
                todo += inner
                if sources:
                    ends[bit] = sources
        return ends

    def sources(self, bits: Iterable[Bit]) -> list[Source]:
        """Return all sources of the logic before `bits`."""
        return list(dict.fromkeys(chain.from_iterable(self.ends(bits).values())))

    def straight(self, bit: Bit) -> Bit:
        """Return the bit before inverters and one-input lookup tables, which cause no glitches."""
        while True:
            pin = self.driver.get(bit)
            if pin is None or self.cells[pin.cell].kind not in ("LUT4", "INV"):
                return bit
            inner = {one for one in self.before(bit)[0] if isinstance(one, int)}
            if len(inner) != 1:
                return bit
            bit = inner.pop()

    def value(self, bit: Bit, values: dict[Bit, int]) -> int:
        """Evaluate a bit of logic from `values` of the sources; raise KeyError if a source has no value."""
        if isinstance(bit, str):
            return int(bit == "1")
        if bit not in values:
            pin = self.driver[bit]
            cell = self.cells[pin.cell]
            if cell.kind not in COMBINATIONAL:
                raise KeyError(self.name(bit))
            inputs = {port: self.value(cell.bit(port), values) for port in COMBINATIONAL[cell.kind][pin.port]}
            values[bit] = _evaluated(cell, pin.port, inputs)
        return values[bit]


def read_netlist(path: Path, top: str | None = None) -> Netlist:
    """Read yosys' netlist; `top` names the module if several have cells. Raises InputError for an invalid file."""
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {reason(error)}; give a netlist that yosys wrote with -json") from None
    try:
        modules = content["modules"]
        marks = {name: set(module.get("attributes", {})) for name, module in modules.items()}
        names = [name for name in modules if not marks[name] & {"blackbox", "whitebox"} and modules[name]["cells"]]
        tops = [name for name in names if name == top or (top is None and "top" in marks[name])]
        tops = names if top is None and len(names) == 1 else tops
        if len(tops) != 1:
            raise input_error(str(path), f"its modules with cells: {', '.join(names) or 'none'}", "choose with --top")
        return Netlist(modules[tops[0]])
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):
        raise input_error(str(path), "this is not a netlist of yosys", "write it with synth_ecp5 -json") from None


def _indexed(name: str, bits: list[Bit]) -> list[tuple[str, Bit]]:
    return [(name if len(bits) == 1 else f"{name}[{index}]", bit) for index, bit in enumerate(bits)]


def _is_made(name: str) -> bool:
    """Return whether yosys composed a name, which the RTL does not have."""
    return bool(re.search(r"_(TRELLIS|LUT4|CCU2C|PFUMX|L6MUX|MULT18|DP16KD|DPR16|WAD|RAD|DI|DO)", name)) or "$" in name


def _rank(name: str) -> tuple[bool, bool, int]:
    """Return the sort key of a bit's names: the RTL's names first, then short names first."""
    return _is_made(name), "." in name and "_q" not in name, len(name)


def _source(attributes: Mapping[str, str]) -> str:
    """Return the first file and line of the RTL in a cell's attributes."""
    places = attributes.get("src", "").split("|")
    first = next((place for place in places if not place.startswith("/share/")), "")
    return re.sub(r"^(.*?:\d+).*", r"\1", first.rpartition("/")[2])


def _evaluated(cell: Cell, output: str, values: Mapping[str, int]) -> int:
    if cell.kind == "INV":
        return 1 - values["A"]
    if cell.kind == "LUT4":
        return cell.number("INIT") >> (values["A"] + 2 * values["B"] + 4 * values["C"] + 8 * values["D"]) & 1
    if cell.kind == "PFUMX":
        return values["ALUT"] if values["C0"] else values["BLUT"]
    if cell.kind == "L6MUX21":
        return values["D1"] if values["SD"] else values["D0"]
    carry = values["CIN"]
    total = 0
    for half in ("0", "1") if output != "S0" else ("0",):
        table = cell.number(f"INIT{half}")
        a, b, c, d = (values[f"{letter}{half}"] for letter in "ABCD")
        injects = cell.choice(f"INJECT1_{half}") == "YES"
        adds = table >> (a + 2 * b + 4 * c + 8 * d) & 1
        total = adds ^ (0 if injects else carry)
        carry = carry if adds else 0 if injects else table >> (a + 2 * b) & 1
    return carry if output == "COUT" else total


def _clock_of_rank(cell: Cell, rank: str) -> Bit | None:
    """Return the clock of a multiplier's register stage, or None if it is not used."""
    name = cell.choice(f"REG_{rank}_CLK")
    return None if name in ("", "NONE") else cell.bit(name)


def _clocks_of_inputs(cell: Cell) -> dict[str, Bit]:
    """Return the clocks at which a cell's inputs are sampled, keyed by port."""
    ports = cell.connections
    if cell.kind == "TRELLIS_FF":
        used = ["DI", "CE"] if cell.choice("CEMUX") in ("CE", "INV") else ["DI"]
        used += ["LSR"] if cell.choice("SRMODE") != "ASYNC" else []
        used += ["M"] if cell.choice("LSRMODE") == "PRLD" else []
        return dict.fromkeys(used, cell.bit("CLK"))
    if cell.kind == "TRELLIS_DPR16X4":
        return dict.fromkeys(("DI", "WAD", "WRE"), cell.bit("WCK"))
    if cell.kind == "DP16KD":
        sides = {port: side[1] for port in ports if (side := re.fullmatch(r"(?:DI|AD|O?CE|WE|RST|CS)([AB])\d*", port))}
        # With 36-bit words, the clock of port A samples the data of both ports.
        by_a = {port for port, side in sides.items() if side == "A" or (port[:3] == "DIB" and _is_wide(cell))}
        return {port: cell.bit("CLKA" if port in by_a else "CLKB") for port in sides}
    if cell.kind == "MULT18X18D":
        # Of a multiplier's registers (inputs, middle, product), the first one samples an operand.
        later = _clock_of_rank(cell, "PIPELINE") or _clock_of_rank(cell, "OUTPUT")
        clocks = {letter: _clock_of_rank(cell, f"INPUT{letter}") or later for letter in "AB"}
        return {port: clock for port in ports if re.match(r"[AB]\d", port) and (clock := clocks[port[0]]) is not None}
    if cell.kind in OUTPUT_CELLS:
        clock, sampled, _ = OUTPUT_CELLS[cell.kind]
        return dict.fromkeys(sampled, cell.bit(clock))
    return {}


def _is_wide(cell: Cell) -> bool:
    return int(cell.parameters["DATA_WIDTH_A"], 2) == 36


def _clock_of_output(cell: Cell, port: str) -> Bit | None:
    """Return the clock at which an output changes, or None for a multiplier that uses no registers."""
    if cell.kind == "TRELLIS_FF":
        return cell.bit("CLK")
    if cell.kind == "DP16KD":
        return cell.bit("CLKB" if port.startswith("DOB") or _is_wide(cell) else "CLKA")
    if cell.kind == "MULT18X18D":
        ranks = [_clock_of_rank(cell, rank) for rank in ("OUTPUT", "PIPELINE", "INPUTA", "INPUTB")]
        return next((clock for clock in ranks if clock is not None), None)
    return cell.bit(OUTPUT_CELLS[cell.kind][0])


_KNOWN = {
    "TRELLIS_FF", "TRELLIS_DPR16X4", "DP16KD", "MULT18X18D",
    *COMBINATIONAL, *CLOCK_BUFFERS, *CLOCK_SOURCES, *PINS, *OUTPUT_CELLS,
}  # fmt: skip

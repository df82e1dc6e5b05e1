"""Reads a netlist of ECP5's cells as a graph, from yosys' flattened JSON after `synth_ecp5`."""

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

#: A net's number, or a constant: "0", "1", "x" or "z".
Bit = int | str

#: The inputs on which each output of an unclocked cell depends.
_CARRY = ("CIN", "A0", "B0", "C0", "D0")
COMBINATIONAL: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "LUT4": {"Z": ("A", "B", "C", "D")},
    "PFUMX": {"Z": ("ALUT", "BLUT", "C0")},
    "L6MUX21": {"Z": ("D0", "D1", "SD")},
    "CCU2C": {"S0": _CARRY, **dict.fromkeys(("S1", "COUT"), (*_CARRY, "A1", "B1", "C1", "D1"))},
    "INV": {"Z": ("A",)},
}
#: Cell types that pass a clock on, such as buffers.
CLOCK_BUFFERS = {"DCCA": ("CLKI", "CLKO")}
#: Cell types whose outputs are clocks, and the outputs of these cells that are levels.
CLOCK_SOURCES = {"EHXPLLL": {"LOCK", "INTLOCK", "REFCLK"}, "OSCG": set[str]()}
#: Cell types at pins, and their port at the pin.
PINS = {"BB": "B", "TRELLIS_IO": "B", "IB": "I", "OB": "O", "OBZ": "O"}
#: Cell types that send two bits per clock: their ports of the clock, of the bits, and of the asynchronous reset.
OUTPUT_CELLS = {"ODDRX1F": ("SCLK", ("D0", "D1"), "RST")}


class Pin(NamedTuple):
    """A pin of a cell: a port and the index `place` of a bit."""

    cell: str
    port: str
    place: int = 0


@dataclass(frozen=True)
class Cell:
    """An instance with its type, its parameters as yosys writes them, and the bits at each port."""

    kind: str
    parameters: Mapping[str, str]
    connections: Mapping[str, list[Bit]]
    source: str = ""  # file and line of the RTL, where yosys tells it

    def bit(self, port: str) -> Bit:
        """Return the bit at a one-bit port; "0" if unconnected."""
        return self.connections.get(port, ["0"])[0]

    def choice(self, name: str) -> str:
        """Return a parameter that is a text, or ""."""
        return self.parameters.get(name, "").strip()

    def number(self, name: str) -> int:
        """Return a parameter that is a binary number, or 0."""
        return int(self.parameters.get(name, "0"), 2)


class Register(NamedTuple):
    """A flip-flop with its name, cell and clock, and the bit that the flip-flop samples."""

    name: str
    cell: Cell
    clock: Bit
    data: Bit

    @property
    def control(self) -> tuple[Bit, str, Bit]:
        """The register's clock and enable."""
        return self.clock, self.cell.choice("CEMUX"), self.cell.bit("CE")


class Sampled(NamedTuple):
    """An input that a clock samples."""

    pin: Pin
    bit: Bit
    clock: Bit


class Source(NamedTuple):
    """A source of the logic before a bit: a register, a memory's content (`memory`), or a level without a `clock`."""

    name: str
    clock: Bit | None
    cell: str | None
    memory: bool = False


class Netlist:
    """A flat netlist, in which a bit has one driver and any number of readers."""

    def __init__(self, module: Mapping[str, Any]) -> None:
        """Read yosys' module; raise LippmannError for a cell type that this module does not know."""
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
        """Return a bit's shortest name in the sources, or else the place of its register in the sources."""
        name = self.names.get(bit, str(bit)) if bit is not None else "pin"
        if not _is_made(name) or bit not in self.driver:
            return name
        return self.described(self.driver[bit].cell)

    def described(self, cell: str) -> str:
        """Return a cell's name, or its place in the sources if yosys composed the name."""
        source = self.cells[cell].source
        return f"{self.cells[cell].kind} of {source}" if source and _is_made(cell) else cell

    def sampled(self) -> Iterator[Sampled]:
        """Yield the inputs that are sampled by clocks, except asynchronous resets."""
        for name, cell in self.cells.items():
            for port, clock in _clocks_of_inputs(cell).items():
                where = self.clock(clock)
                for index, bit in enumerate(cell.connections.get(port, [])):
                    yield Sampled(Pin(name, port, index), bit, where)

    def block_memories(self) -> Iterator[tuple[str, Bit, Bit]]:
        """Yield the block memories that are written by one clock and read by another clock, with both clocks."""
        for name, cell in self.cells.items():
            if cell.kind == "DP16KD":
                clocks = self.clock(cell.bit("CLKA")), self.clock(cell.bit("CLKB"))
                if clocks[0] != clocks[1] and "0" not in clocks:
                    yield name, *clocks

    def asynchronous_resets(self) -> Iterator[Sampled]:
        """Yield the asynchronous resets, each with the clock of the registers that it resets."""
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
        """Return the bits on which a bit directly depends, and its sources; a constant has neither."""
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
        elif (clock := _clock_of_output(cell, pin.port)) is None:  # a multiplier without registers
            inner = [one for port, bits in cell.connections.items() if re.match(r"[AB]\d", port) for one in bits]
        else:
            sources = [Source(self.name(bit), self.clock(clock), pin.cell)]
        return inner, sources

    @cached_property
    def _order(self) -> list[Bit]:
        """The bits that cells read or drive, each after the bits on which it depends."""
        graph = {bit: self.before(bit)[0] for bit in (*self.driver, *self.readers)}
        try:
            return list(TopologicalSorter(graph).static_order())
        except CycleError as error:
            loop = self.name(error.args[1][0])
            raise LippmannError(f"the netlist has a loop of logic at {loop}; break the loop by a register") from None

    def collect(self, value: Callable[[Source], Bit | None]) -> dict[Bit, frozenset[Bit | None]]:
        """Return a value computed from the sources before each bit that a cell reads or drives."""
        values: dict[Bit, frozenset[Bit | None]] = {}
        for bit in self._order:
            inner, sources = self.before(bit)
            values[bit] = frozenset(map(value, sources)).union(*(values[one] for one in inner))
        return values

    @cached_property
    def clocks(self) -> dict[Bit, frozenset[Bit | None]]:
        """The clocks of the sources before each bit that a cell reads or drives; None for pins and other levels."""
        return self.collect(lambda source: source.clock)

    def ends(self, bits: Iterable[Bit]) -> dict[Bit, list[Source]]:
        """Return the bits at which the logic before some bits begins, with these bits' sources."""
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
        """Return all sources before some bits."""
        return list(dict.fromkeys(chain.from_iterable(self.ends(bits).values())))

    def straight(self, bit: Bit) -> Bit:
        """Return the bit that a bit equals or inverts, because a lookup table of one input has no glitch."""
        while True:
            pin = self.driver.get(bit)
            if pin is None or self.cells[pin.cell].kind not in ("LUT4", "INV"):
                return bit
            inner = {one for one in self.before(bit)[0] if isinstance(one, int)}
            if len(inner) != 1:
                return bit
            bit = inner.pop()

    def value(self, bit: Bit, values: dict[Bit, int]) -> int:
        """Return the value of a bit of logic; `values` has the sources' values. Raises KeyError if one is missing."""
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
    """Read yosys' netlist; `top` chooses between modules with cells. Raises InputError if this is not one."""
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
            raise input_error(str(path), f"the netlist has {', '.join(names) or 'no module'}", "choose one with --top")
        return Netlist(modules[tops[0]])
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):
        raise input_error(str(path), "this is not a netlist of yosys", "write one with synth_ecp5 -json") from None


def _indexed(name: str, bits: list[Bit]) -> list[tuple[str, Bit]]:
    """Return the name of each bit of a port or net."""
    return [(name if len(bits) == 1 else f"{name}[{index}]", bit) for index, bit in enumerate(bits)]


def _is_made(name: str) -> bool:
    """Return whether yosys composed a name from the names of cells."""
    return bool(re.search(r"_(TRELLIS|LUT4|CCU2C|PFUMX|L6MUX|MULT18|DP16KD|DPR16|WAD|RAD|DI|DO)", name)) or "$" in name


def _rank(name: str) -> tuple[bool, bool, int]:
    """Return the sort key of a bit's names: names of the sources first, then short names first."""
    return _is_made(name), "." in name and "_q" not in name, len(name)


def _source(attributes: Mapping[str, str]) -> str:
    """Return the first place in the RTL that a cell names."""
    places = attributes.get("src", "").split("|")
    first = next((place for place in places if not place.startswith("/share/")), "")
    return re.sub(r"^(.*?:\d+).*", r"\1", first.rpartition("/")[2])


def _evaluated(cell: Cell, output: str, values: Mapping[str, int]) -> int:
    """Return the value of an output of a logic cell."""
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
    """Return the clock of one stage of a multiplier's registers, or None."""
    name = cell.choice(f"REG_{rank}_CLK")
    return None if name in ("", "NONE") else cell.bit(name)


def _clocks_of_inputs(cell: Cell) -> dict[str, Bit]:
    """Return a cell's inputs that are sampled by clocks, with these clocks."""
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
        # Words of 36 bits are written through both halves by the clock of port A.
        by_a = {port for port, side in sides.items() if side == "A" or (port[:3] == "DIB" and _is_wide(cell))}
        return {port: cell.bit("CLKA" if port in by_a else "CLKB") for port in sides}
    if cell.kind == "MULT18X18D":
        # An operand's first register is at the input, in the middle, or at the product.
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
    """Return the clock at which an output changes; None for a multiplier without registers."""
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

"""Lists and checks the clock crossings of a netlist: `python -m tools.crossings NETLIST.json`.

The netlist is yosys' flattened JSON after `synth_ecp5`. From every input that a clock samples, the check follows the
logic back to the registers, memories and pins that drive the input. Two clocks are one domain only if they are one net.
A valid crossing is of one of the kinds below. The check recognises a kind by its structure, and by the names of the
registers in lipp_bit_sync and lipp_reset_sync:

| kind | rule |
|---|---|
| bit | A register, or a pin, drives the first register of a lipp_bit_sync with no logic between them, so no glitch is sampled. The chain's registers share one clock and read only each other; only the second register reads the first. |
| pulse | lipp_pulse_sync's level and its acknowledgement each cross as a bit. |
| Gray | The bits of a pointer of lipp_async_fifo are registers of one clock and one enable. The logic before these registers changes exactly one bit at each step, over the complete period. Each bit passes its own lipp_bit_sync. |
| memory | The content of lipp_async_fifo's memory is sampled under an enable that depends on all bits of the write pointer, synchronised to the reader's clock, and is written under an enable that depends on the synchronised read pointer. |
| held | Each of lipp_tmds_serialiser's symbols is sampled by a register behind one lookup table, which a select register of the sampling clock controls. The select register is high only in a cycle that is counted from a synchronised bit (`i_turn`), which changes with the symbols. The symbols are stable in this cycle, because the clocks' ratio is five to one. |
| reset | An asynchronous reset is driven by a register of the same clock as the registers that it resets. Only the registers of lipp_reset_sync, whose first register reads a constant, can have another reset. |

The check refuses bits of one register that cross through several lipp_bit_syncs, and separately crossing bits of one
clock that meet in the logic before a register, because these bits may arrive in different clock cycles. The check also
refuses pins that a register samples directly, unless `--timed` names them (such as a memory chip's data pins).
"""  # noqa: E501

from __future__ import annotations

import fnmatch
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import click
from lippmann.cli.frame import argument, option
from lippmann.cli.output import log
from lippmann.errors import LippmannError

from tools.gates import Bit, Netlist, Pin, Register, Sampled, read_netlist
from tools.program import program

#: Maximum bits of a FIFO's pointer, because the check tries its complete period.
MAX_POINTER_BITS = 14
#: End of the messages about bits that cross separately.
_SIDE_BY_SIDE = "they may arrive in different clocks; use a lipp_async_fifo"


class CrossingError(LippmannError):
    """A clock crossing uses none of the project's synchronisers."""

    exit_code = 4


class Crossing(NamedTuple):
    """A group of crossing bits: names of both clocks, kind of the crossing, instance in the RTL, number of bits."""

    source: str
    target: str
    kind: str
    place: str
    bits: int


@dataclass
class Row:
    """The register chain of a lipp_bit_sync or a lipp_reset_sync: cells and outputs, from the first to the last."""

    place: str
    cells: list[str]
    outputs: list[Bit]
    clock: Bit
    is_reset: bool

    @property
    def last(self) -> Bit:
        """The output of the chain's last register."""
        return self.outputs[-1]


class Check:
    """The check of a netlist: lists valid `crossings`, and a line for each `wrong` one; accepts the pins in `timed`."""

    def __init__(self, netlist: Netlist, timed: Sequence[str] = ()) -> None:
        self.net, self.timed = netlist, timed
        self.crossings: list[Crossing] = []
        self.wrong: list[str] = []
        #: Registers that sample a pin directly, keyed by the names of pin and clock.
        self.pins: dict[tuple[str, str], list[str]] = {}
        rows = [self._row(name, bits) for name, bits in sorted(netlist.synchronisers.items())]
        self.firsts = {row.cells[0]: row for row in rows if row is not None and not row.is_reset}
        self.of_reset = {cell for row in rows if row is not None and row.is_reset for cell in row.cells}
        #: The register chains of each pointer, keyed by FIFO and direction, then by bit.
        self.pointers: dict[tuple[str, str], dict[int, Row]] = {}
        for row in self.firsts.values():
            pointer = _pointer(row)
            if pointer is not None:
                self.pointers.setdefault(pointer[:2], {})[pointer[2]] = row

    def run(self) -> Check:
        """Check all crossings, and return this object."""
        groups: Counter[tuple[str, str, str, str]] = Counter()
        for one in self.net.sampled():
            others = self.net.clocks.get(one.bit, frozenset()) - {one.clock}
            if not isinstance(one.clock, str) and others:
                groups.update(self._crossing(one))
        for (pin, target), cells in sorted(self.pins.items()):
            more = f" and {len(cells) - 1} more" if len(cells) > 1 else ""
            where = self.net.described(cells[0])
            self._is_wrong(f"the pin {pin} is sampled by {where}{more} ({target}) without a synchroniser")
        for name, writer, reader in self.net.block_memories():
            clocks = self.net.name(writer), self.net.name(reader)
            if self._is_read_of_fifo(name, reader, self.net.cells[name].bit("CEB")):
                groups[*clocks, "memory", _place(name)] = 1
            else:
                what = f"the memory {name} is written by {clocks[0]} and read by {clocks[1]}"
                self._is_wrong(f"{what}; use a lipp_async_fifo")
        for row in self.firsts.values():
            self._check_row(row)
        for (fifo, side), rows in sorted(self.pointers.items()):
            self._check_pointer(fifo, side, rows)
        self._check_arrays()
        self._check_meetings()
        groups.update(self._resets())
        self._check_clocks()
        self.crossings = [Crossing(*key, bits) for key, bits in sorted(groups.items())]
        self.wrong = list(dict.fromkeys(self.wrong))
        return self

    def report(self) -> None:
        """Print all crossings; raise CrossingError if one is wrong."""
        for one in self.crossings:
            click.echo(f"{one.source} -> {one.target}: {one.kind}, {one.bits} at {one.place}")
        for line in self.wrong[1:20]:
            log(line)
        if self.wrong:
            more = f" (and {len(self.wrong) - 1} more)" if len(self.wrong) > 1 else ""
            raise CrossingError(f"{self.wrong[0]}{more}")

    def _is_wrong(self, line: str) -> None:
        self.wrong.append(line)

    def _row(self, name: str, bits: Sequence[Bit]) -> Row | None:
        """Return a synchroniser's chain of registers; for an invalid chain, add a line to `wrong` and return None."""
        place = name.rpartition(".")[0]
        registers = [*filter(None, map(self.net.register, bits))]
        if len(registers) != len(bits) or len(bits) < 2:
            self._is_wrong(f"{name}: {len(registers)} of {len(bits)} bits are registers; all must be, and at least two")
            return None
        clocks = {register.clock for register in registers}
        if len(clocks) != 1:
            self._is_wrong(f"{name}: its registers have {len(clocks)} clocks; use one clock")
            return None
        is_reset = isinstance(registers[0].data, str) and registers[0].cell.choice("SRMODE") == "ASYNC"
        if any(register.data != before for register, before in zip(registers[1:], bits, strict=False)):
            self._is_wrong(f"{name}: logic between its registers; connect each to the one before")
        if any(register.cell.choice("CEMUX") not in ("1", "") for register in registers):
            self._is_wrong(f"{name}: its registers have an enable; remove the enable")
        return Row(place, [register.name for register in registers], list(bits), clocks.pop(), is_reset)

    def _check_row(self, row: Row) -> None:
        """Check that a chain samples no glitch, and that only its last register has readers outside the chain."""
        for k, bit in enumerate(row.outputs[:-1]):
            others = [pin for pin in self.net.readers.get(bit, []) if pin != Pin(row.cells[k + 1], "DI")]
            if others or bit in self.net.outputs:
                where = others[0].cell if others else "a port"
                self._is_wrong(f"{row.place}: its register {k} is read by {where}; only the next register may read it")
        source = self.net.straight(self.net.cells[row.cells[0]].bit("DI"))
        if self.net.register(source) is None and self.net.before(source)[0]:
            where = f"logic before its first register, at {self.net.name(source)}"
            self._is_wrong(f"{row.place}: {where}: a glitch may be sampled")

    def _check_arrays(self) -> None:
        """Refuse arrays of bit synchronisers, whose bits may arrive in different clock cycles."""
        arrays: dict[str, list[Row]] = {}
        for row in self.firsts.values():
            if self._source(row) is not None and (_pointer(row) or ("", "", 0))[:2] not in self.pointers:
                arrays.setdefault(re.sub(r"\[\d+\]", "[]", row.place), []).append(row)
        for place, rows in arrays.items():
            if len(rows) > 1:
                self._is_wrong(f"{place}: {len(rows)} bits side by side through bit synchronisers: {_SIDE_BY_SIDE}")

    def _check_meetings(self) -> None:
        """Refuse bits of one clock that cross separately, then meet in the logic before a register."""
        lone = {
            row.cells[-1]: (row, source.clock)
            for row in self.firsts.values()
            if _pointer(row) is None and (source := self._source(row)) is not None
        }
        if len(lone) < 2:
            return
        reached = self.net.collect(lambda source: source.cell if source.cell in lone else None)
        for pin, bit, _ in self.net.sampled():
            met = reached.get(bit, frozenset())
            for (one, clock), (other, clock_of_other) in combinations([lone[cell] for cell in lone if cell in met], 2):
                if clock == clock_of_other and one.clock == other.clock:
                    both = f"{one.place} and {other.place}"
                    self._is_wrong(f"{both} bring bits of one clock that meet before {pin.cell}: {_SIDE_BY_SIDE}")

    def _source(self, row: Row) -> Register | None:
        return self.net.register(self.net.straight(self.net.cells[row.cells[0]].bit("DI")))

    def _crossing(self, one: Sampled) -> Iterator[tuple[str, str, str, str]]:
        """Yield the crossings that end at an input: names of both clocks, kind, instance in the RTL."""
        target, cell = self.net.name(one.clock), one.pin.cell
        row = self.firsts.get(cell) if one.pin.port == "DI" else None
        for source in self.net.sources([one.bit]):
            if source.clock == one.clock:
                continue
            name = "pin" if source.clock is None else self.net.name(source.clock)
            if row is not None:
                pointer = _pointer(row)
                kind = "pulse" if self._is_pulse(row) else "bit"
                if pointer is not None and pointer[:2] in self.pointers:
                    kind = "Gray"
                place = re.sub(r"\.i_(there|back)$", "", row.place) if pointer is None else " ".join(pointer[:2])
                yield name, target, kind, place
            elif source.clock is None:
                if any(fnmatch.fnmatchcase(source.name, pattern) for pattern in self.timed):
                    yield name, target, "timed", re.sub(r"\[\d+\]$", "", source.name)
                else:
                    self.pins.setdefault((source.name, target), []).append(cell)
            elif source.memory and self._samples_fifo(one, source.name):
                yield name, target, "memory", _place(source.name)
            elif (serialiser := self._serialiser(one, source.name)) is not None:
                yield name, target, "held", serialiser
            else:
                where = f"{one.pin.port} of {self.net.described(cell)} ({target})"
                self._is_wrong(f"{source.name} ({name}) reaches {where} without a synchroniser")

    def _is_pulse(self, row: Row) -> bool:
        """Return whether a chain synchronises a lipp_pulse_sync's level or acknowledgement."""
        place, _, name = row.place.rpartition(".")
        rows = {other.place: other for other in self.firsts.values()}
        there, back = rows.get(f"{place}.i_there"), rows.get(f"{place}.i_back")
        if name not in ("i_there", "i_back") or there is None or back is None:
            return False
        level, answer = self._source(there), self._source(back)
        if level is None or answer is None:
            return False
        before = self.net.sources([level.data, level.cell.bit("CE")])
        return answer.data == there.last and any(source.name == self.net.name(back.last) for source in before)

    def _check_pointer(self, fifo: str, side: str, rows: dict[int, Row]) -> None:
        """Check that a FIFO's pointer crosses in Gray code."""
        where = f"{fifo}: the {side} pointer"
        registers = [*filter(None, (self._source(rows[k]) for k in sorted(rows)))]
        if len(registers) <= max(rows) or len(registers) < 3:
            self._is_wrong(f"{where} crosses with {len(registers)} of {max(rows) + 1} bits from registers")
            return
        controls = {register.control for register in registers}
        if len(controls) != 1 or len({row.clock for row in rows.values()}) != 1:
            self._is_wrong(f"{where} has registers with more than one clock or enable")
            return
        wrong = self._gray([register.cell.bit("Q") for register in registers], controls.pop())
        if wrong:
            self._is_wrong(f"{where} {wrong}")

    def _gray(self, outputs: list[Bit], control: tuple[Bit, str, Bit]) -> str:
        """Step registers through their complete period; return why they are not a Gray counter, or ""."""
        if len(outputs) > MAX_POINTER_BITS:
            return f"has more than {MAX_POINTER_BITS} bits"
        # Collect the registers on which the next state depends; all must have one clock and enable.
        state: dict[Bit, Register] = {}
        todo = list(outputs)
        while todo:
            bit = todo.pop()
            register = self.net.register(bit)
            if register is None or register.control != control:
                return f"depends on {self.net.name(bit)}, which has another clock or enable"
            if bit not in state:
                state[bit] = register
                todo += self.net.ends([register.data])
        values: dict[Bit, int] = {bit: int(one.cell.choice("REGSET") == "SET") for bit, one in state.items()}
        words = set()
        for step in range(1 << len(outputs)):
            word = tuple(values[bit] for bit in outputs)
            if word in words:
                return f"repeats a value after {step} steps"
            words.add(word)
            evaluated = dict(values)
            try:
                values = {bit: self.net.value(register.data, evaluated) for bit, register in state.items()}
            except KeyError as error:
                return f"depends on {error.args[0]}"
            changed = sum(values[bit] != old for bit, old in zip(outputs, word, strict=True))
            if changed != 1:
                return f"changes {changed} bits in one step"
        return ""

    def _samples_fifo(self, one: Sampled, memory: str) -> bool:
        """Return whether a register samples a FIFO's memory under a valid enable."""
        cell = self.net.cells[one.pin.cell]
        enabled = one.pin.port == "DI" and cell.choice("CEMUX") in ("CE", "INV")
        return enabled and self._is_read_of_fifo(memory, one.clock, cell.bit("CE"))

    def _is_read_of_fifo(self, memory: str, clock: Bit, enable: Bit) -> bool:
        """Return whether a FIFO's pointers control its memory's read enable (of `clock`) and its write enable."""
        fifo = _place(memory)
        written, read = self.pointers.get((fifo, "written"), {}), self.pointers.get((fifo, "read"), {})
        if not written or not read or any(row.clock != clock for row in written.values()):
            return False
        # The write enable depends on the read pointer, directly or through a register.
        cell = self.net.cells[memory]
        wide = cell.kind == "DP16KD" and cell.bit("WEA") == "1"
        inner = self.net.ends([cell.bit("WRE" if cell.kind != "DP16KD" else "ADA0" if wide else "WEA")])
        writer = [register.data for bit in inner if (register := self.net.register(bit)) is not None]
        return self._depends([enable], written.values()) and self._depends([*inner, *writer], read.values())

    def _depends(self, bits: Iterable[Bit], rows: Iterable[Row]) -> bool:
        return {row.last for row in rows} <= self.net.ends(bits).keys()

    def _serialiser(self, one: Sampled, source: str) -> str | None:
        """Return the serialiser whose symbols an input samples, or None."""
        pin = self.net.driver.get(one.bit)
        if one.pin.port != "DI" or pin is None or self.net.cells[pin.cell].kind != "LUT4":
            return None
        table = self.net.cells[pin.cell]
        ports = {port: table.bit(port) for port in "ABCD"}
        symbol = [port for port, bit in ports.items() if self.net.name(bit) == source]
        for port, bit in ports.items():
            register = self.net.register(bit)
            if port in symbol or register is None or register.clock != one.clock:
                continue
            if any(not _depends_on(table.number("INIT"), symbol, port, choice) for choice in (0, 1)):
                place = self._counted_from(bit, one.clock)
                if place is not None:
                    return place
        return None

    def _counted_from(self, bit: Bit, clock: Bit) -> str | None:
        """Return the serialiser on whose `i_turn` a select register depends through registers of a clock, or None."""
        turns = {row.last: row.place for row in self.firsts.values() if row.place.endswith("i_turn")}
        todo, visited = [bit], {bit}
        while todo:
            one = todo.pop()
            if one in turns:
                return turns[one].removesuffix("i_turn").rstrip(".")
            register = self.net.register(one)
            if register is not None and register.clock == clock:
                new = self.net.ends([register.data]).keys() - visited
                visited |= new
                todo += new
        return None

    def _resets(self) -> Iterator[tuple[str, str, str, str]]:
        """Check the asynchronous resets; yield clocks, kind and reset net for each register that is reset."""
        for one in self.net.asynchronous_resets():
            bit = self.net.straight(one.bit)
            if isinstance(bit, str):
                continue
            target = self.net.name(one.clock)
            register = self.net.register(bit)
            clock = None if register is None else register.clock
            if clock != one.clock and one.pin.cell not in self.of_reset:
                what = "logic" if self.net.before(bit)[0] else "another clock" if register is not None else "a pin"
                where = f"{self.net.described(one.pin.cell)} ({target})"
                name = self.net.name(bit)
                self._is_wrong(f"{where} is reset by {name}, {what}; use a lipp_reset_sync's reset")
            yield "pin" if clock is None else self.net.name(clock), target, "reset", self.net.name(bit)

    def _check_clocks(self) -> None:
        """Refuse clocks that are outputs of logic."""
        for one in self.net.sampled():
            if isinstance(one.clock, int) and self.net.before(one.clock)[0]:
                self._is_wrong(f"clock {self.net.name(one.clock)} of {one.pin.cell} is made by logic; use an enable")


def _pointer(row: Row) -> tuple[str, str, int] | None:
    """Return a pointer's FIFO, direction and bit if the chain has a FIFO pointer's name, else None."""
    name = re.fullmatch(r"(?:(.*)\.)?gen_bit\[(\d+)\]\.i_(written|read)", row.place)
    return (name[1] or "", name[3], int(name[2])) if name else None


def _place(memory: str) -> str:
    return re.sub(r"\.words\..*", "", memory)


def _depends_on(table: int, ports: Sequence[str], choice: str, value: int) -> bool:
    """Return whether a four-input table depends on `ports` while the port `choice` has the value `value`."""
    places = {port: 1 << k for k, port in enumerate("ABCD")}
    mask = sum(places[port] for port in ports)
    outputs: dict[int, set[int]] = {}
    for at in range(16):
        if bool(at & places[choice]) == bool(value):
            outputs.setdefault(at & ~mask, set()).add(table >> at & 1)
    return any(len(some) > 1 for some in outputs.values())


def check(netlist: Netlist, timed: Sequence[str] = ()) -> Check:
    """Check all crossings of a netlist."""
    return Check(netlist, timed).run()


@program
def main(
    netlist: Path = argument(),
    top: str | None = option("Module to check.  [default: the netlist's top]", None),
    timed: tuple[str, ...] = option(
        "Pins that registers may sample directly, such as 'sdram_d*'.", (), str, multiple=True, metavar="PATTERN"
    ),
) -> None:
    """List a netlist's clock crossings; exit with code 4 if a crossing uses no synchroniser of the project.

    Example: python -m tools.crossings build/netlist.json --timed 'sdram_d*'
    """
    check(read_netlist(netlist, top), timed).report()

"""Writes a netlist of ECP5's cells as Verilog that simulates fast: each cell's behaviour in the place of the cell.

A table becomes the shortest expression that is found for its INIT, a flip-flop one assignment. Block memories and
multipliers stay instances of their models (sim/netlist/ecp5_blocks.sv). The behaviours are those of the models that
yosys ships; tests/rtl/test_netlist.py compares them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence, Set
from functools import cache
from typing import Any

from lippmann.dev.gates import Bit, Cell, Netlist
from lippmann.errors import LippmannError

#: Cells that stay instances.
BLOCKS = ("MULT18X18D", "DP16KD")


def verilog(netlist: Netlist, name: str, ports: Mapping[str, Any]) -> str:
    """Return a netlist as a Verilog module of this name; `ports` are those of the netlist's top, as yosys writes them.

    Raises LippmannError for a use of a cell that is not simulated here.
    """
    return "\n".join(_lines(netlist, name, ports))


def _lines(netlist: Netlist, name: str, ports: Mapping[str, Any]) -> Iterator[str]:
    yield f"module {name} ("
    yield ",\n".join(f"  {port['direction']} wire {_range(port['bits'])}{key}" for key, port in ports.items())
    yield ");"
    registers = {cell.bit("Q") for cell in netlist.cells.values() if cell.kind == "TRELLIS_FF"}
    driven = {bit for bit in netlist.driver if isinstance(bit, int)}
    bits = sorted({*driven, *(bit for bit in netlist.readers if isinstance(bit, int)), *netlist.inputs})
    yield from (f"  {'reg' if bit in registers else 'wire'} {_net(bit)};" for bit in bits)
    for key, port in ports.items():
        for index, bit in enumerate(port["bits"]):
            pin = key if len(port["bits"]) == 1 else f"{key}[{index}]"
            yield f"  assign {_net(bit)} = {pin};" if port["direction"] == "input" else f"  assign {pin} = {_net(bit)};"
    used = {*netlist.readers, *netlist.outputs}
    memories: dict[tuple[str, ...], list[Cell]] = {}
    for key, cell in netlist.cells.items():
        if cell.kind == "LUT4":
            table = cell.number("INIT")
            yield f"  assign {_net(cell.bit('Z'))} = {_table(table, [cell.bit(port) for port in 'ABCD'])};"
        elif cell.kind == "PFUMX":
            yield f"  assign {_net(cell.bit('Z'))} = {_choice(cell, 'C0', 'ALUT', 'BLUT')};"
        elif cell.kind == "L6MUX21":
            yield f"  assign {_net(cell.bit('Z'))} = {_choice(cell, 'SD', 'D1', 'D0')};"
        elif cell.kind == "CCU2C":
            yield from _carry(cell, used)
        elif cell.kind == "TRELLIS_FF":
            yield _register(cell)
        elif cell.kind == "TRELLIS_DPR16X4":
            if (
                cell.choice("WCKMUX") != "WCK"
                or cell.choice("WREMUX") != "WRE"
                or "1" in cell.parameters.get("INITVAL", "")
            ):
                raise LippmannError(f"{key}: this use of a memory of LUTs is not simulated")
            address = (*map(_net, cell.connections["WAD"]), *map(_net, cell.connections["RAD"]))
            memories.setdefault((_net(cell.bit("WCK")), _net(cell.bit("WRE")), *address), []).append(cell)
        elif cell.kind in BLOCKS:
            yield from _block(cell, key)
        else:
            raise LippmannError(f"{key}: a {cell.kind} is not simulated")
    for number, (nets, cells) in enumerate(memories.items()):
        yield from _memory(f"m{number}", nets, cells)
    yield "endmodule"


def _net(bit: Bit) -> str:
    return f"n{bit}" if isinstance(bit, int) else f"1'b{bit}"


def _range(bits: Sequence[Bit]) -> str:
    return f"[{len(bits) - 1}:0] " if len(bits) > 1 else ""


def _choice(cell: Cell, chooses: str, one: str, zero: str) -> str:
    return f"{_net(cell.bit(chooses))} ? {_net(cell.bit(one))} : {_net(cell.bit(zero))}"


# ---- tables ----


def _table(table: int, inputs: Sequence[Bit]) -> str:
    """Return the expression of a table of four inputs, some of them constants or equal."""
    values = [table >> at & 1 for at in range(16)]
    free = sorted({bit for bit in inputs if isinstance(bit, int)})
    small = 0
    for at in range(1 << len(free)):
        known: dict[Bit, int] = {bit: at >> k & 1 for k, bit in enumerate(free)}
        address = sum(known.get(bit, int(bit == "1")) << k for k, bit in enumerate(inputs))
        small |= values[address] << at
    text = _shortest(small, len(free))[1]
    return re.sub(r"v(\d)", lambda found: _net(free[int(found[1])]), text)


@cache
def _shortest(table: int, inputs: int) -> tuple[int, str]:
    """Return the number of operators, and an expression of v0, v1, ..., for a table of up to four inputs."""
    full = (1 << (1 << inputs)) - 1
    if table in (0, full):
        return 0, "1'b1" if table else "1'b0"
    best: tuple[int, str] | None = None
    for k in range(inputs):
        zero, one = _cofactor(table, inputs, k, 0), _cofactor(table, inputs, k, 1)
        found = _joined(f"v{k}", zero, one, inputs, k)
        if best is None or found[0] < best[0]:
            best = found
    assert best is not None
    return best


def _joined(name: str, zero: int, one: int, inputs: int, k: int) -> tuple[int, str]:
    """Return the expression for input k, from the tables where it is 0 and 1."""
    full = (1 << (1 << (inputs - 1))) - 1

    def inner(table: int) -> tuple[int, str]:
        cost, text = _shortest(table, inputs - 1)
        return cost, re.sub(r"v(\d)", lambda found: f"v{int(found[1]) + (int(found[1]) >= k)}", text)

    if zero == one:
        return inner(zero)
    if zero == full ^ one:  # the input only inverts
        if zero == 0:
            return 0, name
        cost, text = inner(zero)
        return (1, f"~{name}") if zero == full else (cost + 1, f"({name} ^ {text})")
    if zero == 0:
        cost, text = inner(one)
        return cost + 1, f"({name} & {text})"
    if zero == full:
        cost, text = inner(one)
        return cost + 2, f"(~{name} | {text})"
    if one == 0:
        cost, text = inner(zero)
        return cost + 2, f"(~{name} & {text})"
    if one == full:
        cost, text = inner(zero)
        return cost + 1, f"({name} | {text})"
    (cost_one, text_one), (cost_zero, text_zero) = inner(one), inner(zero)
    return cost_one + cost_zero + 3, f"({name} ? {text_one} : {text_zero})"


def _cofactor(table: int, inputs: int, k: int, value: int) -> int:
    """Return the table without input k, which has this value."""
    found = 0
    for at in range(1 << (inputs - 1)):
        low = at & ((1 << k) - 1)
        address = (at - low) * 2 + (value << k) + low
        found |= (table >> address & 1) << at
    return found


# ---- cells ----


def _carry(cell: Cell, used: Set[Bit]) -> Iterator[str]:
    """Yield two bits of a carry chain: a table of 1 passes the carry, else that of A and B alone is the carry."""
    carry = _net(cell.bit("CIN"))
    ends = cell.bit("COUT")
    base = f"c{cell.bit('S0')}_{cell.bit('S1')}_{ends}"
    for half in ("0", "1"):
        table = cell.number(f"INIT{half}")
        inputs: list[Bit] = [cell.bit(f"{letter}{half}") for letter in "ABCD"]
        adds, generates = _table(table, inputs), _table(table, [*inputs[:2], "0", "0"])
        if cell.choice(f"INJECT1_{half}") == "YES":
            carry_in, generates = "1'b0", "1'b0"
        else:
            carry_in = carry
        out = cell.bit(f"S{half}")
        goes_on = half == "0" or ends in used
        if out not in used and not goes_on:
            return
        yield f"  wire {base}_{half} = {adds};"
        if out in used:
            yield f"  assign {_net(out)} = {base}_{half} ^ {carry_in};"
        following = f"{base}_{half} ? {carry} : {generates}"
        if half == "0":
            yield f"  wire {base}_m = {following};"
            carry = f"{base}_m"
        elif goes_on:
            yield f"  assign {_net(ends)} = {following};"


def _register(cell: Cell) -> str:
    """Return a flip-flop: set or reset at once or with the clock, both before the enable."""
    if cell.choice("GSR") not in ("DISABLED", "AUTO") or cell.choice("LSRMODE") not in ("", "LSR"):
        raise LippmannError("a flip-flop with the global reset or a preload is not simulated")
    q, d, reset, enable = (_net(cell.bit(port)) for port in ("Q", "DI", "LSR", "CE"))
    edge = "negedge" if cell.choice("CLKMUX") == "INV" else "posedge"
    inverted = cell.choice("LSRMUX") == "INV"
    when = f"{edge} {_net(cell.bit('CLK'))}"
    take = f"{q} <= {d};"
    how = cell.choice("CEMUX") or "1"
    if how == "0":
        take = f"{q} <= {q};"
    elif how != "1":
        take = f"if ({'~' if how == 'INV' else ''}{enable}) {take}"
    if reset != ("1'b1" if inverted else "1'b0"):
        value = int(cell.choice("REGSET") == "SET")
        take = f"if ({'~' if inverted else ''}{reset}) {q} <= 1'b{value}; else {take}"
        if cell.choice("SRMODE") == "ASYNC":
            when += f" or {'negedge' if inverted else 'posedge'} {reset}"
    return f"  always @({when}) {take}"


def _memory(name: str, key: tuple[str, ...], cells: Sequence[Cell]) -> Iterator[str]:
    """Yield memories of LUTs with the same addresses as one: written with the clock, read at once."""
    clock, enable, *address = key
    width = 4 * len(cells)
    data = ", ".join(_net(bit) for cell in reversed(cells) for bit in reversed(cell.connections["DI"]))
    write, read = ("{" + ", ".join(reversed(some)) + "}" for some in (address[:4], address[4:]))
    yield f"  reg [{width - 1}:0] {name}[0:15];"
    yield f"  always @(posedge {clock}) if ({enable}) {name}[{write}] <= {{{data}}};"
    yield f"  wire [{width - 1}:0] {name}_q = {name}[{read}];"
    for k, cell in enumerate(cells):
        for index, bit in enumerate(cell.connections["DO"]):
            yield f"  assign {_net(bit)} = {name}_q[{4 * k + index}];"


def _block(cell: Cell, name: str) -> Iterator[str]:
    """Yield an instance of a block's model."""
    kept = {}
    for key, value in cell.parameters.items():
        if not key.startswith("INITVAL"):
            kept[key] = str(int(value, 2)) if re.fullmatch("[01]{32}", value) else f'"{value.strip()}"'
        elif "1" in value:
            raise LippmannError(f"{name}: a block memory that begins with other words than 0 is not simulated")
    parameters = ", ".join(f".{key}({value})" for key, value in kept.items())
    ports = ", ".join(f".{port}({_net(bits[0])})" for port, bits in cell.connections.items())
    yield f"  {cell.kind} #({parameters}) b{cell.bit('DOB0') if cell.kind == 'DP16KD' else cell.bit('P0')} ({ports});"

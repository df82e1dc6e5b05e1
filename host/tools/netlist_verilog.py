"""Writes a netlist of ECP5's cells as Verilog that simulates fast: each cell's behaviour in the place of the cell.

A table becomes the shortest expression that is found for its INIT, a flip-flop one assignment. Block memories and
multipliers stay instances of their models (sim/netlist/ecp5_blocks.sv). The behaviours are those of the models that
yosys ships; tests/rtl/test_netlist.py compares them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from functools import cache
from typing import Any

from lippmann.errors import LippmannError

from tools.gates import Bit, Cell, Netlist

Writer = Callable[[Cell, str], Iterator[str]]
#: Cells that become ports of the module.
PORTS = ("BB", "TRELLIS_IO", "EHXPLLL")


def verilog(netlist: Netlist, name: str, ports: Mapping[str, Any]) -> str:
    """Return a netlist as a Verilog module of this name; `ports` are those of the netlist's top, as yosys writes them.

    The outputs of a PLL become ports that the simulation drives, `pll_clkop` to `pll_clkos3` and `pll_lock`. A port of
    both directions `p` becomes an input, and two outputs: `p_o`, and `p_t` of what is released. Raises LippmannError
    for a use of a cell that is not simulated here.
    """
    return "\n".join(_lines(netlist, name, ports))


def _lines(netlist: Netlist, name: str, ports: Mapping[str, Any]) -> Iterator[str]:
    declared, connected = _ports(netlist, ports)
    yield f"module {name} ("
    yield ",\n".join(f"  {direction} wire {_range(bits)}{key}" for key, (direction, bits) in declared.items())
    yield ");"
    registers = (cell for cell in netlist.cells.values() if cell.kind == "TRELLIS_FF")
    begins = {cell.bit("Q"): int(cell.choice("REGSET") == "SET") for cell in registers}
    read = (bit for bit in netlist.readers if isinstance(bit, int))
    for bit in sorted({*netlist.driver, *read, *netlist.inputs}, key=int):
        yield f"  reg {_net(bit)} = 1'b{begins[bit]};" if bit in begins else f"  wire {_net(bit)};"
    yield from (f"  assign {left} = {right};" for left, right in connected)
    used = {*netlist.readers, *netlist.outputs}
    memories: dict[tuple[str, ...], list[Cell]] = {}
    for key, cell in netlist.cells.items():
        if cell.kind == "CCU2C":
            yield from _carry(cell, used)
        elif cell.kind == "TRELLIS_DPR16X4":
            memories.setdefault(_shared(cell, key), []).append(cell)
        elif cell.kind in WRITTEN:
            yield from WRITTEN[cell.kind](cell, key)
        elif cell.kind not in PORTS:
            raise LippmannError(f"{key}: a {cell.kind} is not simulated")
    for number, (nets, cells) in enumerate(memories.items()):
        yield from _memory(f"m{number}", nets, cells)
    yield "endmodule"


def _ports(
    netlist: Netlist, ports: Mapping[str, Any]
) -> tuple[dict[str, tuple[str, list[Bit]]], list[tuple[str, str]]]:
    """Return the module's ports with directions, and what is assigned to and from them."""
    declared: dict[str, tuple[str, list[Bit]]] = {}
    assigned: list[tuple[str, str]] = []
    pads = {cell.bit("B"): cell for cell in netlist.cells.values() if cell.kind in ("BB", "TRELLIS_IO")}
    if any(cell.choice("DIR") not in ("", "BIDIR") for cell in pads.values()):
        raise LippmannError("a pad of one direction is not simulated as a cell")
    for key, port in ports.items():
        bits = port["bits"]
        places = [key if len(bits) == 1 else f"{key}[{index}]" for index in range(len(bits))]
        if port["direction"] == "inout":
            declared |= {key: ("input", bits), f"{key}_o": ("output", bits), f"{key}_t": ("output", bits)}
            for place, bit in zip(places, bits, strict=True):
                assigned.append((_net(pads[bit].bit("O")), place))
                for end, pin in (("o", "I"), ("t", "T")):
                    assigned.append((place.replace(key, f"{key}_{end}", 1), _net(pads[bit].bit(pin))))
        else:
            declared[key] = port["direction"], bits
            pairs = [(_net(bit), place) for place, bit in zip(places, bits, strict=True)]
            assigned += pairs if port["direction"] == "input" else [(place, net) for net, place in pairs]
    plls = [cell for cell in netlist.cells.values() if cell.kind == "EHXPLLL"]
    for port in ("CLKOP", "CLKOS", "CLKOS2", "CLKOS3", "LOCK") if plls else ():
        if port in plls[0].connections:
            declared[f"pll_{port.lower()}"] = "input", [0]
            assigned.append((_net(plls[0].bit(port)), f"pll_{port.lower()}"))
    if len(plls) > 1:
        raise LippmannError("the netlist has more than one PLL; only one is simulated")
    return declared, assigned


def _net(bit: Bit) -> str:
    return f"n{bit}" if isinstance(bit, int) else f"1'b{bit}"


def _range(bits: Sequence[Bit]) -> str:
    return f"[{len(bits) - 1}:0] " if len(bits) > 1 else ""


def _lut(cell: Cell, _: str) -> Iterator[str]:
    inputs = [cell.bit(port) for port in "ABCD"]
    yield f"  assign {_net(cell.bit('Z'))} = {expression(cell.number('INIT'), inputs)};"


def _chooser(chooses: str, one: str, zero: str) -> Writer:
    """Return what writes a cell that takes one of two inputs."""

    def write(cell: Cell, _: str) -> Iterator[str]:
        z, s, a, b = (_net(cell.bit(port)) for port in ("Z", chooses, one, zero))
        yield f"  assign {z} = {s} ? {a} : {b};"

    return write


# ---- tables ----


def expression(table: int, inputs: Sequence[Bit]) -> str:
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

    cases: list[tuple[bool, int, int, str]] = [  # whether, the inner table, the operators more, the form
        (zero == one, zero, 0, "{0}"),
        (zero == 0 and one == full, full, 0, name),
        (zero == full and one == 0, full, 1, f"~{name}"),
        (zero == full ^ one, zero, 1, f"({name} ^ {{0}})"),
        (zero == 0, one, 1, f"({name} & {{0}})"),
        (one == full, zero, 1, f"({name} | {{0}})"),
        (zero == full, one, 2, f"(~{name} | {{0}})"),
        (one == 0, zero, 2, f"(~{name} & {{0}})"),
    ]
    for holds, table, more, form in cases:
        if holds:
            cost, text = inner(table)
            return cost + more, form.format(text)
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
        adds, generates = expression(table, inputs), expression(table, [*inputs[:2], "0", "0"])
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


def _register(cell: Cell, name: str) -> Iterator[str]:
    """Yield a flip-flop: set or reset at once or with the clock, both before the enable."""
    # The global reset comes at power-up alone: a cell that drives it would not be known.
    if cell.choice("LSRMODE") not in ("", "LSR"):
        raise LippmannError(f"{name}: a flip-flop with a preload is not simulated")
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
    yield f"  always @({when}) {take}"


def _output(cell: Cell, name: str) -> Iterator[str]:
    """Yield a cell that sends two bits a clock, D0 while it is high."""
    q, clock, first, second = (_net(cell.bit(port)) for port in ("Q", "SCLK", "D0", "D1"))
    if cell.bit("RST") != "0":
        raise LippmannError(f"{name}: an {cell.kind} with a reset is not simulated")
    yield f"  reg {q}_0 = 1'b0, {q}_1 = 1'b0;"
    yield f"  always @(posedge {clock}) {{{q}_0, {q}_1}} <= {{{first}, {second}}};"
    yield f"  assign {q} = {clock} ? {q}_0 : {q}_1;"


def _shared(cell: Cell, name: str) -> tuple[str, ...]:
    """Return the nets of clock, enable and addresses of a memory of LUTs."""
    usual = cell.choice("WCKMUX") == "WCK" and cell.choice("WREMUX") == "WRE"
    if not usual or "1" in cell.parameters.get("INITVAL", ""):
        raise LippmannError(f"{name}: this use of a memory of LUTs is not simulated")
    bits = [cell.bit("WCK"), cell.bit("WRE"), *cell.connections["WAD"], *cell.connections["RAD"]]
    return tuple(map(_net, bits))


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


#: What writes each cell that is written alone, of the cell and its name.
WRITTEN: Mapping[str, Writer] = {
    "LUT4": _lut,
    "PFUMX": _chooser("C0", "ALUT", "BLUT"),
    "L6MUX21": _chooser("SD", "D1", "D0"),
    "TRELLIS_FF": _register,
    "ODDRX1F": _output,
    "MULT18X18D": _block,
    "DP16KD": _block,
}

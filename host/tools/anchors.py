"""Places the cells of a board's fastest clock alone, near their pads, before the others are placed around them.

nextpnr places all cells at once. In a chip that is more than half full the few hundred of the fastest clock are then
spread too far for it. Placed alone they meet it; their places (`BEL`) are written into the whole netlist.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from lippmann.errors import LippmannError
from lippmann.simulation.toolchain import repository

from tools import flow

#: Placements for a seed, of which the fastest is taken.
TRIALS = 4
#: Cells without a clock, which belong to the registers that they lead to.
LOGIC = ("LUT4", "PFUMX", "L6MUX21", "CCU2C")
#: Cells that a place can be written for. Others go with those, or with a pad.
PLACED = ("LUT4", "TRELLIS_FF")
CLOCK_PINS = ("CLK", "SCLK")
#: The PLL's outputs and the parameters with their dividers.
OUTPUTS = {"CLKOP": "CLKOP_DIV", "CLKOS": "CLKOS_DIV", "CLKOS2": "CLKOS2_DIV", "CLKOS3": "CLKOS3_DIV"}

Cell = dict[str, Any]


def anchor(netlist: Path, options: Sequence[str], seed: int, output: Path) -> int:
    """Write the netlist with places for the cells of its fastest clock; return how many have one.

    `options` are nextpnr's for the chip and its pins. Beside `output` nextpnr's log and the netlist of these cells are
    kept. Raises LippmannError as `flow.run_tool`, and when the netlist has no PLL.
    """
    whole = json.loads(netlist.read_text())
    name, module = _top(whole)
    part = fastest(module["cells"])
    alone, placed = output.with_suffix(".alone.json"), output.with_suffix(".placed.json")
    alone.write_text(json.dumps({"creator": whole["creator"], "modules": {name: _cut(module, part)}}))
    short = {path: str(path.relative_to(repository())) for path in (alone, placed)}
    command = [flow.PLACER, *options, "--json", short[alone], "--write", short[placed]]
    best, found = 0.0, {}
    for trial in range(TRIALS * seed, TRIALS * (seed + 1)):
        said = flow.run_tool([*command, "--seed", str(trial), "--no-route", "--timing-allow-fail"])
        share = min(met / asked for met, asked in flow.clocks(said).values())
        if share > best:
            best, found = share, _top(json.loads(placed.read_text()))[1]["cells"]
            output.with_suffix(".log").write_text(said)
    count = 0
    for cell in part:
        kind, attributes = module["cells"][cell]["type"], found.get(cell, {}).get("attributes", {})
        if kind in PLACED and "NEXTPNR_BEL" in attributes:
            module["cells"][cell].setdefault("attributes", {})["BEL"] = attributes["NEXTPNR_BEL"].strip()
            count += 1
    output.write_text(json.dumps(whole))
    placed.unlink()
    return count


def fastest(cells: Mapping[str, Cell]) -> set[str]:
    """Return the names of the cells of the PLL's fastest clock, with the logic before their inputs.

    Of clocks that are equally fast it is the one with the fewest cells.
    """
    plls = [cell for cell in cells.values() if cell["type"] == "EHXPLLL"]
    if len(plls) != 1:
        raise LippmannError(f"the netlist has {len(plls)} PLLs where one makes all clocks")
    dividers = {
        plls[0]["connections"][output][0]: int(plls[0]["parameters"][divider], 2)
        for output, divider in OUTPUTS.items()
        if plls[0]["connections"].get(output) and divider in plls[0]["parameters"]
    }
    clocks = Counter(bit for cell in cells.values() if (bit := _clock(cell)) in dividers)
    clock = min(clocks, key=lambda bit: (dividers[bit], clocks[bit]))
    drivers = _drivers(cells)
    part = {name for name, cell in cells.items() if _clock(cell) == clock}
    todo = list(part)
    while todo:
        for bit in _bits(cells[todo.pop()], "input"):
            driver = drivers.get(bit)
            if driver is not None and driver not in part and cells[driver]["type"] in LOGIC:
                part.add(driver)
                todo.append(driver)
    return part


def _cut(module: Mapping[str, Any], part: set[str]) -> dict[str, Any]:
    """Return the module with these cells only, the cells that drive them, and the pads of both."""
    cells: Mapping[str, Cell] = module["cells"]
    drivers = _drivers(cells)
    kept = {name: cells[name] for name in part}
    for bit in {bit for name in part for bit in _bits(cells[name], "input")}:
        name = drivers.get(bit)
        if name is not None and name not in part:
            kept[name] = cells[name] if cells[name]["type"] == "EHXPLLL" else _deaf(cells[name])
    # What drives the drivers' clocks: the PLL.
    for name in {drivers[clock] for cell in kept.values() if (clock := _clock(cell)) in drivers}:
        kept.setdefault(name, cells[name])
    used = {bit for cell in kept.values() for bits in cell["connections"].values() for bit in bits}
    ports = {name: port for name, port in module["ports"].items() if used & set(port["bits"])}
    names = {name: net for name, net in module["netnames"].items() if set(net["bits"]) <= used}
    return {**module, "ports": ports, "cells": kept, "netnames": names}


def _deaf(cell: Cell) -> Cell:
    """Return the cell with no inputs but its clock."""
    heard = {
        pin: bits
        for pin, bits in cell["connections"].items()
        if pin in CLOCK_PINS or cell["port_directions"][pin] == "output"
    }
    return {**cell, "connections": heard}


def _top(netlist: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return the top module's name and content."""
    modules = netlist["modules"].items()
    return next((name, module) for name, module in modules if int(module.get("attributes", {}).get("top", "0"), 2))


def _clock(cell: Cell) -> int | str | None:
    """Return the net at a cell's clock; None where it has none."""
    return next((cell["connections"][pin][0] for pin in CLOCK_PINS if pin in cell["connections"]), None)


def _bits(cell: Cell, direction: str) -> list[int]:
    """Return the nets at a cell's inputs or outputs; constants are no nets."""
    pins = [bits for pin, bits in cell["connections"].items() if cell["port_directions"][pin] == direction]
    return [bit for bit in chain.from_iterable(pins) if isinstance(bit, int)]


def _drivers(cells: Mapping[str, Cell]) -> dict[int | str | None, str]:
    """Return the cell that drives each net."""
    return {bit: name for name, cell in cells.items() for bit in _bits(cell, "output")}

"""Places the cells of a board's fastest clock in a separate run of nextpnr, near their pads.

nextpnr places all cells at once. In a chip more than half full, nextpnr puts the fastest clock's few hundred cells too
far apart. Placed separately, these cells meet the constraint; their positions (`BEL`) go into the netlist.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from lippmann.errors import LippmannError

from tools import flow

#: Number of placements that are tried per seed; the fastest one is used.
TRIALS = 4
#: Types of cells without a clock, which are placed with the registers that they drive.
LOGIC = ("LUT4", "PFUMX", "L6MUX21", "CCU2C")
#: Types of cells whose positions are written. nextpnr places other cells next to these cells, or at a pad.
PLACED = ("LUT4", "TRELLIS_FF")
CLOCK_PINS = ("CLK", "SCLK")
#: The PLL's outputs, each with the parameter that sets its divider.
OUTPUTS = {"CLKOP": "CLKOP_DIV", "CLKOS": "CLKOS_DIV", "CLKOS2": "CLKOS2_DIV", "CLKOS3": "CLKOS3_DIV"}

Cell = dict[str, Any]


def anchor(netlist: Path, options: flow.Command, seed: int, output: Path) -> int:
    """Write the netlist with positions for the cells of its fastest clock; return the number of these cells.

    `options` are nextpnr's options for the chip and its pins. Also writes the separate run's netlist and log.
    """
    content = json.loads(netlist.read_text())
    name, module = _top(content)
    part = fastest(module["cells"])
    alone, placed = output.with_suffix(".alone.json"), output.with_suffix(".placed.json")
    alone.write_text(json.dumps({"creator": content["creator"], "modules": {name: _cut(module, part)}}))
    command = [flow.PLACER, *options, "--json", alone, "--write", placed]
    best, best_cells = 0.0, {}
    for trial in range(TRIALS * seed, TRIALS * (seed + 1)):
        log = flow.run_tool([*command, "--seed", str(trial), "--no-route", "--timing-allow-fail"])
        speed = min(mhz / target for mhz, target in flow.clocks(log).values())
        if speed > best:
            best, best_cells = speed, _top(json.loads(placed.read_text()))[1]["cells"]
            output.with_suffix(".log").write_text(log)
    count = 0
    for cell in part:
        kind, attributes = module["cells"][cell]["type"], best_cells.get(cell, {}).get("attributes", {})
        if kind in PLACED and "NEXTPNR_BEL" in attributes:
            module["cells"][cell].setdefault("attributes", {})["BEL"] = attributes["NEXTPNR_BEL"].strip()
            count += 1
    output.write_text(json.dumps(content))
    placed.unlink()
    return count


def fastest(cells: Mapping[str, Cell]) -> set[str]:
    """Return the cells of the PLL's fastest clock (in a tie: the one with fewest cells), and the logic before them."""
    plls = [cell for cell in cells.values() if cell["type"] == "EHXPLLL"]
    if len(plls) != 1:
        raise LippmannError(f"the netlist has {len(plls)} PLLs; make all clocks with one PLL")
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
    """Return a module of the cells `part`, their drivers (only clock inputs stay connected), and the pads of both."""
    cells: Mapping[str, Cell] = module["cells"]
    drivers = _drivers(cells)
    selected = {name: cells[name] for name in part}
    for name in {drivers[bit] for cell in part for bit in _bits(cells[cell], "input") if bit in drivers} - part:
        pins = cells[name]["connections"]
        if cells[name]["type"] != "EHXPLLL":
            directions = cells[name]["port_directions"]
            pins = {pin: bits for pin, bits in pins.items() if pin in CLOCK_PINS or directions[pin] == "output"}
        selected[name] = {**cells[name], "connections": pins}
    # Keep the PLL, which drives the clocks of the selected cells.
    for name in {drivers[clock] for cell in selected.values() if (clock := _clock(cell)) in drivers}:
        selected.setdefault(name, cells[name])
    used = {bit for cell in selected.values() for bits in cell["connections"].values() for bit in bits}
    ports = {name: port for name, port in module["ports"].items() if used & set(port["bits"])}
    names = {name: net for name, net in module["netnames"].items() if set(net["bits"]) <= used}
    return {**module, "ports": ports, "cells": selected, "netnames": names}


def _top(netlist: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    modules = netlist["modules"].items()
    return next((name, module) for name, module in modules if int(module.get("attributes", {}).get("top", "0"), 2))


def _clock(cell: Cell) -> int | str | None:
    """Return the net at a cell's clock pin, or None if the cell has no clock."""
    return next((cell["connections"][pin][0] for pin in CLOCK_PINS if pin in cell["connections"]), None)


def _bits(cell: Cell, direction: str) -> list[int]:
    pins = [bits for pin, bits in cell["connections"].items() if cell["port_directions"][pin] == direction]
    return [bit for bit in chain.from_iterable(pins) if isinstance(bit, int)]


def _drivers(cells: Mapping[str, Cell]) -> dict[int | str | None, str]:
    return {bit: name for name, cell in cells.items() for bit in _bits(cell, "output")}

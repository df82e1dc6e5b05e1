"""Cells that are placed first: which they are, and that nextpnr keeps their places."""

import json

import pytest
from lippmann.errors import LippmannError
from tools import anchors, flow

SLOW, FAST, IN, LUT, STILL = 10, 11, 12, 13, 14


def cell(kind, parameters=None, **pins):
    """A cell; pins that begin with q, z or clko are outputs."""
    outputs = ("q", "z", "clko")
    return {
        "type": kind,
        "parameters": parameters or {},
        "attributes": {},
        "connections": {name.upper(): bits for name, bits in pins.items()},
        "port_directions": {name.upper(): "output" if name.startswith(outputs) else "input" for name in pins},
    }


def cells():
    """A register of the slow clock, two of the fast one, the logic between, and a cell that nothing of it needs."""
    dividers = {"CLKOP_DIV": f"{10:032b}", "CLKOS_DIV": f"{2:032b}"}
    return {
        "pll": cell("EHXPLLL", dividers, clki=[IN], clkop=[SLOW], clkos=[FAST]),
        "slow": cell("TRELLIS_FF", clk=[SLOW], di=[LUT], q=[20]),
        "logic": cell("LUT4", a=[20], b=["0"], z=[21]),
        "first": cell("TRELLIS_FF", clk=[FAST], di=[21], q=[22]),
        "second": cell("TRELLIS_FF", clk=[FAST], di=[22], q=[23]),
        "pair": cell("ODDRX1F", sclk=[FAST], d0=[23], d1=[23], rst=["0"], q=[24]),
        "other": cell("LUT4", a=[20], z=[LUT]),
    }


def test_the_fastest_clock_and_the_logic_before_it():
    """The PLL's output with the least divider; logic that leads elsewhere and registers of other clocks are out."""
    some = cells()
    assert anchors.fastest(some) == {"logic", "first", "second", "pair"}
    # Of two fastest clocks the one of fewer cells.
    some["pll"]["parameters"]["CLKOP_DIV"] = f"{2:032b}"
    assert anchors.fastest(some) == {"slow", "other"}
    del some["pll"]
    with pytest.raises(LippmannError, match="0 PLLs"):
        anchors.fastest(some)


@pytest.fixture
def netlist(tmp_path, monkeypatch):
    """A netlist of those cells, a nextpnr that says what it is told to, and the netlists that it was given."""
    given, shares = [], iter([0.8, 0.9, 0.7, 0.9])

    def placed(command, record=None):
        trial, share = int(command[command.index("--seed") + 1]), next(shares)
        module = json.loads((tmp_path / command[command.index("--json") + 1]).read_text())["modules"]["top"]
        given.append((trial, module))
        for name, some in module["cells"].items():
            some["attributes"]["NEXTPNR_BEL"] = f"{name}/{trial}"
        found = {"modules": {"top": module}}
        (tmp_path / command[command.index("--write") + 1]).write_text(json.dumps(found))
        return f"Info: Max frequency for clock 'x': {share * 100} MHz (FAIL at 100.0 MHz)"

    monkeypatch.setattr(flow, "run_tool", placed)
    module = {
        "attributes": {"top": f"{1:032b}"},
        "ports": {"clock": {"direction": "input", "bits": [IN]}, "dark": {"direction": "input", "bits": [LUT]}},
        "cells": cells(),
        "netnames": {"q": {"bits": [23]}, "still": {"bits": [STILL]}},
    }
    whole = tmp_path / "whole.json"
    whole.write_text(json.dumps({"creator": "yosys", "modules": {"top": module}}))
    return whole, tmp_path / "anchored.json", given


def test_the_best_places_are_written(netlist):
    """The fastest of the trials; the part has its drivers, without their inputs, and no other cell or port."""
    whole, output, given = netlist
    assert anchors.anchor(whole, [], 2, output) == 3
    assert [trial for trial, _ in given] == [8, 9, 10, 11]
    part = given[0][1]
    assert set(part["cells"]) == {"pll", "slow", "logic", "first", "second", "pair"}
    assert part["cells"]["slow"]["connections"] == {"CLK": [SLOW], "Q": [20]}
    assert (set(part["ports"]), set(part["netnames"])) == ({"clock"}, {"q"})
    written = json.loads(output.read_text())["modules"]["top"]["cells"]
    places = {name: some["attributes"]["BEL"] for name, some in written.items() if "BEL" in some["attributes"]}
    assert places == {name: f"{name}/9" for name in ("logic", "first", "second")}
    assert {name: some["connections"] for name, some in written.items()} == {
        name: some["connections"] for name, some in cells().items()
    }

"""The bus adapters: AXI4-Lite and Wishbone to APB4, AXI4-Stream around the rays, and optics_block behind them."""

from pathlib import Path

import pytest
from lippmann.display.description import load_display
from lippmann.fixed.build import Build
from lippmann.simulation.harness import optics_parameters
from lippmann.simulation.toolchain import repository
from runner import compiled, seed, simulate

HERE = Path(__file__).parent
#: Transfers at every commit, and in the full run.
COUNTS = [1500, pytest.param(100_000, marks=pytest.mark.full)]


def bench(*files):
    return "\n".join((HERE / f"{name}.sv").read_text() for name in files)


@pytest.mark.parametrize("transfers", COUNTS)
@pytest.mark.parametrize("bus", ["axil", "wishbone"])
def test_registers(bus, transfers):
    program = compiled(f"{bus}_bench", bench=bench(f"{bus}_bench", "apb_memory"))
    simulate(program, f"{bus}_bench", f"cocotb_{bus}_to_apb", seed(), {"TRANSFERS": str(transfers)})


@pytest.mark.parametrize("transfers", COUNTS)
@pytest.mark.parametrize("f", [14, pytest.param(23, marks=pytest.mark.full)])
def test_streams(f, transfers):
    program = compiled("axis_bench", {"F": f}, bench=bench("axis_bench"))
    simulate(program, "axis_bench", "cocotb_axis", seed(), {"TRANSFERS": str(transfers), "BUS_F": str(f)})


def test_optics_block_in_a_system():
    f, display = 16, repository() / "scenes" / "displays" / "paper-square.toml"
    build = Build.of(load_display(display), "exact", f, True, 0)
    program = compiled("optics_bus_bench", optics_parameters(build), bench=bench("optics_bus_bench"))
    environment = {"BUS_F": str(f), "BUS_DISPLAY": str(display), "TRANSFERS": "0"}
    simulate(program, "optics_bus_bench", "cocotb_optics_bus", seed(), environment)

"""sdram_store as yosys reads it, and its clocks after place-and-route alone, between registers (sim/synth)."""

import pytest
from runner import BUILD, TOP
from tools.flow import SYNTHESISER, Source, route, run_tool, synthesise
from tools.synthesis import DEVICE, WANTED_MHZ, sources

PROBE = Source("probe_sdram", {}, sources(TOP, "probe_sdram"))

#: MHz: the memory's fastest grade in use, and the pixel clock of 1280x720 with ten percent in hand.
WANTED = {"mem_clk": 143, "clk": 82}


def test_yosys_reads_it():
    run_tool([SYNTHESISER, "-p", f"{PROBE.commands}; proc; check -assert"])


@pytest.mark.full
def test_its_clocks():
    folder = BUILD / "sdram_store-placed"
    folder.mkdir(parents=True, exist_ok=True)
    netlist = folder / "netlist.json"
    written = synthesise(PROBE, netlist, folder / "yosys.log")
    for seed in (1, 2, 3):
        options = [*DEVICE, "--freq", str(WANTED_MHZ)]
        found = route(netlist, written, options, seed, folder / f"report-{seed}.json", folder / f"{seed}.log")
        achieved = {name.split("$")[2].removesuffix("_i"): one["achieved"] for name, one in found["fmax"].items()}
        assert set(achieved) == set(WANTED)
        for clock, wanted in WANTED.items():
            assert achieved[clock] >= wanted, (seed, achieved)
        # Line buffers of show and read; no multiplier.
        assert found["utilization"]["DP16KD"]["used"] == 5
        assert found["utilization"]["MULT18X18D"]["used"] == 0

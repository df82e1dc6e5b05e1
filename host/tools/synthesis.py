"""Places and routes the named configurations with yosys and nextpnr for an ECP5-85, and writes a table of the results.

A configuration is placed as the engine `ray_stream`; some also as the block with registers, and as the whole board at
two sizes of panel. `python -m tools.synthesis` (`make synth`) writes docs/generated/reports/synthesis.md, and
synthesis-drawing.md of designs that draw a scene. Results are kept under build/synth/ by a hash of their inputs: a
design is placed and routed again only when its sources have changed.
"""

from __future__ import annotations

import json
import re
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
from lippmann.base.images import check_output
from lippmann.base.provenance import provenance
from lippmann.cli.frame import Choice, argument, option
from lippmann.cli.output import log
from lippmann.conformance.pages import Page
from lippmann.errors import InputError, LippmannError
from lippmann.fixed.scene_build import SceneBuild
from lippmann.simulation.harness import optics_parameters, scene_parameters
from lippmann.simulation.toolchain import repository
from lippmann.simulation.virtual_board import KNOWN_TIMINGS, TIMING

from tools import flow
from tools.fixed_errors import frame_words, measure
from tools.flow import Source
from tools.lint import elaborated
from tools.measured_page import measured_page
from tools.named_builds import CONFIGURATIONS, Named
from tools.program import REPORT, program
from tools.report_plots import draw_bar_charts, make_page

#: The target clock of nextpnr, MHz, above what it can reach: it must not stop early.
WANTED_MHZ = 200
DEVICE = ("--85k", "--speed", "6", "--package", "CABGA381", "--lpf-allow-unconstrained", "--timing-allow-fail")
#: The largest number of pixels of each display over which errors are measured.
SAMPLE_PIXELS = 2_000_000
#: Registers of sim/synth/probe_top.sv and probe.sv, which keep their names.
PROBE = ("reset_q", "config_q", "ray_q", "apply_q", "valid_q", "ready_q", "in_q", "out_q", "fold_q", "bit_q", "bit_o")


# ---- designs ----


@dataclass(frozen=True)
class Design:
    """What is placed: a configuration in a probe of sim/synth; `panel` is the board's, in pixels.

    `scene` is a build of the drawing: of a board that draws, or placed alone, for the configuration's F.
    """

    named: Named
    top: str = "probe_top"
    panel: tuple[int, int] | None = None
    scene: SceneBuild | None = None

    @property
    def name(self) -> str:
        """Its name: that of the configuration; before it `block`, `board` and the panel, or `scene` and the filter."""
        parts = [] if self.panel is None else ["x".join(map(str, self.panel))]
        parts += [] if self.scene is None else ["bilinear" if self.scene.bilinear else "nearest"]
        return "-".join([*self.top.split("_")[1:], *parts, self.named.name]).removeprefix("top-")

    @property
    def parameters(self) -> dict[str, str | int]:
        """The parameters of its top."""
        drawing = {} if self.scene is None else scene_parameters(self.scene, self.named.build.fraction_bits)
        if self.top == "probe_scene":
            return drawing
        build: dict[str, str | int] = {**optics_parameters(self.named.build)}
        if self.panel is None:
            return build
        size = dict(zip(("Width", "Height"), self.panel, strict=True))
        timing = dict(zip(TIMING, KNOWN_TIMINGS[self.panel], strict=True))
        scene = {name: value for name, value in drawing.items() if name == "Scene"}
        return build | size | timing | scene


#: Panels and configurations of the boards that are placed; the configurations are also placed as a block, bare and
#: behind the adapters of rtl/bus.
PANELS = ((640, 480), (1280, 720))
WHOLE = [CONFIGURATIONS[name] for name in ("compact-square", "widest-square")]
BOARDS = [Design(named, "probe_board", panel) for panel in PANELS for named in WHOLE]
#: The drawing with four layers of 256 x 192 texels, alone and on a board.
SCENES = [
    Design(WHOLE[0], top, panel, SceneBuild(4, bilinear=bilinear))
    for top, panel in (("probe_scene", None), ("probe_board", PANELS[1]))
    for bilinear in (False, True)
]
DESIGNS = {
    design.name: design
    for design in (
        *map(Design, CONFIGURATIONS.values()),
        *(Design(named, f"probe_{part}") for part in ("block", "axi", "wishbone") for named in WHOLE),
        *BOARDS,
        *SCENES,
    )
}


# ---- sources ----


def sources(top: Path, probe: str = "probe_top") -> list[Path]:
    """Return the files that yosys reads for a probe, packages first, ECP5's cells in place of the generic ones."""
    return flow.ecp5_files(probe, top / "sim" / "synth")


def source(design: Design) -> Source:
    """Return what yosys reads for a design."""
    return Source(design.top, design.parameters, sources(repository(), design.top))


# ---- place and route ----


def place(design: Design, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Synthesise a design, place and route it with each seed, or return what is kept of it, as rows of the page.

    `stages` are those of the pipeline from pixel to ray; `mhz` is the clock after routing; the cells are those of the
    whole design, of which `probe_ff` flip-flops are the probe's around the engine.
    """
    read = source(design)
    folder = flow.work_folder("synth", design.name, (design.parameters, WANTED_MHZ, DEVICE), read.files)
    results = {seed: folder / f"seed-{seed}.json" for seed in seeds}
    missing = [seed for seed in seeds if flow.read_kept(results[seed]) is None]
    if missing:
        with tempfile.TemporaryDirectory(dir=folder) as work:
            netlist = Path(work) / "netlist.json"
            started = time.perf_counter()
            written = flow.synthesise(read, netlist, folder / "yosys.log")
            synthesis = time.perf_counter() - started
            probe_ff = _probe_registers(json.loads(netlist.read_text()), design.top)
            for seed in missing:
                placed = _routed(design, netlist, written, seed, folder)
                placed["seconds"] = round(placed["seconds"] + synthesis, 1)
                flow.keep(results[seed], placed | {"probe_ff": probe_ff})
    return [{"configuration": design.name, **flow.read_kept(path)} for path in results.values()]


def _routed(design: Design, netlist: Path, written: int, seed: int, folder: Path) -> dict[str, Any]:
    """Place and route a netlist with a seed; return the row but for its name and the probe's registers."""
    started = time.perf_counter()
    options = [*DEVICE, "--freq", str(WANTED_MHZ)]
    report, record = folder / f"report-{seed}.json", folder / f"nextpnr-{seed}.log"
    found = flow.route(netlist, written, options, seed, report, record)
    return {
        "stages": stages(design.named),
        "mhz": round(min(clock["achieved"] for clock in found["fmax"].values()), 2),
        **flow.resources(found),
        "limit": _slowest(found),
        "seed": seed,
        "seconds": time.perf_counter() - started,
    }


def stages(named: Named) -> int:
    """Return a configuration's latency in clocks, which the RTL's own function tells at elaboration."""
    top = repository()
    packages = ("math/lipp_math_pkg.sv", "optics/lipp_optics_pkg.sv")
    files = [*(top / "rtl" / path for path in packages), top / "sim" / "synth" / "latency.sv"]
    result = elaborated("latency", files, parameters=optics_parameters(named.build))
    found = re.search(r"ray_latency = (\d+)", result.stdout + result.stderr)
    if result.returncode or found is None:
        raise LippmannError(f"verilator does not tell the latency: {result.stderr.strip().splitlines()[-1:]}")
    return int(found[1])


def _probe_registers(netlist: dict[str, Any], top: str) -> int:
    """Count the flip-flops of the probe itself."""
    module = netlist["modules"][top]
    names = [name for name in module["netnames"] if name.removeprefix("i_probe.") in PROBE]
    own = {bit for name in names for bit in module["netnames"][name]["bits"]}
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
    return ".".join(part.removeprefix("i_") for part in parts if part not in {"i_board", "i_lenslet", "i_pipeline"})


# ---- report ----

ERRORS = ("max_direction_urad", "rms_direction_urad", "max_point_nm", "rms_point_nm")


def page(origin: Mapping[str, str], rows: Sequence[Mapping[str, Any]], whole: Sequence[Mapping[str, Any]]) -> Page:
    """Return the page of the configurations and of the whole designs."""
    shown = rows or whole
    charts = {"clock, MHz": [row["mhz"] for row in shown], "LUT": [row["lut"] for row in shown]}
    plot = draw_bar_charts("synthesis", [row["configuration"] for row in shown], charts)
    tables = {"synthesis": rows, "synthesis-board": whole}
    context = {"rows": rows, "whole": whole, "mhz": WANTED_MHZ, "pixels": SAMPLE_PIXELS}
    return make_page("synthesis", origin, [plot], tables, context)


@program
def main(
    names: tuple[str, ...] = argument("[NAMES]...", (), Choice([*DESIGNS]), nargs=-1),
    seeds: tuple[int, ...] = option(
        "nextpnr's seed. Each seed given is a row.  [default: 1; for blocks, boards and drawings 1, 2 and 3]",
        (), click.IntRange(0), "--seed", multiple=True,
    ),
    report: str = REPORT,
) -> None:  # fmt: skip
    """Place and route designs (all by default), and write the report.

    Example: python -m tools.synthesis compact-square board-640x480-compact-square --report out
    """
    check_output(Path(report) / "synthesis.md", (".md",))
    asked = [DESIGNS[name] for name in names or DESIGNS if DESIGNS[name].scene is None]
    kept = Path(report).resolve() == repository() / "docs/generated/reports"
    if kept and 0 < len(asked) < sum(design.scene is None for design in DESIGNS.values()):
        raise InputError(f"{report}: its page has all designs, and would have {len(asked)}; give --report FOLDER")
    scenes = repository() / "scenes"
    rows: list[dict[str, Any]] = []
    whole: list[dict[str, Any]] = []
    drawn: list[dict[str, Any]] = []
    for design in [DESIGNS[name] for name in names or DESIGNS]:
        for placed in place(design, seeds or ((1,) if design.top == "probe_top" else (1, 2, 3))):
            log(f"{design.name}, seed {placed['seed']}: {placed['mhz']:.1f} MHz, {placed['seconds']:.0f} s")
            if design.top != "probe_top":
                (whole if design.scene is None else drawn).append(placed)
                continue
            errors = [
                measure(
                    design.named, display, "sample", frame_words(display, design.named.build, 1, most=SAMPLE_PIXELS)
                )
                for display in design.named.displays(scenes)
            ]
            rows.append(placed | {name: max(error[name] for error in errors) for name in ERRORS})
    options = "".join(f" {name}" for name in names)
    chosen = "".join(f" --seed {seed}" for seed in seeds)
    origin = provenance(f"python -m tools.synthesis{chosen}{options}", ("numpy",), flow.versions())
    if drawn:
        context = {"rows": drawn, "mhz": WANTED_MHZ}
        make_page("synthesis-drawing", origin, [], {"synthesis-drawing": drawn}, context).write(Path(report))
    if rows or whole:
        page(origin, rows, whole).write(Path(report))
    if rows and kept:
        measured_page(repository() / "docs/generated").write(repository() / "docs/generated")  # it shows these rows

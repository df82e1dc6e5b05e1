"""Places and routes the named configurations for an ECP5-85 (`python -m tools.synthesis`, `make synth`).

Each configuration is placed as the module `ray_stream`; some are also placed as the block with registers, and as the
complete board with two panel sizes. Results are cached in build/synth/, keyed by a hash of the inputs.
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
from lippmann.base.report_provenance import provenance
from lippmann.cli.frame import Choice, argument, option
from lippmann.cli.output import log
from lippmann.conformance.figures import Rows, columns, values
from lippmann.conformance.pages import Page
from lippmann.errors import InputError, LippmannError
from lippmann.fixed.scene_build import SceneBuild
from lippmann.simulation.harness import optics_parameters, scene_parameters
from lippmann.simulation.toolchain import repository
from lippmann.simulation.video_timing import KNOWN_TIMINGS, TIMING

from tools import flow
from tools.fixed_errors import frame_words, measure
from tools.flow import Source
from tools.lint import elaborated
from tools.measured_page import measured_page
from tools.named_builds import CONFIGURATIONS, Named
from tools.program import REPORT, program
from tools.report_plots import draw_bar_charts, make_page

#: Target clock for nextpnr, MHz, which it cannot reach, so that it does not stop early.
WANTED_MHZ = 200
DEVICE = ("--85k", "--speed", "6", "--package", "CABGA381", "--lpf-allow-unconstrained", "--timing-allow-fail")
#: Maximum pixels per display for which errors are measured.
SAMPLE_PIXELS = 2_000_000
#: Names, in the netlist, of the registers of sim/synth/probe_top.sv and probe.sv.
PROBE = ("reset_q", "config_q", "ray_q", "apply_q", "valid_q", "ready_q", "in_q", "out_q", "fold_q", "bit_q", "bit_o")


@dataclass(frozen=True)
class Design:
    """A design: a configuration, its top in sim/synth, a board's panel (pixels), a drawing's build."""

    variant: Named
    top: str = "probe_top"
    panel: tuple[int, int] | None = None
    scene: SceneBuild | None = None

    @property
    def name(self) -> str:
        """The design's name, such as board-1280x720-nearest-compact-square."""
        parts = [] if self.panel is None else ["x".join(map(str, self.panel))]
        parts += [] if self.scene is None else ["bilinear" if self.scene.bilinear else "nearest"]
        return "-".join([*self.top.split("_")[1:], *parts, self.variant.name]).removeprefix("top-")

    @property
    def parameters(self) -> dict[str, str | int]:
        """The parameters of the top module."""
        drawing = {} if self.scene is None else scene_parameters(self.scene, self.variant.build.fraction_bits)
        if self.top == "probe_scene":
            return drawing
        build: dict[str, str | int] = {**optics_parameters(self.variant.build)}
        if self.panel is None:
            return build
        names, numbers = ("Width", "Height", *TIMING), (*self.panel, *KNOWN_TIMINGS[self.panel])
        scene = {name: value for name, value in drawing.items() if name == "Scene"}
        return build | dict(zip(names, numbers, strict=True)) | scene


#: Panels and configurations of the boards that are placed. The configurations are placed as blocks too: alone,
#: with AXI and with Wishbone.
PANELS = ((640, 480), (1280, 720))
WHOLE = [CONFIGURATIONS[name] for name in ("compact-square", "widest-square")]
BOARDS = [Design(variant, "probe_board", panel) for panel in PANELS for variant in WHOLE]
#: The drawing of four layers of 256 x 192 texels, without a board and on a board.
SCENES = [
    Design(WHOLE[0], top, panel, SceneBuild(4, bilinear=bilinear))
    for top, panel in (("probe_scene", None), ("probe_board", PANELS[1]))
    for bilinear in (False, True)
]
BLOCKS = [Design(variant, f"probe_{part}") for part in ("block", "axi", "wishbone") for variant in WHOLE]
DESIGNS = {design.name: design for design in (*map(Design, CONFIGURATIONS.values()), *BLOCKS, *BOARDS, *SCENES)}


def sources(top: Path, probe: str = "probe_top") -> list[Path]:
    """Return the files of a probe, packages first, including ECP5's cells."""
    return flow.ecp5_files(probe, top / "sim" / "synth")


def source(design: Design) -> Source:
    """Return the input of yosys for a design."""
    return Source(design.top, design.parameters, sources(repository(), design.top))


def place(design: Design, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Synthesise, place and route a design with each seed, unless cached; return the rows."""
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
                placed = _route(design, netlist, written, seed, folder)
                placed["seconds"] = round(placed["seconds"] + synthesis, 1)
                flow.keep(results[seed], placed | {"probe_ff": probe_ff})
    return [{"configuration": design.name, **flow.read_kept(path)} for path in results.values()]


def _route(design: Design, netlist: Path, written: int, seed: int, folder: Path) -> dict[str, Any]:
    """Place and route a netlist; return the row, without the name and the probe's registers."""
    started = time.perf_counter()
    options = [*DEVICE, "--freq", str(WANTED_MHZ)]
    report, record = folder / f"report-{seed}.json", folder / f"nextpnr-{seed}.log"
    results = flow.route(netlist, written, options, seed, report, record)
    mhz = round(min(clock["achieved"] for clock in results["fmax"].values()), 2)
    row = {"stages": stages(design.variant), "mhz": mhz, **flow.resources(results), "limit": _slowest(results)}
    return {**row, "seed": seed, "seconds": time.perf_counter() - started}


def stages(variant: Named) -> int:
    """Return a configuration's latency in clocks, which the RTL prints at elaboration."""
    top = repository()
    packages = ("math/lipp_math_pkg.sv", "optics/lipp_optics_pkg.sv")
    files = [*(top / "rtl" / path for path in packages), top / "sim" / "synth" / "latency.sv"]
    result = elaborated("latency", files, parameters=optics_parameters(variant.build))
    latency = re.search(r"ray_latency = (\d+)", result.stdout + result.stderr)
    if result.returncode or latency is None:
        raise LippmannError(f"verilator does not print the latency: {result.stderr.strip().splitlines()[-1:]}")
    return int(latency[1])


def _probe_registers(netlist: dict[str, Any], top: str) -> int:
    module = netlist["modules"][top]
    names = [name for name in module["netnames"] if name.removeprefix("i_probe.") in PROBE]
    own = {bit for name in names for bit in module["netnames"][name]["bits"]}
    registers = (cell for cell in module["cells"].values() if cell["type"] == "TRELLIS_FF")
    return sum(cell["connections"]["Q"][0] in own for cell in registers)


def _slowest(report: dict[str, Any]) -> str:
    """Describe the slowest path between registers: its ends, and its delays in logic and routing, ns."""
    for path in report["critical_paths"]:
        if path["from"] == path["to"]:
            steps = path["path"]
            first, last = (_place_of(step) for step in (steps[0]["from"]["cell"], steps[-1]["to"]["cell"]))
            routing = sum(step["delay"] for step in steps if step["type"] == "routing")
            logic = sum(step["delay"] for step in steps) - routing
            return f"{first} to {last} ({logic:.1f} ns logic, {routing:.1f} ns routing)"
    return "no path between registers"


def _place_of(cell: str) -> str:
    """Return a cell's instance path without the parts common to all paths, and without yosys' suffixes."""
    name = re.split(r"_(?:TRELLIS|LUT4|CCU2C|PFUMX|L6MUX|MULT18|DP16KD)", cell)[0]
    parts = [part for part in name.split(".") if not part.startswith("gen_")]
    return ".".join(part.removeprefix("i_") for part in parts if part not in {"i_board", "i_lenslet", "i_pipeline"})


ERRORS = ("max_direction_urad", "rms_direction_urad", "max_point_nm", "rms_point_nm")


def page(origin: Mapping[str, str], rows: Rows, boards: Rows) -> Page:
    """Return the page of the placed configurations, blocks and boards."""
    charts = columns(rows or boards, {"clock, MHz": "mhz", "LUT": "lut"})
    plot = draw_bar_charts("synthesis", values(rows or boards, "configuration"), charts)
    tables = {"synthesis": rows, "synthesis-board": boards}
    context = {"rows": rows, "whole": boards, "mhz": WANTED_MHZ, "pixels": SAMPLE_PIXELS}
    return make_page("synthesis", origin, [plot], tables, context)


@program
def main(
    names: tuple[str, ...] = argument("[NAMES]...", (), Choice([*DESIGNS]), nargs=-1),
    seeds: tuple[int, ...] = option(
        "nextpnr's seed; may be repeated. [default: 1; for blocks, boards and drawings 1, 2 and 3]",
        (), click.IntRange(0), "--seed", multiple=True,
    ),
    report: str = REPORT,
) -> None:  # fmt: skip
    """Place and route designs (by default all designs), and write the report.

    Example: python -m tools.synthesis compact-square board-640x480-compact-square --report out
    """
    check_output(Path(report) / "synthesis.md", (".md",))
    designs = [DESIGNS[name] for name in names or DESIGNS]
    on_page = sum(design.scene is None for design in designs)
    in_docs = Path(report).resolve() == repository() / "docs/generated/reports"
    if in_docs and 0 < on_page < sum(design.scene is None for design in DESIGNS.values()):
        raise InputError(f"{report}: this run has only {on_page} of the page's designs; give another --report FOLDER")
    rows: list[dict[str, Any]] = []
    boards: list[dict[str, Any]] = []
    drawn: list[dict[str, Any]] = []
    for design in designs:
        for placed in place(design, seeds or ((1,) if design.top == "probe_top" else (1, 2, 3))):
            log(f"{design.name}, seed {placed['seed']}: {placed['mhz']:.1f} MHz, {placed['seconds']:.0f} s")
            if design.top != "probe_top":
                (boards if design.scene is None else drawn).append(placed)
                continue
            variant, errors = design.variant, []
            for display in variant.displays(repository() / "scenes"):
                sample = frame_words(display, variant.build, 1, SAMPLE_PIXELS)
                errors.append(measure(variant, display, "sample", sample))
            rows.append(placed | {name: max(error[name] for error in errors) for name in ERRORS})
    words = "".join([*(f" --seed {seed}" for seed in seeds), *(f" {name}" for name in names)])
    origin = provenance(f"python -m tools.synthesis{words}", ("numpy",), flow.versions())
    if drawn:
        context = {"rows": drawn, "mhz": WANTED_MHZ}
        make_page("synthesis-drawing", origin, [], {"synthesis-drawing": drawn}, context).write(Path(report))
    if rows or boards:
        page(origin, rows, boards).write(Path(report))
    if rows and in_docs:
        # Refresh measured.md, which shows these rows.
        measured_page(repository() / "docs/generated").write(repository() / "docs/generated")

"""Makes the bitstream of an FPGA board for a display: `python -m tools.bitstream` (`make bitstream`)."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import click
from lippmann.base.files import replacing
from lippmann.base.images import check_output
from lippmann.base.report_provenance import provenance
from lippmann.board.bitstreams import comment, sealed
from lippmann.board.fpga_boards import FILE, FpgaBoard, fpga_board
from lippmann.cli.frame import option
from lippmann.cli.output import log
from lippmann.conformance.pages import Page
from lippmann.display.description import Display, load_display
from lippmann.errors import InputError, LippmannError, input_error
from lippmann.fixed.build import Build
from lippmann.fixed.scene_build import SceneBuild
from lippmann.simulation.harness import optics_parameters
from lippmann.simulation.toolchain import hardware, repository
from lippmann.simulation.video_timing import TIMING, timing_of
from lippmann.simulation.virtual_board import board_build, check_panel, step_of

from tools import flow
from tools.anchors import TRIALS, anchor
from tools.flow import Source, run_tool
from tools.pll import SHIFT_CLOCKS, TOLERANCE, Pll, panel_pixel_mhz, solve
from tools.program import program
from tools.report_plots import draw_bar_charts, make_page

#: Default display and seeds.
VGA = "scenes/displays/vga-square.toml"
SEEDS = "1,2,3,4,5,6,7,8"
#: Default time limit of a seed, minutes; PyPI's nextpnr on two cores needs less.
PATIENCE_MIN = 240
#: Number of 16-bit SDRAM words per pair of pixels, and per row of the SDRAM.
PAIR_WORDS, ROW_WORDS = 3, 512
#: Maximum fraction of the SDRAM's clocks in a video line for panel and refreshes; the refreshes' fraction; SDRAM clocks
#: per word of the panel, including the clocks that open and close SDRAM rows.
MAX_SHARE, REFRESH_SHARE, WORD_CLOCKS = 0.9, 0.01, 1.06
#: Relative error of a clock constraint: nextpnr rounds the period to picoseconds.
ROUNDING = 0.002
#: Maximum system clock, MHz, for which nextpnr's router2 is used. router2 ends in minutes, where router1 may try a few
#: arcs for hours, but router2's routes are longer (hd-square: 55 MHz instead of 81). --tmg-ripup routes arcs that miss
#: their clock again (vga-square, seed 3: the memory's clock then reaches 140 MHz instead of 120).
SLOW_MHZ = 40.0
#: Minimum number of shift clocks from a registered symbol to its copy (rtl/video/lipp_tmds_serialiser.sv).
SYMBOL_CLOCKS = 2
#: Clock roles, keyed by the net's name in the top module, or by its driving port's without `_o`. Others: oscillator.
CLOCK_NETS = {
    "clk": "system", "system_clk": "system", "mem_clk": "memory", "memory_clk": "memory", "shift_clk": "shift",
}  # fmt: skip
BOARD_BITS = 8
DEVICES = (
    "12k", "25k", "45k", "85k", "um-25k", "um-45k", "um-85k", "um5g-25k", "um5g-45k", "um5g-85k",
)  # fmt: skip
#: Pattern of a port's clock in a pin file: port, frequency and unit.
PORT_CLOCK = re.compile(
    r'^\s*FREQUENCY\s+PORT\s+"?([^"\s]+)"?\s+(\d+(?:\.\d*)?)\s*([KM]?HZ)\b', re.IGNORECASE | re.MULTILINE
)
UNITS_MHZ = {"HZ": 1e-6, "KHZ": 1e-3, "MHZ": 1.0}
MAX_SEED = 2**31 - 1


class TimingError(LippmannError):
    """No seed met every clock."""

    exit_code = 4


@dataclass(frozen=True)
class Plan:
    """The plan of a bitstream: board, display, clocks, build of the optics, build of the drawing (None: no drawing)."""

    board: FpgaBoard
    display: Display
    scene: SceneBuild | None
    build: Build
    pll: Pll

    @property
    def name(self) -> str:
        """The name of the bitstream's files."""
        kind = "stream" if self.scene is None else "bilinear" if self.scene.bilinear else ""
        return "-".join(filter(None, (self.board.name, self.display.name, kind)))

    @property
    def clocks_mhz(self) -> dict[str, float]:
        """The frequency of each clock in MHz, keyed by the clock's role."""
        clocks = {name: float(mhz) for name, mhz in self.pll.clocks_mhz.items()}
        if self.board.video != "dvi":
            del clocks["shift"]
        return clocks | {"oscillator": self.board.oscillator_mhz}

    @property
    def parameters(self) -> dict[str, str | int]:
        """The parameters of the board's top module."""
        panel = self.display.panel
        clock_hz = round(self.pll.clocks_mhz["system"] * 1_000_000)
        return {
            "Width": panel.width_px,
            "Height": panel.height_px,
            **dict(zip(TIMING, timing_of(self.display), strict=True)),
            **optics_parameters(self.build),
            "Scene": f"26'h{0 if self.scene is None else self.scene.word:07x}",
            "Timing": f"lipp_sdram_pkg::{self.board.memory.grade}",
            "Identity": f"64'h{self.display.identity}",
            "UartStep": f"16'd{step_of(self.board.baud, clock_hz)}",
            "ClockHz": clock_hz,
            "MemoryHz": math.ceil(self.pll.clocks_mhz["memory"] * 1_000_000),
            **self.pll.parameters,
        }

    @property
    def source(self) -> Source:
        """The input of yosys."""
        return Source(self.board.top, self.parameters, flow.ecp5_files(self.board.top, *self.board.folders))

    @property
    def constraints(self) -> list[Path]:
        """The board's pin files."""
        return [(self.board.folder / name).resolve() for name in self.board.constraints]


def plan(board: FpgaBoard, display: Display, layers: int = 4, bilinear: bool = False) -> Plan:
    """Plan a bitstream; raise InputError for a display that the board cannot show at 60 Hz."""
    check_board(board)
    check_panel(display)
    where = f"display '{display.name}'"
    panel, timing = display.panel, timing_of(display)
    if panel.bits != BOARD_BITS:
        what = f"the panel has {panel.bits} bits a colour, {board.name} sends {BOARD_BITS}"
        raise input_error(where, what, f"set bits = {BOARD_BITS}, which every monitor accepts")
    if panel.width_px % 2:
        raise input_error(where, f"the panel is {panel.width_px} pixels wide", "choose an even width for the SDRAM")
    rows = math.ceil(panel.width_px * panel.height_px / 2 * PAIR_WORDS / ROW_WORDS)
    frames_mb = 2 * rows * ROW_WORDS * 2 / 2**20
    if frames_mb > board.memory.megabytes:
        what = f"two frames take {frames_mb:.1f} MiB, the SDRAM of {board.name} has {board.memory.megabytes}"
        raise input_error(where, what, "choose a smaller panel")
    pixel = panel_pixel_mhz(panel.width_px, panel.height_px, timing)
    dvi = board.video == "dvi"
    limits = [("DVI's bits", SHIFT_CLOCKS, board.limits.shift_mhz or math.inf)] if dvi else []
    limits += [("the system", 1, board.limits.system_mhz)]
    for name, times, limit in limits:
        mhz = float(times * pixel)
        if mhz > limit:
            what = f"60 frames a second need a clock of {mhz:.1f} MHz for {name}, {board.name} has {limit:g} at most"
            raise input_error(where, what, "choose a smaller panel, such as scenes/displays/hd-square.toml")
    words = Fraction(PAIR_WORDS, 2) * Fraction(WORD_CLOCKS) * pixel
    # The PLL's pixel clock can exceed the display's by the tolerance.
    words *= Fraction(panel.width_px, panel.width_px + sum(timing[:3])) * (1 + TOLERANCE)
    least = words / Fraction(MAX_SHARE - REFRESH_SHARE)
    fastest = Fraction(min(board.memory.max_mhz, board.limits.memory_mhz))
    if least > fastest:
        share = float(words / fastest) + REFRESH_SHARE
        what = f"the panel takes {share:.0%} of the SDRAM's clocks in a line, at most {MAX_SHARE:.0%} are available"
        raise input_error(where, what, "choose a narrower panel")
    fastest_pixel = min(Fraction(limit) / times for _, times, limit in limits if limit < math.inf)
    scene = SceneBuild(layers, bilinear=bilinear) if layers else None
    build = replace(board_build(display, scene), cross_cells=False)
    oscillator = Fraction(board.oscillator_mhz)
    try:
        pll = solve(pixel, oscillator, (least, fastest), dvi=dvi, fastest_mhz=fastest_pixel)
    except InputError as error:
        raise InputError(f"{where} on {board.name}: {error}") from None
    try:
        step_of(board.baud, round(pll.clocks_mhz["system"] * 1_000_000))
    except InputError as error:
        raise InputError(f"{where} on {board.name}: {error}, with the key baud of {board.folder / FILE}") from None
    return Plan(board, display, scene, build, pll)


def check_board(board: FpgaBoard) -> None:
    """Raise InputError if a board's file names a missing file or module, or contradicts its pin files."""
    where = board.folder / FILE
    if not any((folder / f"{board.top}.sv").is_file() for folder in board.folders):
        raise input_error(f"{where}: top", f"its folder has no {board.top}.sv", "give the name of the top module")
    if not board.constraints:
        raise input_error(f"{where}: constraints", "is empty", "list pin files (.lpf)")
    clocks = {}
    for name in board.constraints:
        pins = (board.folder / name).resolve()
        if Path(name).is_absolute() or not pins.is_relative_to(hardware().resolve()):
            what = f"{name} is not a relative path to a file of the checkout"
            raise input_error(f"{where}: constraints", what, "copy the pin file into the board's folder")
        if not pins.is_file():
            raise input_error(f"{where}: constraints", f"there is no file {name}", "list pin files (.lpf)")
        # Remove the pin file's comments, and put one command on each line.
        text = re.sub(r"(#|//).*", "", pins.read_text(errors="replace"))
        text = "\n".join(" ".join(command.split()) for command in text.split(";"))
        for port, number, unit in PORT_CLOCK.findall(text):
            clocks[f'FREQUENCY PORT "{port}" of {name}'] = float(number) * UNITS_MHZ[unit.upper()]
    if not any(math.isclose(mhz, board.oscillator_mhz, rel_tol=1e-6) for mhz in clocks.values()):
        there = ", ".join(f"{clock} is {mhz:g} MHz" for clock, mhz in clocks.items())
        what = f"{board.oscillator_mhz:g} MHz, and {there or 'no pin file has a FREQUENCY PORT'}"
        raise input_error(f"{where}: oscillator_mhz", what, "give the same oscillator clock in board file and pin file")
    if board.fpga.device not in DEVICES:
        what = f"'{board.fpga.device}' is not a device of nextpnr"
        raise input_error(f"{where}: fpga.device", what, f"choose from {', '.join(DEVICES)}")
    grades = re.findall(r"localparam timing_t (\w+)", (hardware() / "rtl/memory/lipp_sdram_pkg.sv").read_text())
    if board.memory.grade not in grades:
        what = f"'{board.memory.grade}' is not a memory grade"
        raise input_error(f"{where}: memory.grade", what, f"choose from {', '.join(grades)}")


# ---- synthesis, placement, bitstream ----


def place(
    design: Plan, seeds: Sequence[int], every: bool = False, patience_min: int = PATIENCE_MIN
) -> list[dict[str, Any]]:
    """Synthesise a design, then place and route with each seed until one meets every clock; return the seeds' rows.

    With `every`, all seeds are tried. A row's `missed` is empty if all clocks are met. A seed's run is stopped after
    `patience_min`. Results are cached.
    """
    folder = _work_folder(design)
    netlist, count = folder / "netlist.json", folder / "written.json"
    written = flow.read_kept(count)
    if written is None or not netlist.exists():
        log(f"{design.name}: synthesis")
        written = flow.keep(count, flow.synthesise(design.source, netlist, folder / "yosys.log"))
    rows = []
    for seed in seeds:
        result = folder / f"seed-{seed}.json"
        run = flow.read_kept(result)
        if run is None or run.get("stopped_min", patience_min) < patience_min:
            log(f"{design.name}: place and route, seed {seed}")
            run = flow.keep(result, _route(design, netlist, written, seed, patience_min))
        rows.append(_row(design, folder, seed, run))
        if not rows[-1]["missed"] and not every:
            break
    return rows


def _work_folder(design: Plan) -> Path:
    inputs = (design.parameters, design.board, TRIALS, *_router(design))
    return flow.work_folder("bitstream/work", design.name, inputs, (*design.source.files, *design.constraints))


def _route(design: Plan, netlist: Path, written: int, seed: int, patience_min: int) -> dict[str, Any]:
    """Place and route with a seed; return `seconds`, and `stopped_min` if stopped. A missed clock raises no error."""
    fpga, folder = design.board.fpga, netlist.parent
    configuration, record = folder / f"seed-{seed}.config", folder / f"seed-{seed}.log"
    configuration.unlink(missing_ok=True)
    options: list[str | Path] = [f"--{fpga.device}", "--speed", str(fpga.speed), "--package", fpga.package]
    for path in design.constraints:
        options += ["--lpf", path]
    started = time.perf_counter()
    if "shift" in design.clocks_mhz:
        anchored = folder / f"seed-{seed}.netlist.json"
        if not anchor(netlist, options, seed, anchored):
            raise LippmannError(f"{netlist}: nextpnr placed no cell of the shift clock")
        netlist = anchored
    options += [*_router(design), "--textcfg", configuration]
    try:
        flow.route(netlist, written, options, seed, folder / f"seed-{seed}.report.json", record, 60.0 * patience_min)
    except flow.TooSlowError:
        return {"seconds": round(time.perf_counter() - started, 1), "stopped_min": patience_min}
    except LippmannError:
        # nextpnr writes its configuration after the final clock figures, even if a clock is missed. A run that fails
        # earlier prints only figures from before routing, which are not valid.
        if not configuration.exists():
            raise
        met, missed = clocks_met(design, record.read_text())
        if met.keys() != design.clocks_mhz.keys() or not missed:
            raise
    return {"seconds": round(time.perf_counter() - started, 1)}


def _router(design: Plan) -> list[str]:
    return ["--router", "router2", "--tmg-ripup"] if design.clocks_mhz["system"] <= SLOW_MHZ else []


def _row(design: Plan, folder: Path, seed: int, run: Mapping[str, Any]) -> dict[str, Any]:
    met: dict[str, float] = {}
    missed = [f"not routed after {run['stopped_min']} min"] if "stopped_min" in run else []
    if not missed:
        met, missed = clocks_met(design, (folder / f"seed-{seed}.log").read_text())
    row: dict[str, Any] = {"board": design.board.name, "display": design.display.name, "seed": seed}
    for role, target in design.clocks_mhz.items():
        mhz = met.get(role)
        row |= {f"{role}_asked_mhz": round(target, 2), f"{role}_mhz": mhz}
        row[f"{role}_ratio"] = None if mhz is None else round(mhz / target, 3)
    report = flow.read_kept(folder / f"seed-{seed}.report.json")
    row |= {} if report is None else flow.resources(report)
    return row | {"seconds": run["seconds"], "missed": "; ".join(missed)}


def clocks_met(design: Plan, output: str) -> tuple[dict[str, float], list[str]]:
    """Return each clock role's MHz after routing, and a line per wrong or missed clock, from nextpnr's output."""
    last = flow.clocks(output)
    roles: dict[str, str] = {}
    missed = []
    for clock, (_, constraint) in last.items():
        net = clock.removeprefix("$glbnet$").rsplit(".", 1)[-1].removesuffix("_o")
        role = CLOCK_NETS.get(net, "oscillator")
        target = 0.0 if role in roles else design.clocks_mhz.get(role, 0.0)
        if abs(constraint - target) <= ROUNDING * target:
            roles[role] = clock
        else:
            what = f"the {role} clock is {target:g} MHz" if target else "is not one of the board's clocks"
            missed.append(f"clock {clock} is constrained to {constraint:g} MHz, and {what}")
    for role, mhz in design.clocks_mhz.items():
        if role not in roles:
            missed.append(f"nextpnr reports no {role} clock")
        elif last[roles[role]][0] < mhz:
            missed.append(f"{role} {last[roles[role]][0]:.1f} of {mhz:.1f} MHz")
    if {"shift", "system"} <= roles.keys():
        ends = rf"posedge {re.escape(roles['system'])}\s+-> posedge {re.escape(roles['shift'])}\s*: ([\d.]+) ns"
        delays = re.findall(rf"Max delay {ends}", output)
        limit = SYMBOL_CLOCKS * 1000 / design.clocks_mhz["shift"]
        if not delays or float(delays[-1]) > limit:
            delay = delays[-1] if delays else "an unknown time"
            missed.append(f"symbols take {delay} of {limit:.2f} ns to the shift clock")
    return {role: last[clock][0] for role, clock in roles.items()}, missed


def pack(design: Plan, seed: int) -> Path:
    """Pack a seed's configuration into a bitstream, with board and display in its header; return the path."""
    folder = _work_folder(design)
    lines = (folder / f"seed-{seed}.config").read_text().splitlines(keepends=True)
    identity = folder.name.rpartition("-")[2]
    text = comment(design.board.name, design.display.name, design.display.identity, identity, seed)
    lines.insert(1, f".comment {text}\n")
    configuration, packed = folder / "packed.config", folder / "packed.bit"
    configuration.write_text("".join(lines))
    run_tool(["yowasp-ecppack", "--compress", configuration, packed])
    bit = repository() / "build" / "bitstream" / f"{design.name}.bit"
    with replacing(bit) as partial:
        partial.write_bytes(sealed(packed.read_bytes()))
    return bit.relative_to(repository())


def page(origin: Mapping[str, str], rows: Sequence[Mapping[str, Any]]) -> Page:
    """Return the page of all seeds' figures."""
    labels = [f"{row['board']} {row['display']} {row['seed']}" for row in rows]
    charts = {
        f"{role}: met / asked": [row.get(f"{role}_ratio") or 0.0 for row in rows]
        for role in ("shift", "system", "memory")
    }
    plot = draw_bar_charts("bitstream", labels, charts)
    return make_page("bitstream", origin, [plot], {"bitstream": rows}, {"rows": rows})


def describe(row: Mapping[str, Any]) -> list[str]:
    """Return lines that describe a seed's row: each clock's target and result, then the cells."""
    clocks = [key.removesuffix("_asked_mhz") for key in row if key.endswith("_asked_mhz")]
    lines = [f"{row['board']}, {row['display']}, seed {row['seed']}, {row['seconds']:.0f} s"]
    for clock in clocks:
        met = row[f"{clock}_mhz"]
        lines.append(f"  {clock:<12}{row[f'{clock}_asked_mhz']:8.2f} MHz asked{met or math.nan:9.2f} MHz met")
    cells = [f"{row[name]} {name.upper()}" for name in ("lut", "ff", "dp16kd", "mult18x18d", "ramw") if name in row]
    lines += [f"  {', '.join(cells)}"] if cells else []
    return lines + ([f"  not met: {row['missed']}"] if row["missed"] else [])


def _seeds(text: str) -> list[int]:
    try:
        seeds = [int(word) for word in re.split(r"[,\s]+", text.strip())]
    except ValueError:
        raise input_error("--seeds", f"'{text}' is not a list of numbers", "give a list such as 1,2,3") from None
    if len(set(seeds)) < len(seeds):
        raise input_error("--seeds", f"'{text}' contains a number twice", "give each number once")
    for seed in seeds:
        if not 0 <= seed <= MAX_SEED:
            raise input_error("--seeds", f"{seed} is out of range", f"give numbers from 0 to {MAX_SEED}")
    return seeds


#: Arguments of `option` for options that may be repeated.
REPEATED: Any = {"kind": str, "multiple": True, "show_default": True}


@program
def main(
    boards: tuple[str, ...] = option("Folder of a board in rtl/board/.", ("ulx3s",), flag="--board", **REPEATED),
    displays: tuple[str, ...] = option("Display file.", (VGA,), flag="--display", **REPEATED),
    seeds: tuple[str, ...] = option(
        "List of nextpnr's seeds; give one list, or one per bitstream.", (SEEDS,), **REPEATED
    ),
    patience: int = option("Time limit of each seed, minutes.", PATIENCE_MIN, click.IntRange(1, 1440)),
    layers: int = option("Number of layers that the board draws.", 4, click.IntRange(0, 8)),
    bilinear: bool = option("Interpolate texels bilinearly.", False),
    every: bool = option("Route every seed, even after one met all clocks.", False),
    report: str | None = option("Folder for a page with the figures of every seed.", None),
) -> None:
    """Make the bitstream of an FPGA board for a display, into build/bitstream/.

    The environment variable NEXTPNR can give the path of a nextpnr-ecp5 other than PyPI's.

    Example: python -m tools.bitstream --board ulx3s --display scenes/displays/hd-square.toml
    """
    if bilinear and not layers:
        raise InputError("--bilinear with --layers 0: nothing is drawn; omit one of these options")
    if report is not None:
        check_output(Path(report) / "bitstream.md", (".md",))
    numbers = [_seeds(text) for text in seeds]
    plans = [plan(fpga_board(board), load_display(path), layers, bilinear) for board in boards for path in displays]
    names = [design.name for design in plans]
    if double := next((name for name in names if names.count(name) > 1), None):
        raise input_error("--display", f"two bitstreams would be named {double}.bit", "give each display another name")
    if len(numbers) not in (1, len(plans)):
        what = f"is given {len(numbers)} times for {len(plans)} bitstreams"
        raise input_error("--seeds", what, "give --seeds once, or once for each bitstream")
    rows, unmet = [], []
    for design, seeds_of_design in zip(plans, numbers * (len(plans) // len(numbers)), strict=True):
        results = place(design, seeds_of_design, every or report is not None, patience)
        for row in results:
            click.echo("\n".join(describe(row)))
        rows += results
        good = next((row["seed"] for row in results if not row["missed"]), None)
        if good is None:
            unmet.append(design.name)
        else:
            bit = pack(design, good)
            click.echo(f"{bit}: seed {good}; program it with lippmann board program {bit}")
    if report is not None:
        options = (("board", boards), ("display", displays), ("seeds", seeds))
        words = "".join(f" --{name} {value}" for name, values in options for value in values)
        origin = provenance(f"python -m tools.bitstream{words}", (), flow.versions())
        page(origin, rows).write(Path(report))
    if unmet:
        what = f"no seed of {' or '.join(seeds)} meets every clock"
        raise TimingError(f"{', '.join(unmet)}: {what}; try other seeds with --seeds")

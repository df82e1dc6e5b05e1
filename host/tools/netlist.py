"""Compares the simulations of a board's netlist and of its RTL: `python -m tools.netlist`.

yosys makes the netlist of ECP5 cells, which place-and-route reads; Verilator simulates this netlist. Netlist and RTL
get the same packets: every request of the protocol, a streamed frame, and a drawn scene. Every reply and every pixel of
both must be equal. With --board, the netlist is that of a bitstream, including its pins. Pixels are then decoded from
DVI symbols, which must be valid by the standard, and a model of the SDRAM chip checks the data sheet's rules.
"""

from __future__ import annotations

import itertools
import struct
import tempfile
import time
import zlib
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from lippmann.board.board import Board
from lippmann.board.drawn_scene import BLOCK_REQUEST, BLOCKS_REQUEST, SceneBoard
from lippmann.board.fpga_boards import fpga_board
from lippmann.board.packets import BACK, FRONT, REPLY, Kind, packed
from lippmann.board.port import Line
from lippmann.board.session import OPTICS_BASE, SCENE_BASE
from lippmann.board.streaming import TILE_REQUEST
from lippmann.board.tiles import Coded, Coding, Pixels, code_tile, frame_crc, raw_tile
from lippmann.cli.frame import option
from lippmann.cli.output import log
from lippmann.display.description import Display, load_display
from lippmann.errors import LippmannError, input_error
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.drawn_frame import draw
from lippmann.fixed.raster import Raster
from lippmann.fixed.registers import OPTICS_REGISTERS, SCENE_REGISTERS, optics_writes, raster_writes
from lippmann.fixed.scene_build import BLOCK_BYTES, CURVE_SLOT, SceneBuild
from lippmann.fixed.scene_configuration import build_curve_table, slot_bytes
from lippmann.layers.stack import Layer, LayerStack
from lippmann.simulation import virtual_board
from lippmann.simulation.compilation import NETLIST, UNCHECKED, cached_file, verilated
from lippmann.simulation.toolchain import build_folder, needed, repository, rtl_sources
from lippmann.simulation.video_timing import TIMING

from tools import flow
from tools.bitstream import Plan, plan
from tools.crossings import check
from tools.flow import SYNTHESIS, SYNTHESISER, Source, run_tool
from tools.gates import read_netlist
from tools.program import program

#: Time limit for a reply or a frame, s; a netlist is simulated at only some thousand clocks per second.
PATIENCE_S = 1800.0
#: Maximum number of requests without a reply, and number of a layer's texel rows (few, because the line is slow).
AHEAD, ROWS = 4, 16
#: yosys' commands that replace ECP5 cells by models, and flatten the design to one module of single bits. yosys has no
#: models of block memories, multipliers, PLLs and DDR outputs, only their ports; its pin models have no third state.
CELLS = (
    "delete =$paramod*; read_verilog -lib -overwrite +/ecp5/cells_bb.v; "
    "read_verilog -overwrite -nowb -DNO_INCLUDES +/ecp5/cells_sim.v; blackbox TRELLIS_IO"
)
FLAT = "proc; opt -full; flatten; splitnets; opt_clean -purge; rename -hide"
#: The simulated ULX3S board (sim/netlist/ulx3s_pins.sv), and the outputs of its PLL, each with its divider.
PINS_TOP = "ulx3s_pins"
PLL_PORTS = {"pll_clkop": "BackDiv", "pll_clkos": "ShiftDiv", "pll_clkos2": "SystemDiv", "pll_clkos3": "MemoryDiv"}
#: Top module, video output and memory grade of the boards whose pins sim/netlist/ can simulate.
SIMULATED = ("lipp_ulx3s", "dvi", "Grade75")
#: The virtual board's scene build, which has few texels to load.
SCENE = SceneBuild(layers=2, slots=2, width=64, height=32)

#: Minimum and maximum (None: no limit) of each counter of a correct board. The virtual board also has the counters in
#: `VIRTUAL`, a board with pins those in `PINS`. The reset at a run's end breaks the video timing, and may truncate a
#: frame.
COUNTED = {
    "clocks": (1, None), "seconds": (0, None), "processor_seconds": (0, None), "bytes_in": (1, None),
    "bytes_out": (1, None), "frames": (1, None), "broken_frames": (0, 1), "bytes_lost": (0, 0),
}  # fmt: skip
VIRTUAL = {"memory_violations": (0, 0)}
#: The serialiser aligns with the first symbol after power-up, and may truncate a symbol. By the standard, a channel's
#: disparity since the last control symbol is at most 8. `led` shows the last request, and has no limit.
PINS = {
    "symbol_slips": (0, 1), "bad_symbols": (0, 0), "illegal_symbols": (0, 0), "largest_disparity": (1, 8),
    "timing_breaks": (1, 1), "sdram_reads": (1, None), "sdram_writes": (1, None), "sdram_violations": (0, 0),
    "led": (0, None),
}  # fmt: skip


class NetlistError(LippmannError):
    """A netlist's replies or pixels differ from those of its RTL."""

    exit_code = 4


# ---- from RTL to a program ----


def synthesised(source: Source, name: str) -> Path:
    """Return the path of a design's netlist (yosys' JSON), which is cached."""

    def make(path: Path) -> None:
        flow.synthesise(source, path, build_folder() / "netlist" / "yosys.log")

    inputs: list[Path | str] = [*source.files, source.commands, SYNTHESIS, version(SYNTHESISER)]
    return cached_file(build_folder() / "netlist" / name, inputs, make, ".json")


def simulated(netlist: Path, top: str) -> list[Path]:
    """Return the files with which Verilator simulates a netlist: models of its blocks, and the netlist as Verilog."""

    def make(path: Path) -> None:
        source, written = (str(one.relative_to(repository())) for one in (netlist, path))
        script = f"read_json {source}; {CELLS}; hierarchy -check -top {top}; {FLAT}; write_verilog -noattr {written}"
        run_tool([SYNTHESISER, "-q", "-p", script])

    written = cached_file(netlist.with_suffix(""), [netlist, CELLS, FLAT, version(SYNTHESISER)], make, ".v")
    return [repository() / "sim" / "netlist" / "ecp5_blocks.sv", written]


@dataclass(frozen=True)
class Program:
    """The simulation program of a board, and its options for `virtual_board.running`."""

    path: Path
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Boards:
    """A board as RTL and as netlist: display, builds of scene and optics, both programs, and the netlist of `top`."""

    display: Display
    scene: SceneBuild | None
    build: Build
    rtl: Program
    netlist: Program
    json: Path
    top: str
    timed: tuple[str, ...]

    @classmethod
    def virtual(cls, display: Display, scene: SceneBuild | None, memory: virtual_board.Memory) -> Boards:
        """Return the virtual board on a line without a speed limit; it stores frames in block RAM or in an SDRAM."""
        top = f"lipp_board_with_{'sdram' if memory == 'sdram' else 'store'}"
        build = virtual_board.board_build(display, scene)
        parameters = virtual_board.board_parameters(display, build, True, virtual_board.CLOCK_HZ, scene, memory)
        source = Source(top, parameters, flow.ecp5_files(top))
        netlist = synthesised(source, f"board-{memory}-{display.panel.width_px}x{display.panel.height_px}")
        rtl = Program(virtual_board.compiled(display, build, True, scene=scene))
        files = simulated(netlist, top)
        program = virtual_board.compiled(display, build, True, scene=scene, memory=memory, netlist=files)
        # The crossing check accepts all pins, because the simulation changes them with the clock.
        return cls(display, scene, build, rtl, Program(program), netlist, top, ("*",))

    @classmethod
    def of_bitstream(cls, design: Plan) -> Boards:
        """Return a bitstream's board with the parts at its pins: PLL, serial line, SDRAM chip and DVI socket."""
        netlist = synthesised(design.source, design.name)
        options = {"baud": design.board.baud, "clock_hz": round(design.pll.clocks_mhz["system"] * 1_000_000)}
        program, rtl = Program(on_pins(design, netlist), options), Program(on_pins(design), options)
        top = design.board.top
        return cls(design.display, design.scene, design.build, rtl, program, netlist, top, ("sdram_d*",))


def on_pins(design: Plan, netlist: Path | None = None) -> Path:
    """Return the program that simulates a bitstream's netlist (None: its RTL) and the parts around the FPGA."""
    files, parameters, options = pins_source(design, netlist)
    panel, divider = design.display.panel, design.pll.parameters
    clocks = (f"X({port}, {divider[role]})" for port, role in PLL_PORTS.items())
    defines = [
        "-O2" if netlist is None else "-O1", "-march=native",
        f"-DLIPPMANN_WIDTH={panel.width_px}", f"-DLIPPMANN_HEIGHT={panel.height_px}",
        f"-DLIPPMANN_TIMING={','.join(str(design.parameters[name]) for name in TIMING)}",
        f"-DLIPPMANN_VCO_KHZ={int(design.pll.vco_mhz * 1000)}", f"-DLIPPMANN_CLOCKS={' '.join(clocks)}",
    ]  # fmt: skip
    around = [path for path in sorted((repository() / "sim" / "board").iterdir()) if path.stem != "main"]
    pins = repository() / "sim" / "netlist" / "ulx3s.cpp"
    main = [pins, *(path for path in around if path.suffix == ".cpp")]

    def make(path: Path) -> None:
        verilated(path, PINS_TOP, files, main, parameters, options=options, flags=defines, link=["-lutil"])

    inputs: list[Path | str] = [*files, *main, *around, pins.with_name("dvi.h"), *defines, *options]
    kind = "rtl" if netlist is None else "netlist"
    name = build_folder() / "netlist" / f"{design.name}-{kind}"
    return cached_file(name, [*inputs, repr(sorted(parameters.items()))], make)


def pins_source(design: Plan, netlist: Path | None) -> tuple[list[Path], dict[str, str | int], list[str]]:
    """Return what Verilator needs for `on_pins`: files, parameters of the top module, and options."""
    top = repository()
    wrapper = top / "sim" / "netlist" / "ulx3s_pins.sv"
    options = [*UNCHECKED, "-Wno-lint", "-Wno-style", "-Wno-PINMISSING", "--pins-inout-enables"]
    if netlist is not None:
        return [*simulated(netlist, design.board.top), wrapper], {}, [*options, *NETLIST, "-DLIPPMANN_NETLIST"]
    own = [path for folder in design.board.folders for path in sorted(folder.glob("*.sv"))]
    modules = needed(design.board.top, {path.stem: path for path in [*rtl_sources(top), *own]})
    parameters = {name: value for name, value in design.parameters.items() if name != "Timing"}
    return [top / "rtl" / "registers" / "lint.vlt", *modules, wrapper], parameters, [*options, "-Wno-fatal"]


# ---- the same packets for netlist and RTL ----


class Reply(NamedTuple):
    """A request (kind, body), and its reply (status, rest of the body)."""

    kind: int
    request: bytes
    status: int
    body: bytes


class Patient(Board):
    """A slow board, to which each request is sent only once; `replies` has all replies in order."""

    def __init__(self, line: Line, patience_s: float = PATIENCE_S) -> None:
        self.replies: list[Reply] = []
        super().__init__(line, patience_s)

    def call(self, kind: int, body: bytes = b"", seq: int | None = None, keep: bool = True) -> Reply:
        """Send a request, and return its reply."""
        seq = self.next_seq() if seq is None else seq
        self.line.send(packed(kind, seq, body), self.patience_s)
        return self._take(kind, seq, body, keep)

    def call_all(self, kind: int, bodies: Iterable[bytes]) -> None:
        """Send requests, with at most `AHEAD` of them unanswered; replies arrive in the requests' order."""
        ahead: deque[tuple[int, bytes]] = deque()
        for body in bodies:
            if len(ahead) == AHEAD:
                self._take(kind, *ahead.popleft())
            ahead.append((self.next_seq(), body))
            self.line.send(packed(kind, *ahead[-1]), self.patience_s)
        while ahead:
            self._take(kind, *ahead.popleft())

    def _take(self, kind: int, seq: int, body: bytes, keep: bool = True) -> Reply:
        until = time.monotonic() + self.patience_s
        while time.monotonic() < until:
            reply = self.line.receive(until - time.monotonic())
            if reply and reply.kind == kind | REPLY and reply.seq == seq and reply.body:
                answer = Reply(kind, body, reply.body[0], reply.body[1:])
                self.replies += [answer] if keep else []
                return answer
        raise self.silence()

    def request(self, kind: Kind, body: bytes, work_s: float = 0.0, seq: int | None = None) -> tuple[int, bytes]:
        """Send a request once, and wait for its reply."""
        # Do not keep the reply to a HELLO, because it has a random nonce.
        reply = self.call(kind, body, seq, keep=kind != Kind.HELLO)
        return reply.status, reply.body


@dataclass(frozen=True)
class Run:
    """The result of a board's run: the replies, the frames that the panel showed, and the counters."""

    replies: list[Reply]
    frames: list[bytes]
    counts: Mapping[str, Any]


def run_board(boards: Boards, program: Program, picture: Pixels, stack: LayerStack | None, drawn: bytes | None) -> Run:
    """Send every request to a board, stream a picture, and draw a stack, whose expected pixels are `drawn`."""
    display = boards.display
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        options = {"capture": folder, "scene": boards.scene, "program": program.path, **program.options}
        with virtual_board.running(display, **options) as board:
            with Patient.open(board.url, patience_s=PATIENCE_S) as link:
                _ask_registers(link, display)
                _ask_rays(link, display)
                _stream(link, picture)
                _wait_for(folder, picture.tobytes())
                _ask_wrongly(link)
                if stack is not None and drawn is not None:
                    _draw(link, display, stack)
                    _wait_for(folder, drawn)
                    link.write(SCENE_BASE + SCENE_REGISTERS["source"].address, [0])
                link.call(Kind.RESET)
                link.call(Kind.TILES, struct.pack("<BHH", FRONT, 0, 1))
                replies = link.replies
            counts = board.stop()
        return Run(replies, [path.read_bytes() for path in sorted(folder.glob("frame-*.rgb"))], counts)


def _wait_for(folder: Path, frame: bytes) -> None:
    until = time.monotonic() + PATIENCE_S
    while not any(path.read_bytes() == frame for path in folder.glob("frame-*.rgb")):
        if time.monotonic() > until:
            raise NetlistError(f"a frame did not appear within {PATIENCE_S:g} s; look at the frames in {folder}")
        time.sleep(0.05)


def _ask_registers(link: Patient, display: Display) -> None:
    """Read all registers that the board does not change by itself, and write the optics' registers."""
    link.call(Kind.READ, struct.pack("<HB", 0, 1))
    for base, last in ((OPTICS_BASE, 0x1C0), (SCENE_BASE, 0x40)):
        if base == OPTICS_BASE or link.info.version == 3:
            for first in range(base, base + last, 256):
                link.call(Kind.READ, struct.pack("<HB", first, min(64, (base + last - first) // 4)))
    build = link.optics_build()
    config = configuration(display, build, build.model)
    panel = display.panel
    window = Raster(panel.width_px, panel.height_px, (1, min(24, panel.width_px - 1)), (0, 7), samples=2, seed=7)
    link.write_all([*optics_writes(config), *raster_writes(window)])
    link.write(OPTICS_BASE + OPTICS_REGISTERS["control"].address, [1])
    for first in range(OPTICS_BASE, OPTICS_BASE + 0x1C0, 256):
        link.call(Kind.READ, struct.pack("<HB", first, 48))


def _ask_rays(link: Patient, display: Display) -> None:
    """Request a trace of rays from all over the panel, the signature of a window's rays, and an abort."""
    rng = np.random.default_rng(3)
    panel = display.panel
    rays = np.zeros((64, 4), "<i4")
    rays[:, 0] = rng.integers(-8 * panel.width_px, 8 * panel.width_px, 64)
    rays[:, 1] = rng.integers(-8 * panel.height_px, 8 * panel.height_px, 64)
    link.call(Kind.TRACE, rays.tobytes())
    seq = link.next_seq()
    while link.call(Kind.SIGN, b"", seq, keep=False).status == 10:
        time.sleep(0.02)
    link.call(Kind.SIGN, b"", seq)
    link.call(Kind.ABORT)


def _stream(link: Patient, picture: Pixels) -> None:
    """Send and show a picture in tiles of every coding, then again with all tiles copied."""
    grid, epoch = link.info.grid, link.info.epoch
    for turn in range(2):
        tiles = [grid.cut(picture, tile) for tile in range(grid.count)]
        codes = [Coded(Coding.COPY, b"")] * grid.count if turn else [raw_tile(tiles[0]), *map(code_tile, tiles[1:])]
        link.call_all(
            Kind.TILE, (TILE_REQUEST.pack(epoch + turn, tile, one.coding) + one.data for tile, one in enumerate(codes))
        )
        for first in range(0, grid.count, 512):
            link.call(Kind.TILES, struct.pack("<BHH", BACK, first, min(512, grid.count - first)))
        link.call(Kind.PRESENT, struct.pack("<HI", epoch + turn, frame_crc(picture)))


def _ask_wrongly(link: Patient) -> None:
    link.call(Kind.HELLO, struct.pack("<BI", 9, 1))
    link.call(0x6F, b"?")
    link.call(Kind.READ, b"\0")
    link.call(Kind.READ, struct.pack("<HB", 0x100, 1))
    link.call(Kind.TILE, TILE_REQUEST.pack(0x1234, 0, Coding.SOLID) + b"\1\2\3")
    link.call(Kind.TILE, TILE_REQUEST.pack(link.info.epoch + 2, 0, Coding.RAW) + b"\1\2\3")
    link.call(Kind.TILE, TILE_REQUEST.pack(link.info.epoch + 2, 0xFFFF, Coding.SOLID) + b"\1\2\3")
    link.call(Kind.PRESENT, struct.pack("<HI", link.info.epoch + 2, 0x12345678))


def _draw(link: Patient, display: Display, stack: LayerStack) -> None:
    """Load a stack of layers, and switch drawing on."""
    scene = SceneBoard(link)
    contents = {CURVE_SLOT: build_curve_table(display).tobytes()}
    contents |= {slot: slot_bytes(layer, scene.build).tobytes() for slot, layer in enumerate(stack.layers)}
    for slot, content in contents.items():
        blocks = [content[at : at + BLOCK_BYTES] for at in range(0, len(content), BLOCK_BYTES)]
        loaded = (BLOCK_REQUEST.pack(slot, block) + part for block, part in enumerate(blocks) if any(part))
        link.call_all(Kind.BLOCK, loaded)
        answer = link.call(Kind.BLOCKS, BLOCKS_REQUEST.pack(slot, 0, len(blocks))).body[2:]
        crcs = [zlib.crc32(part) if any(part) else 0 for part in blocks]
        if answer != struct.pack(f"<{len(blocks)}I", *crcs):
            raise NetlistError(f"the board reports wrong CRCs for the blocks of slot {slot}; check lipp_slot_loader")
    scene.prepare(display, stack)
    link.write(SCENE_BASE + SCENE_REGISTERS["source"].address, [1])


def small(display: Display, width: int, height: int) -> Display:
    """Return the display with another panel size."""
    panel = replace(display.panel, width_px=width, height_px=height)
    return replace(display, name=f"{display.name} {width} x {height}", panel=panel)


def picture_for(display: Display, seed: int = 1) -> Pixels:
    """Return a picture that needs every coding: most tiles have one colour, some a gradient, a few noise."""
    rng = np.random.default_rng(seed)
    height, width = display.panel.height_px, display.panel.width_px
    picture = np.zeros((height, width, 3), np.uint8)
    down, across = np.mgrid[0:height, 0:width]
    picture[..., 0], picture[..., 1], picture[..., 2] = across // 4, down // 4, (across + down) // 8
    for number, (y, x) in enumerate(itertools.product(range(0, height, 32), range(0, width, 32))):
        place = picture[y : y + 32, x : x + 32]
        if number % 150 == 2:
            place[:] = rng.integers(0, 256, place.shape)
        elif number % 40 != 3:
            place[:] = rng.integers(0, 256, 3)
    return picture


def stack_for(display: Display, build: SceneBuild, seed: int = 1) -> LayerStack:
    """Return layers behind and in front of the panel, with only `ROWS` rows of texels, so that they load quickly."""
    rng = np.random.default_rng(seed)
    size = np.array([display.panel.width_mm, display.panel.height_mm])
    layers = []
    for depth, scale in ((-6.0, 1.3), (4.0, 0.8))[: build.layers]:
        palette = rng.integers(0, 256, (256, 4), np.uint8)
        palette[:64, 3] = 0
        texels = np.zeros((build.height, build.width), np.uint8)
        texels[:ROWS] = rng.integers(0, 256, (ROWS, build.width))
        linear = np.diag([build.width, -ROWS] / (size * scale)) @ np.array([[1.0, 0.1], [-0.05, 1.0]])
        matrix = np.column_stack([linear, np.array([build.width, ROWS]) / 2])
        layers.append(Layer(texels, palette, depth, matrix, 0.9))
    return LayerStack(tuple(layers), np.array([0.1, 0.2, 0.3]))


class Comparison(NamedTuple):
    """Counts of a comparison: compared pixels, differing pixels, replies, and kinds of requests."""

    pixels: int
    differ: int
    replies: int
    kinds: int


def compare(boards: Boards) -> tuple[Comparison, Run, Run]:
    """Run netlist and RTL; compare them with each other and the twin; raise NetlistError if a reply differs."""
    display, scene = boards.display, boards.scene
    picture = picture_for(display)
    stack = None if scene is None else stack_for(display, scene)
    drawn = None if scene is None or stack is None else draw(display, boards.build, stack, scene).tobytes()
    rtl, netlist = (run_board(boards, program, picture, stack, drawn) for program in (boards.rtl, boards.netlist))
    for one, other in zip(netlist.replies, rtl.replies, strict=False):
        if one != other:
            what = f"request {one.kind:02x} {one.request[:8].hex()} is answered {one.status} {one.body[:16].hex()}"
            raise NetlistError(f"{what} by the netlist, {other.status} {other.body[:16].hex()} by the RTL")
    if len(netlist.replies) != len(rtl.replies):
        raise NetlistError(f"the netlist answers {len(netlist.replies)} requests, but the RTL {len(rtl.replies)}")
    differ = pixels = 0
    others = [np.frombuffer(frame, np.uint8).reshape(-1, 3) for frame in rtl.frames]
    for frame in netlist.frames:
        values = np.frombuffer(frame, np.uint8).reshape(-1, 3)
        differ += min(int((values != other).any(axis=1).sum()) for other in others)
        pixels += len(values)
    missing = len(set(rtl.frames) - set(netlist.frames))
    if missing:
        raise NetlistError(f"the netlist does not show {missing} frames that the RTL shows")
    kinds = len({reply.kind for reply in netlist.replies})
    return Comparison(pixels, differ, len(netlist.replies), kinds), netlist, rtl


def wrong_counts(counts: Mapping[str, Any]) -> list[str]:
    """Return a message for each counter of a run that exceeds its limits, is missing, or has no limits."""
    limits = COUNTED | (PINS if PINS.keys() & counts.keys() else VIRTUAL)
    wrong = [f"{name} is not counted" for name in limits if name not in counts]
    for name, value in counts.items():
        if name not in limits:
            wrong.append(f"{name} is {value}; add its limits to netlist.py")
            continue
        number = sum(value.values()) if isinstance(value, Mapping) else value
        low, high = limits[name]
        if number < low or (high is not None and number > high):
            right = f"at least {low}" if high is None else high if low == high else f"{low} to {high}"
            wrong.append(f"{name} is {value}, on a correct board {right}")
    return wrong


@program
def main(
    board: str | None = option("Board of a bitstream, such as ulx3s.  [default: the virtual board]", None),
    memory: virtual_board.Memory | None = option("Frame memory of the virtual board.  [default: sdram]", None),
    path: str = option("Display file.", "scenes/displays/vga-square.toml", flag="--display"),
    size: tuple[int, int] | None = option("Panel size, px.  [default: display's]", None, click.IntRange(8), nargs=2),
    layers: int = option("Number of layers that the bitstream draws.", 4, click.IntRange(0, 8)),
) -> None:
    """Synthesise a board, simulate its netlist and its RTL, and compare replies and pixels.

    Counters are checked too, such as violations of the SDRAM's data sheet. The program exits with code 4 on a
    difference.

    Example: python -m tools.netlist --board ulx3s
    """
    if board is not None and memory is not None:
        raise input_error("--memory", f"{board} stores frames in its SDRAM", "omit --memory or --board")
    fpga = None if board is None else fpga_board(board)
    if fpga is not None and (own := (fpga.top, fpga.video, fpga.memory.grade)) != SIMULATED:
        what = f"it has {', '.join(own)}; simulation needs {', '.join(SIMULATED)}"
        raise input_error(f"--board {board}", what, "choose ulx3s, or omit --board")
    display = load_display(path)
    display = small(display, *size) if size else display
    if fpga is None:
        boards = Boards.virtual(display, SCENE, memory or "sdram")
    else:
        boards = Boards.of_bitstream(plan(fpga, display, layers))
    check(read_netlist(boards.json, boards.top), boards.timed).report()
    log(f"simulating {boards.netlist.path.name} and {boards.rtl.path.name}")
    result, netlist, rtl = compare(boards)
    wrong = [f"{result.differ} pixels differ from the RTL's"] if result.differ else []
    for name, run in (("netlist", netlist), ("RTL", rtl)):
        wrong += [f"{name}: {one}" for one in wrong_counts(run.counts)]
        clocks, seconds = float(run.counts["clocks"]), float(run.counts["processor_seconds"])
        click.echo(f"{name}: {clocks:.0f} clocks, {clocks / seconds:.0f} per CPU second")
    click.echo(f"{result.replies} replies to {result.kinds} kinds of requests equal the RTL's")
    click.echo(f"{result.pixels} pixels compared, {result.differ} differ")
    if wrong:
        raise NetlistError("; ".join(wrong))

"""Simulates a board's netlist against its RTL: `python -m tools.netlist`.

yosys makes the netlist of ECP5's cells that place-and-route gets. Verilator simulates it, and both the netlist and the
RTL get the same packets: every request of the protocol, a streamed frame, and a scene that is drawn. Every reply and
every pixel that the panel shows must be the same. With --board the netlist is that of a bitstream, with its pins:
the pixels are those of the DVI symbols, each of which must be the one that the standard has there, and a model of the
SDRAM chip checks the data sheet.
"""

from __future__ import annotations

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
from lippmann.board.session import OPTICS_BASE, SCENE_BASE
from lippmann.board.streaming import TILE_REQUEST
from lippmann.board.tiles import Coded, Coding, code_tile, frame_crc, raw_tile
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
from lippmann.simulation.virtual_board import TIMING

from tools import flow
from tools.bitstream import Plan, plan
from tools.crossings import CrossingError, check
from tools.flow import SYNTHESIS, SYNTHESISER, Source, run_tool
from tools.gates import read_netlist
from tools.program import program

Pixels = np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]

#: Longest wait for a reply and for a frame, s: a netlist is simulated at some thousand clocks a second.
PATIENCE_S = 1800.0
#: Requests that are sent ahead of the replies.
AHEAD = 4
#: Rows of texels that a drawn layer needs: few bytes for a slow line.
ROWS = 16
#: yosys' commands that put its own models of ECP5's cells in their place, and make one module of single bits. It has
#: only the ports of block memories, multipliers, PLLs and DDR outputs, and no third state of a pin.
CELLS = (
    "delete =$paramod*; read_verilog -lib -overwrite +/ecp5/cells_bb.v; "
    "read_verilog -overwrite -nowb -DNO_INCLUDES +/ecp5/cells_sim.v; blackbox TRELLIS_IO"
)
FLAT = "proc; opt -full; flatten; splitnets; opt_clean -purge; rename -hide"
#: The simulated ULX3S (sim/netlist/ulx3s_pins.sv), and the outputs of its PLL with their dividers.
PINS_TOP = "ulx3s_pins"
PLL_PORTS = {"pll_clkop": "BackDiv", "pll_clkos": "ShiftDiv", "pll_clkos2": "SystemDiv", "pll_clkos3": "MemoryDiv"}
#: Top, video and memory's grade of the boards whose pins sim/netlist/ simulates.
SIMULATED = ("lipp_ulx3s", "dvi", "Grade75")
#: The scene of the virtual board: few texels, which are soon loaded.
SCENE = SceneBuild(layers=2, slots=2, width=64, height=32)

#: What a right board counts in a run, least and most; None: any number. Each board counts these, the virtual one those
#: of `VIRTUAL` too, a board with its pins those of `PINS`. The reset at the end of `tell` begins a frame anew: that
#: breaks the timing, and cuts a frame unless it comes between two.
COUNTED = {
    "clocks": (1, None), "seconds": (0, None), "processor_seconds": (0, None), "bytes_in": (1, None),
    "bytes_out": (1, None), "frames": (1, None), "broken_frames": (0, 1), "bytes_lost": (0, 0),
}  # fmt: skip
VIRTUAL = {"memory_violations": (0, 0)}
#: The serialiser finds its place with the first symbol after power-up, which may cut one short. By the standard's rule
#: the ones that a channel has sent since the last control symbol are at most 8 more than the zeros, or fewer. `led`
#: shows what was asked for last, and is not judged.
PINS = {
    "symbol_slips": (0, 1), "bad_symbols": (0, 0), "illegal_symbols": (0, 0), "largest_disparity": (1, 8),
    "timing_breaks": (1, 1), "sdram_reads": (1, None), "sdram_writes": (1, None), "sdram_violations": (0, 0),
    "led": (0, None),
}  # fmt: skip


class NetlistError(LippmannError):
    """A netlist does not do what its RTL does."""

    exit_code = 4


# ---- from RTL to a program ----


def synthesised(source: Source, name: str) -> Path:
    """Return the netlist of a design as yosys' JSON, made unless it is there."""

    def make(path: Path) -> None:
        flow.synthesise(source, path, build_folder() / "netlist" / "yosys.log")

    inputs: list[Path | str] = [*source.files, source.commands, SYNTHESIS, version(SYNTHESISER)]
    return cached_file(build_folder() / "netlist" / name, inputs, make, ".json")


def simulated(netlist: Path, top: str) -> list[Path]:
    """Return the files that Verilator reads for a netlist: the models of blocks, and the netlist as Verilog."""

    def make(path: Path) -> None:
        source, written = (str(one.relative_to(repository())) for one in (netlist, path))
        script = f"read_json {source}; {CELLS}; hierarchy -check -top {top}; {FLAT}; write_verilog -noattr {written}"
        run_tool([SYNTHESISER, "-q", "-p", script])

    written = cached_file(netlist.with_suffix(""), [netlist, CELLS, FLAT, version(SYNTHESISER)], make, ".v")
    return [repository() / "sim" / "netlist" / "ecp5_blocks.sv", written]


@dataclass(frozen=True)
class Program:
    """A board's program, and the options with which it starts (`virtual_board.start`)."""

    path: Path
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Boards:
    """A board as RTL and as a netlist: display, scene and optics, both programs, and yosys' netlist of `top`."""

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
        """Return the virtual board on a byte line, with its frames in block RAM or in an SDRAM."""
        top = f"lipp_board_with_{'sdram' if memory == 'sdram' else 'store'}"
        build = virtual_board.board_build(display, scene)
        parameters = virtual_board.board_parameters(display, build, True, virtual_board.CLOCK_HZ, scene, memory)
        panel = display.panel
        source = Source(top, parameters, flow.ecp5_files(top))
        netlist = synthesised(source, f"board-{memory}-{panel.width_px}x{panel.height_px}")
        rtl = virtual_board.compiled(display, build, True, scene=scene)
        program = virtual_board.compiled(
            display, build, True, scene=scene, memory=memory, netlist=simulated(netlist, top)
        )
        # Its pins are the simulation's: they change with the clock.
        return cls(display, scene, build, Program(rtl), Program(program), netlist, top, ("*",))

    @classmethod
    def of_bitstream(cls, made: Plan) -> Boards:
        """Return a board with its pins: PLL, serial line, SDRAM chip and DVI socket."""
        clock_hz = round(made.pll.clocks_mhz["system"] * 1_000_000)
        netlist = synthesised(made.source, made.name)
        options = {"baud": made.board.baud, "clock_hz": clock_hz}
        program, rtl = Program(on_pins(made, netlist), options), Program(on_pins(made), options)
        timed = ("sdram_d*",)
        return cls(made.display, made.scene, made.build, rtl, program, netlist, made.board.top, timed)


def on_pins(made: Plan, netlist: Path | None = None) -> Path:
    """Return the program of a bitstream with what is around it on the board: of its netlist, or else of its RTL."""
    files, parameters, options = pins_source(made, netlist)
    panel, divider = made.display.panel, made.pll.parameters
    clocks = (f"X({port}, {divider[role]})" for port, role in PLL_PORTS.items())
    defines = [
        "-O2" if netlist is None else "-O1", "-march=native",
        f"-DLIPPMANN_WIDTH={panel.width_px}", f"-DLIPPMANN_HEIGHT={panel.height_px}",
        f"-DLIPPMANN_TIMING={','.join(str(made.parameters[name]) for name in TIMING)}",
        f"-DLIPPMANN_VCO_KHZ={int(made.pll.vco_mhz * 1000)}", f"-DLIPPMANN_CLOCKS={' '.join(clocks)}",
    ]  # fmt: skip
    around = [path for path in sorted((repository() / "sim" / "board").iterdir()) if path.stem != "main"]
    pins = repository() / "sim" / "netlist" / "ulx3s.cpp"
    main = [pins, *(path for path in around if path.suffix == ".cpp")]

    def make(path: Path) -> None:
        verilated(path, PINS_TOP, files, main, parameters, options=options, flags=defines, link=["-lutil"])

    inputs: list[Path | str] = [*files, *main, *around, pins.with_name("dvi.h"), *defines, *options]
    kind = "rtl" if netlist is None else "netlist"
    name = build_folder() / "netlist" / f"{made.name}-{kind}"
    return cached_file(name, [*inputs, repr(sorted(parameters.items()))], make)


def pins_source(made: Plan, netlist: Path | None) -> tuple[list[Path], dict[str, str | int], list[str]]:
    """Return what Verilator reads for `on_pins`: files, parameters of the top module, and options."""
    top = repository()
    wrapper = top / "sim" / "netlist" / "ulx3s_pins.sv"
    options = [*UNCHECKED, "-Wno-lint", "-Wno-style", "-Wno-PINMISSING", "--pins-inout-enables"]
    if netlist is not None:
        return [*simulated(netlist, made.board.top), wrapper], {}, [*options, *NETLIST, "-DLIPPMANN_NETLIST"]
    own = [path for folder in made.board.folders for path in sorted(folder.glob("*.sv"))]
    modules = needed(made.board.top, {path.stem: path for path in [*rtl_sources(top), *own]})
    parameters = {name: value for name, value in made.parameters.items() if name != "Timing"}
    return [top / "rtl" / "registers" / "lint.vlt", *modules, wrapper], parameters, [*options, "-Wno-fatal"]


# ---- the same packets for both ----


class Reply(NamedTuple):
    """A request and its reply: status and the rest of the body."""

    kind: int
    request: bytes
    status: int
    body: bytes


class Patient(Board):
    """A board that is asked once and waited for, since it is slow; all replies are kept in `replies`."""

    replies: list[Reply]

    def __init__(self, line: object, patience_s: float = PATIENCE_S) -> None:
        """Begin with request 0, so that two boards get the same packets."""
        self.replies = []
        super().__init__(line, patience_s)  # type: ignore[arg-type]

    def put(self, kind: int, body: bytes = b"", seq: int | None = None, keep: bool = True) -> Reply:
        """Send a request, and wait for its reply."""
        seq = self.next_seq() if seq is None else seq
        self.line.send(packed(kind, seq, body), self.patience_s)
        return self._take(kind, seq, body, keep)

    def put_all(self, kind: int, bodies: Iterable[bytes]) -> None:
        """Send requests, some ahead of the replies, which come in the same order."""
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
                found = Reply(kind, body, reply.body[0], reply.body[1:])
                if keep:
                    self.replies.append(found)
                return found
        raise self.silence()

    def request(self, kind: Kind, body: bytes, work_s: float = 0.0, seq: int | None = None) -> tuple[int, bytes]:
        """Send a request once, and wait for its reply."""
        reply = self.put(kind, body, seq, keep=kind != Kind.HELLO)  # a HELLO has a nonce
        return reply.status, reply.body


@dataclass
class Told:
    """What a board did: its replies, the frames that its panel showed, and what it counted."""

    replies: list[Reply]
    frames: list[bytes]
    counts: Mapping[str, Any] = field(default_factory=dict)


def tell(boards: Boards, program: Program, picture: Pixels, stack: LayerStack | None, drawn: bytes | None) -> Told:
    """Send every request to a board, stream a picture and draw a stack; return what it did.

    `drawn` are the pixels of the drawn frame.
    """
    display = boards.display
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        started = virtual_board.running(
            display, capture=folder, scene=boards.scene, program=program.path, **program.options
        )
        with started as board:
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
                link.put(Kind.RESET)
                link.put(Kind.TILES, struct.pack("<BHH", FRONT, 0, 1))
                replies = link.replies
            counts = board.stop()
        return Told(replies, [path.read_bytes() for path in sorted(folder.glob("frame-*.rgb"))], counts)


def _wait_for(folder: Path, frame: bytes) -> None:
    until = time.monotonic() + PATIENCE_S
    while not any(path.read_bytes() == frame for path in folder.glob("frame-*.rgb")):
        if time.monotonic() > until:
            raise NetlistError(f"a frame is not shown within {PATIENCE_S:g} s; look at the frames in {folder}")
        time.sleep(0.05)


def _ask_registers(link: Patient, display: Display) -> None:
    """Read what does not change by itself; write the optics."""
    link.put(Kind.READ, struct.pack("<HB", 0, 1))
    for base, last in ((OPTICS_BASE, 0x1C0), (SCENE_BASE, 0x40)):
        if base == OPTICS_BASE or link.info.version == 3:
            for first in range(base, base + last, 256):
                link.put(Kind.READ, struct.pack("<HB", first, min(64, (base + last - first) // 4)))
    build = link.optics_build()
    config = configuration(display, build, build.model)
    panel = display.panel
    window = Raster(panel.width_px, panel.height_px, (1, min(24, panel.width_px - 1)), (0, 7), samples=2, seed=7)
    link.write_all([*optics_writes(config), *raster_writes(window)])
    link.write(OPTICS_BASE + OPTICS_REGISTERS["control"].address, [1])
    for first in range(OPTICS_BASE, OPTICS_BASE + 0x1C0, 256):
        link.put(Kind.READ, struct.pack("<HB", first, 48))


def _ask_rays(link: Patient, display: Display) -> None:
    """Trace rays all over the panel, sign a window's, and abort."""
    rng = np.random.default_rng(3)
    panel = display.panel
    rays = np.zeros((64, 4), "<i4")
    rays[:, 0] = rng.integers(-8 * panel.width_px, 8 * panel.width_px, 64)
    rays[:, 1] = rng.integers(-8 * panel.height_px, 8 * panel.height_px, 64)
    link.put(Kind.TRACE, rays.tobytes())
    seq = link.next_seq()
    while link.put(Kind.SIGN, b"", seq, keep=False).status == 10:
        time.sleep(0.02)
    link.put(Kind.SIGN, b"", seq)
    link.put(Kind.ABORT)


def _stream(link: Patient, picture: Pixels) -> None:
    """Send a picture's tiles in every coding, and present it; then the same frame as copies."""
    grid, epoch = link.info.grid, link.info.epoch
    for turn in range(2):
        tiles = [grid.cut(picture, tile) for tile in range(grid.count)]
        codes = [Coded(Coding.COPY, b"") if turn else code_tile(pixels) for pixels in tiles]
        codes[0] = codes[0] if turn else raw_tile(tiles[0])
        link.put_all(
            Kind.TILE, (TILE_REQUEST.pack(epoch + turn, tile, one.coding) + one.data for tile, one in enumerate(codes))
        )
        for first in range(0, grid.count, 512):
            link.put(Kind.TILES, struct.pack("<BHH", BACK, first, min(512, grid.count - first)))
        link.put(Kind.PRESENT, struct.pack("<HI", epoch + turn, frame_crc(picture)))


def _ask_wrongly(link: Patient) -> None:
    """Send what a board refuses, each for another reason."""
    link.put(Kind.HELLO, struct.pack("<BI", 9, 1))
    link.put(0x6F, b"?")
    link.put(Kind.READ, b"\0")
    link.put(Kind.READ, struct.pack("<HB", 0x100, 1))
    link.put(Kind.TILE, TILE_REQUEST.pack(0x1234, 0, Coding.SOLID) + b"\1\2\3")
    link.put(Kind.TILE, TILE_REQUEST.pack(link.info.epoch + 2, 0, Coding.RAW) + b"\1\2\3")
    link.put(Kind.TILE, TILE_REQUEST.pack(link.info.epoch + 2, 0xFFFF, Coding.SOLID) + b"\1\2\3")
    link.put(Kind.PRESENT, struct.pack("<HI", link.info.epoch + 2, 0x12345678))


def _draw(link: Patient, display: Display, stack: LayerStack) -> None:
    """Load a stack, and draw it."""
    scene = SceneBoard(link)
    contents = {CURVE_SLOT: build_curve_table(display).tobytes()}
    contents |= {slot: slot_bytes(layer, scene.build).tobytes() for slot, layer in enumerate(stack.layers)}
    for slot, content in contents.items():
        blocks = [content[at : at + BLOCK_BYTES] for at in range(0, len(content), BLOCK_BYTES)]
        loaded = (BLOCK_REQUEST.pack(slot, block) + part for block, part in enumerate(blocks) if any(part))
        link.put_all(Kind.BLOCK, loaded)
        found = link.put(Kind.BLOCKS, BLOCKS_REQUEST.pack(slot, 0, len(blocks))).body[2:]
        crcs = [zlib.crc32(part) if any(part) else 0 for part in blocks]
        if found != struct.pack(f"<{len(blocks)}I", *crcs):
            raise NetlistError(f"the blocks of slot {slot} arrived with other CRCs; look at lipp_slot_loader")
    scene.prepare(display, stack)
    link.write(SCENE_BASE + SCENE_REGISTERS["source"].address, [1])


# ---- pictures ----


def small(display: Display, width: int, height: int) -> Display:
    """Return a display with another size of panel."""
    panel = replace(display.panel, width_px=width, height_px=height)
    return replace(display, name=f"{display.name} {width} x {height}", panel=panel)


def picture_for(display: Display, seed: int = 1) -> Pixels:
    """Return a picture whose tiles need every coding: most of one colour, some of gradients, few of noise."""
    rng = np.random.default_rng(seed)
    height, width = display.panel.height_px, display.panel.width_px
    picture = np.zeros((height, width, 3), np.uint8)
    down, across = np.mgrid[0:height, 0:width]
    picture[..., 0], picture[..., 1], picture[..., 2] = across // 4, down // 4, (across + down) // 8
    for number, (top, left) in enumerate((t, s) for t in range(0, height, 32) for s in range(0, width, 32)):
        place = picture[top : top + 32, left : left + 32]
        if number % 150 == 2:
            place[:] = rng.integers(0, 256, place.shape)
        elif number % 40 != 3:
            place[:] = rng.integers(0, 256, 3)
    return picture


def stack_for(display: Display, build: SceneBuild, seed: int = 1) -> LayerStack:
    """Return layers, one behind and one before the panel, whose texels are in the first rows: they are soon loaded."""
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


# ---- comparison ----


class Compared(NamedTuple):
    """Pixels of the netlist's frames, how many of them differ, replies, and kinds of requests."""

    pixels: int
    differ: int
    replies: int
    kinds: int


def compared(netlist: Told, rtl: Told) -> Compared:
    """Compare a netlist with its RTL; raise NetlistError for the first reply that differs."""
    for one, other in zip(netlist.replies, rtl.replies, strict=False):
        if one != other:
            what = f"request {one.kind:02x} {one.request[:8].hex()} is answered {one.status} {one.body[:16].hex()}"
            raise NetlistError(f"{what}, by the RTL {other.status} {other.body[:16].hex()}")
    if len(netlist.replies) != len(rtl.replies):
        raise NetlistError(f"{len(netlist.replies)} requests are answered, by the RTL {len(rtl.replies)}")
    differ = pixels = 0
    for frame in netlist.frames:
        shown = np.frombuffer(frame, np.uint8).reshape(-1, 3)
        others = [np.frombuffer(other, np.uint8).reshape(-1, 3) for other in rtl.frames]
        differ += min(int((shown != other).any(axis=1).sum()) for other in others)
        pixels += len(shown)
    missing = len(set(rtl.frames) - set(netlist.frames))
    if missing:
        raise NetlistError(f"{missing} frames that the RTL shows are not shown")
    return Compared(pixels, differ, len(netlist.replies), len({reply.kind for reply in netlist.replies}))


def compare(boards: Boards) -> tuple[Compared, Told, Told]:
    """Run both boards, and compare them and the twin; also return what the netlist and the RTL did."""
    display, scene = boards.display, boards.scene
    picture = picture_for(display)
    stack = None if scene is None else stack_for(display, scene)
    drawn = None if scene is None or stack is None else draw(display, boards.build, stack, scene).tobytes()
    rtl, netlist = (tell(boards, program, picture, stack, drawn) for program in (boards.rtl, boards.netlist))
    return compared(netlist, rtl), netlist, rtl


def wrong_counts(counts: Mapping[str, Any]) -> list[str]:
    """Name each counter of a run whose value no right board has, each that is missing, and each without limits."""
    limits = COUNTED | (PINS if PINS.keys() & counts.keys() else VIRTUAL)
    wrong = [f"{name} is not counted" for name in limits if name not in counts]
    for name, value in counts.items():
        if name not in limits:
            wrong.append(f"{name} is {value}, and nothing judges it")
            continue
        number = sum(value.values()) if isinstance(value, Mapping) else value
        least, most = limits[name]
        if number < least or (most is not None and number > most):
            right = f"at least {least}" if most is None else most if least == most else f"{least} to {most}"
            wrong.append(f"{name} is {value}, on a right board {right}")
    return wrong


@program
def main(
    board: str | None = option("Board of a bitstream, such as ulx3s.  [default: the virtual board]", None),
    memory: virtual_board.Memory | None = option("Frames, without --board.  [default: sdram]", None),
    path: str = option("Display file.", "scenes/displays/vga-square.toml", flag="--display"),
    size: tuple[int, int] | None = option("Another size of the panel, pixels.", None, click.IntRange(8), nargs=2),
    layers: int = option("Layers of a bitstream.", 4, click.IntRange(0, 8)),
) -> None:
    """Synthesise a board, simulate its netlist beside its RTL, and compare replies and pixels; exit 4 when they differ.

    What either board counts is judged too, such as violations of the SDRAM's data sheet and illegal symbols of DVI.

    Example: python -m tools.netlist --board ulx3s
    """
    if board is not None and memory is not None:
        raise input_error("--memory", f"{board} has its frames in its SDRAM", "leave out --memory, or --board")
    found = None if board is None else fpga_board(board)
    if found is not None and (own := (found.top, found.video, found.memory.grade)) != SIMULATED:
        what = f"it has {', '.join(own)}; simulated are {', '.join(SIMULATED)}"
        raise input_error(f"--board {board}", what, "take ulx3s, or leave it out")
    display = load_display(path)
    display = small(display, *size) if size else display
    made = None if found is None else plan(found, display, layers)
    boards = Boards.virtual(display, SCENE, memory or "sdram") if made is None else Boards.of_bitstream(made)
    crossings = check(read_netlist(boards.json, boards.top), boards.timed)
    for one in crossings.crossings:
        click.echo(f"{one.source} -> {one.target}: {one.kind}, {one.bits} at {one.place}")
    if crossings.wrong:
        raise CrossingError(crossings.wrong[0])
    log(f"simulating {boards.netlist.path.name} and {boards.rtl.path.name}")
    result, netlist, rtl = compare(boards)
    wrong = [f"{result.differ} pixels differ from the RTL's"] if result.differ else []
    for name, told in (("netlist", netlist), ("RTL", rtl)):
        wrong += [f"{name}: {one}" for one in wrong_counts(told.counts)]
        clocks, seconds = float(told.counts["clocks"]), float(told.counts["processor_seconds"])
        click.echo(f"{name}: {clocks:.0f} clocks, {clocks / seconds:.0f} a second of the processor")
    click.echo(f"{result.replies} replies to {result.kinds} kinds of requests are the RTL's")
    click.echo(f"{result.pixels} pixels compared, {result.differ} differ")
    if wrong:
        raise NetlistError("; ".join(wrong))

"""Starts virtual boards: the board's RTL in Verilator (sim/board) on a Unix socket, TCP or a pty.

A byte line has no speed limit. A bit line simulates a UART (8N1) clock by clock.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import secrets
import signal
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

import numpy as np

from lippmann.base import interrupts
from lippmann.base.files import listening, new_file, private_folder, scratch_folder
from lippmann.base.images import write_picture
from lippmann.base.tones import decode
from lippmann.display.description import Display
from lippmann.errors import DeviceError, InputError, LippmannError, device_error, input_error
from lippmann.fixed.build import Build
from lippmann.fixed.scene_build import SceneBuild
from lippmann.fixed.words import COMPACT
from lippmann.simulation.compilation import FAST, NETLIST, SHORT, UNCHECKED, cached_file, verilated
from lippmann.simulation.harness import optics_parameters
from lippmann.simulation.toolchain import build_folder, hardware, needed, rtl_sources
from lippmann.simulation.video_timing import TIMING, timing_of

Port = Literal["unix", "tcp", "pty"]
#: Type of a board's frame memory: block RAM, or an SDRAM chip with its controller.
Memory = Literal["block", "sdram"]

#: Default clock of the board, Hz: the pixel clock of 1920 x 1080 at 60 Hz.
CLOCK_HZ = 148_500_000
#: Clock of the SDRAM, Hz, as on a ULX3S at 1280 x 720.
MEMORY_HZ = 125_000_000
#: Frame rate, and minimum clock for 3 Mbaud, of a board with SDRAM, Hz.
FRAMES_HZ, SLOWEST_HZ = 60, 24_000_000
#: Maximum width and height of a panel, px: a limit of lipp_board.sv's video counters.
MAX_SIDE_PX = 16383
#: Minimum number of clocks per UART bit; lipp_uart_rx.sv samples a bit three times.
CLOCKS_OF_A_BIT = 8
#: Idle time after which a new program can replace the connected program, s.
IDLE_S = 60
#: Age, s, after which an incomplete frame counts as left by a killed simulator.
PART_S = 60.0
#: Maximum length of a Unix socket's path, bytes (`sun_path` of unix(7), without NUL).
MOST_SOCKET_BYTES = 107
#: State of a listening TCP socket in /proc/net/tcp.
LISTENS = "0A"
#: Maximum time for a simulator's start, and for its end, s.
START_SECONDS, STOP_SECONDS = 20.0, 20.0


class CaptureError(LippmannError):
    """The virtual board could not write a captured frame."""

    exit_code = 3


@dataclass
class RunningBoard:
    """A running virtual board: the URL of its port, and the simulator's process."""

    url: str
    process: subprocess.Popen[str]

    def reset(self) -> None:
        """Press the board's reset button, which discards the stored frames."""
        self.process.send_signal(signal.SIGUSR1)

    def stop(self) -> dict[str, Any]:
        """End the board; return its counts of clocks, seconds, processor seconds, bytes and frames.

        Raises DeviceError if the board failed or did not end in time, and CaptureError
        if a frame could not be written.
        """
        process = self.process
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        try:
            out, err = process.communicate(timeout=STOP_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            late = f"the virtual board did not end within {STOP_SECONDS:g} s and was killed; start it again"
            raise DeviceError(late) from None
        if process.returncode == CaptureError.exit_code:
            raise CaptureError(f"a frame cannot be written ({err.strip()}); free space, or make the folder again")
        if process.returncode:
            why = err.strip() or f"signal {-process.returncode}"
            raise DeviceError(f"the virtual board failed ({why}); start it again")
        return dict(json.loads(out.strip().splitlines()[-1]))


def step_of(baud: int, clock_hz: int) -> int:
    """Return the UART bits per clock, in units of 1/65536.

    Raises InputError if the clock cannot give the baud rate.
    """
    step = round(baud / clock_hz * 65536)
    if not 1 <= step <= 65536 // CLOCKS_OF_A_BIT or abs(step * clock_hz / 65536 / baud - 1) > 0.01:
        fastest = min(18_000_000, clock_hz // CLOCKS_OF_A_BIT)
        raise InputError(f"{baud} baud is not possible with a clock of {clock_hz} Hz; choose 115200 to {fastest} baud")
    return step


def check_free(tcp_port: int) -> None:
    """Raise DeviceError if a board cannot listen on a TCP port."""
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # the board sets this option too
        try:
            listener.bind(("127.0.0.1", tcp_port))
        except OSError as error:
            what = f"cannot listen on port {tcp_port} ({error.strerror})"
            raise device_error("--tcp-port", what, "choose another port, or 0 for a free one") from None


def board_build(display: Display, scene: SceneBuild | None = None, fraction_bits: int | None = None) -> Build:
    """Return the RTL parameters of a display's optics; `cross_cells` is True for speed.

    By default `fraction_bits` (F) is 18 for a board that draws nearest texels, else 16.
    """
    usual = COMPACT if scene is None or scene.bilinear else COMPACT + 2
    f = usual if fraction_bits is None else fraction_bits
    return replace(Build.of(display, "exact", f, aims=False), cross_cells=True)


def usual_clock(display: Display, scene: SceneBuild | None, memory: Memory) -> int:
    """Return a board's default clock, Hz; with SDRAM, the minimum for `FRAMES_HZ`."""
    if memory == "block":
        return CLOCK_HZ
    panel, timing = display.panel, timing_of(display)
    clocks = (panel.width_px + sum(timing[:3])) * (panel.height_px + sum(timing[3:6]))
    return max(clocks * (scene.samples if scene else 1) * FRAMES_HZ, SLOWEST_HZ)


def check_panel(display: Display) -> None:
    """Raise InputError if a panel is too large for a board."""
    panel = display.panel
    if max(panel.size_px) > MAX_SIDE_PX:
        what = f"the panel has {panel.width_px} x {panel.height_px} pixels"
        raise input_error(f"display '{display.name}'", what, f"give a panel of at most {MAX_SIDE_PX} x {MAX_SIDE_PX}")


def compile_board(display: Display, scene: SceneBuild | None = None) -> Path:
    """Compile the program that `start` runs for a display; return its path (see `compiled`)."""
    return compiled(display, board_build(display, scene), True, scene=scene)


class BoardOptions(TypedDict, total=False):
    """Options of a virtual board."""

    #: Type of port: a Unix socket for this user, TCP on loopback with an access token,
    #: or a pty. The default is TCP if `tcp_port` is set, else a Unix socket.
    port: Port | None
    #: TCP port; 0 selects a free port.
    tcp_port: int | None
    #: Baud rate of a bit line (UART); `None` selects a byte line.
    baud: int | None
    #: Baud rate that the host uses on a bit line, to simulate a wrong setting.
    host_baud: int | None
    #: Clock of the board, Hz; `None` selects `usual_clock`.
    clock_hz: int | None
    #: Fraction bits of the optics (F of `board_build`).
    fraction_bits: int | None
    #: An existing folder to which the board writes shown frames.
    capture: Path | None
    #: JSON file with the board's URL; the file exists while the board runs.
    ready: Path | None
    #: Waveform file (.fst), and its first and last clock, by default 0 and 10^6.
    trace: Path | None
    trace_clocks: tuple[int, int]
    #: Seed of random pauses at both ends of a byte line; the seed 0 means no pauses.
    stalls: int
    #: Build of the scene drawing; `None` selects a board that cannot draw.
    scene: SceneBuild | None
    #: Type of frame memory, by default block RAM. SDRAM needs a panel of even width.
    memory: Memory
    #: Program compiled for this display, line and clock; `None` compiles one.
    program: Path | None
    #: Idle time, s, after which another program can connect, by default `IDLE_S`.
    idle_s: int


def start(display: Display, **options: Unpack[BoardOptions]) -> RunningBoard:
    """Start a virtual board for a display, and wait until its port is open.

    Raises DeviceError if the board ends at once, and InputError if the panel is too
    large or the clock cannot produce the baud rate.
    """
    baud, scene, memory = options.get("baud"), options.get("scene"), options.get("memory", "block")
    trace, tcp_port = options.get("trace"), options.get("tcp_port")
    check_panel(display)
    if memory == "sdram" and display.panel.width_px % 2:
        what = f"memory sdram needs an even width, not {display.panel.width_px} pixels"
        raise input_error(f"display '{display.name}'", what, "change panel.width_px, or give memory block")
    clock_hz = options.get("clock_hz") or usual_clock(display, scene, memory)
    words: dict[str, object] = {
        "port": tcp_port or 0,
        "idle": options.get("idle_s", IDLE_S),
        "identity": display.identity,
        "step": 0 if baud is None else step_of(baud, clock_hz),
    }
    build = board_build(display, scene, options.get("fraction_bits"))
    program = options.get("program") or compiled(
        display, build, baud is None, clock_hz, trace is not None, scene, memory
    )
    if (host_baud := options.get("host_baud")) is not None:
        words["host-step"] = step_of(host_baud, clock_hz)
    words |= {name: options[name] for name in ("capture", "stalls") if options.get(name)}
    if trace is not None:
        new_file(trace).close()  # otherwise the simulator would follow another user's symlink
        first, last = options.get("trace_clocks", (0, 1_000_000))
        words |= {"trace": trace, "trace-from": first, "trace-to": last}
    port = options.get("port") or ("unix" if tcp_port is None else "tcp")
    with scratch_folder() as work:
        ready = options.get("ready") or work / "ready.json"
        ready.unlink(missing_ok=True)
        place = private_folder()
        _remove_dead_lines(place)
        if port == "unix":
            place /= f"board-{secrets.token_hex(4)}.sock"
            if len(os.fsencode(place)) > MOST_SOCKET_BYTES:
                what = "the folder's name is too long for a Unix socket"
                raise input_error(place.parent, what, "set TMPDIR to a shorter folder")
        words |= {"line": port, "place": place, "ready": ready}
        command = [str(program)]
        for name, value in words.items():
            command += [f"--{name}", str(value)]
        pipe = subprocess.PIPE
        process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, errors="replace")
        try:
            return RunningBoard(_wait(process, ready), process)
        except BaseException:
            process.kill()
            process.wait()
            raise


def _remove_dead_lines(place: Path) -> None:
    """Remove the sockets and tokens of killed boards, which have no listening process.

    The listeners are read from /proc: a test connection would disconnect a program.
    """
    # List files before listeners, so that a board that starts in between keeps its file.
    there = [*place.glob("board-*.sock"), *place.glob("tcp-*.token")]
    live = listening()
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    ports = (int(row[1].rpartition(":")[2], 16) for row in rows if row[3] == LISTENS)
    live |= {str(place / f"tcp-{port}.token") for port in ports}
    for path in there:
        if str(path) not in live:
            path.unlink(missing_ok=True)


def _wait(process: subprocess.Popen[str], ready: Path) -> str:
    until = time.monotonic() + START_SECONDS
    with interrupts.hold_signals() as ended:
        while not ready.exists() and process.poll() is None and not ended and time.monotonic() < until:
            time.sleep(0.01)
    if ready.exists():
        return str(json.loads(ready.read_text())["url"])
    if process.returncode is not None:
        _, err = process.communicate()
        raise DeviceError(f"the virtual board did not start ({err.strip()}); choose another port")
    raise DeviceError(f"the virtual board did not start within {START_SECONDS:.0f} s; end other programs, then retry")


@contextlib.contextmanager
def running(display: Display, **options: Unpack[BoardOptions]) -> Iterator[RunningBoard]:
    """Run a virtual board during a `with` block; the options are those of `start`."""
    board = start(display, **options)
    try:
        yield board
    finally:
        if board.process.stdout and not board.process.stdout.closed:  # `stop` has not run yet
            with contextlib.suppress(LippmannError):
                board.stop()


def remove_parts(folder: Path) -> None:
    """Remove incomplete frames of killed simulators from a folder of captured frames."""
    for part in folder.glob("frame-*.rgb.part"):
        with contextlib.suppress(FileNotFoundError):
            if time.time() - part.stat().st_mtime > PART_S:
                part.unlink()


def last_frame(folder: Path) -> int:
    """Return the largest NUMBER of the files frame-NUMBER.png in a folder, or 0."""
    files = (path for path in folder.glob("frame-*.png") if path.is_file())
    names = [re.fullmatch(r"frame-(\d+)\.png", path.name) for path in files]
    return max((int(one[1]) for one in names if one), default=0)


def keep_as_png(folder: Path, display: Display, after: int = 0) -> list[Path]:
    """Convert captured frames (frame-NUMBER.rgb) to PNG files; add `after` to their numbers.

    Raises CaptureError if a PNG file cannot be written, and keeps the .rgb file.
    """
    panel = display.panel
    pictures = []
    for raw in sorted(folder.glob("frame-*.rgb")):
        if raw.stat().st_size != math.prod(panel.shape):
            continue  # the frame has another panel's size
        values = np.frombuffer(raw.read_bytes(), np.uint8).reshape(panel.shape)
        metadata = {"identity": display.identity, "display": display.name}
        pictures.append(raw.with_name(f"frame-{after + int(raw.stem.removeprefix('frame-')):08d}.png"))
        try:
            light = decode(values / 255.0, panel.transfer)
            write_picture(pictures[-1], light, metadata, panel.transfer, panel.bits)
        except LippmannError as error:
            raise CaptureError(f"{error}; the frame stays in {raw.name}") from None
        raw.unlink()
    return pictures


def board_parameters(
    display: Display, build: Build, byte_link: bool, clock_hz: int, scene: SceneBuild | None, memory: Memory = "block"
) -> dict[str, int | str]:
    """Return the RTL parameters of `lipp_board_with_store` or `_sdram` for a display."""
    panel = display.panel
    return {
        **optics_parameters(build),
        "ByteLink": int(byte_link),
        "ClockHz": clock_hz,
        "Width": panel.width_px,
        "Height": panel.height_px,
        **dict(zip(TIMING, timing_of(display), strict=True)),
        **({} if scene is None else {"Scene": f"26'h{scene.word:07x}"}),
        **({"MemoryHz": MEMORY_HZ} if memory == "sdram" else {}),
    }


def compiled(
    display: Display,
    build: Build,
    byte_link: bool,
    clock_hz: int = CLOCK_HZ,
    trace: bool = False,
    scene: SceneBuild | None = None,
    memory: Memory = "block",
    netlist: Sequence[Path] = (),
) -> Path:
    """Return a board's program, compiled at first use. Raises the errors of `verilated`.

    The files `netlist` replace the RTL; they fix the board's parameters.
    """
    top, module = hardware(), "lipp_board_with_sdram" if memory == "sdram" else "lipp_board_with_store"
    files = [top / "rtl" / "registers" / "lint.vlt", *needed(module, rtl_sources(top))]
    parts = sorted((top / "sim" / "board").iterdir())
    numbers = board_parameters(display, build, byte_link, clock_hz, scene, memory)
    panel = display.panel
    defines = [
        f"-DLIPPMANN_WIDTH={panel.width_px}",
        f"-DLIPPMANN_HEIGHT={panel.height_px}",
        f"-DLIPPMANN_BYTE_LINK={int(byte_link)}",
        f"-DLIPPMANN_VSYNC={numbers['VPositive']}",
        *["-DLIPPMANN_TRACE"] * trace,
        *[f"-DLIPPMANN_MEMORY_HZ={MEMORY_HZ}LL", f"-DLIPPMANN_CLOCK_HZ={clock_hz}LL"] * (memory == "sdram"),
    ]
    options = [*UNCHECKED, *["--trace-fst"] * trace]
    if netlist:
        files, numbers = list(netlist), {}
        options += ["-Wno-lint", "-Wno-style", "-Wno-PINMISSING", *NETLIST]
    main = [part for part in parts if part.suffix == ".cpp"]
    flags = [*(SHORT if trace or netlist else FAST), *defines]

    def make(path: Path) -> None:
        verilated(path, module, files, main, numbers, options=options, flags=flags, link=["-lutil"])

    texts = map(repr, (sorted(numbers.items()), defines, options))
    inputs: list[Path | str] = [*files, *parts, Path(__file__), *texts]
    return cached_file(build_folder() / "sim" / f"board-{panel.width_px}x{panel.height_px}", inputs, make)

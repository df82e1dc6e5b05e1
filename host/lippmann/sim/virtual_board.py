"""The virtual board: the board's RTL under Verilator (sim/board), on a pty or on TCP.

It is compiled once for each panel, build of the optics and kind of line, and kept under build/sim/. A board with a byte
line takes bytes as fast as it can; one with a bit line has a UART's two wires, and its far end speaks 8N1 at the baud
rate, clock by clock.
"""

from __future__ import annotations

import contextlib
import json
import math
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lippmann.display import Display
from lippmann.errors import DeviceError, InputError, LippmannError
from lippmann.fixed.build import Build
from lippmann.fixed.words import COMPACT
from lippmann.images import decode, write_picture
from lippmann.sim.compilation import FAST, SHORT, kept, verilated
from lippmann.sim.harness import parameters
from lippmann.sim.tools import RTL_FOLDERS, needed, repository, rtl_sources

Port = Literal["pty", "tcp"]

#: Clock of the board, Hz: that of 1920 x 1080 at 60 frames a second.
CLOCK_HZ = 148_500_000
#: Fewest clocks that a bit of the line takes (rtl/link/uart_rx.sv samples it three times).
CLOCKS_OF_A_BIT = 8
#: Seconds that a board has to start.
START_SECONDS = 20.0


@dataclass(frozen=True)
class Timing:
    """Video timing, pixels and lines: front porch, sync, back porch."""

    h_front: int
    h_sync: int
    h_back: int
    v_front: int
    v_sync: int
    v_back: int


#: VESA DMT 640 x 480 and CEA-861 1920 x 1080.
KNOWN_TIMINGS = {(640, 480): Timing(16, 96, 48, 10, 2, 33), (1920, 1080): Timing(88, 44, 148, 4, 5, 36)}
#: Other panels: reduced blanking.
REDUCED = Timing(48, 32, 80, 3, 8, 30)


def timing(width: int, height: int) -> Timing:
    """Return the video timing of a panel."""
    return KNOWN_TIMINGS.get((width, height), REDUCED)


class CaptureError(LippmannError):
    """A frame that was scanned out could not be written."""

    exit_code = 3


@dataclass
class RunningBoard:
    """A virtual board that runs: where to connect, and its process."""

    url: str
    process: subprocess.Popen[str]

    def reset(self) -> None:
        """Reset the board, as its button would: what it received is forgotten."""
        self.process.send_signal(signal.SIGUSR1)

    def stop(self) -> dict[str, Any]:
        """End the board; return what it did: clocks, seconds, bytes, frames.

        Raises
        ------
        DeviceError
            When it had failed.
        CaptureError
            When it could not keep a frame.
        """
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        out, err = self.process.communicate(timeout=START_SECONDS)
        if self.process.returncode == CaptureError.exit_code:
            raise CaptureError(f"a frame cannot be kept ({err.strip()}); free space, or make the folder again")
        if self.process.returncode:
            why = err.strip() or f"signal {-self.process.returncode}"
            raise DeviceError(f"the virtual board failed ({why}); start it again")
        result: dict[str, Any] = json.loads(out.strip().splitlines()[-1])
        return result


def step_of(baud: int, clock_hz: int = CLOCK_HZ) -> int:
    """Return the bits a clock in 1 / 65536 of a bit line.

    Raises
    ------
    InputError
        For a rate that the clock is too slow or too fast for.
    """
    step = round(baud / clock_hz * 65536)
    if not 1 <= step <= 65536 // CLOCKS_OF_A_BIT or abs(step * clock_hz / 65536 / baud - 1) > 0.01:
        raise InputError(f"{baud} baud does not fit a clock of {clock_hz} Hz; choose 115200 to 18000000 baud")
    return step


def board_build(display: Display, fraction_bits: int = COMPACT) -> Build:
    """Return the build of the optics on a display's board."""
    return Build.of(display, "exact", fraction_bits, aims=False)


def start(
    display: Display,
    *,
    port: Port = "tcp",
    tcp_port: int = 0,
    baud: int | None = None,
    host_baud: int | None = None,
    clock_hz: int = CLOCK_HZ,
    fraction_bits: int = COMPACT,
    capture: Path | None = None,
    ready: Path | None = None,
    trace: Path | None = None,
    trace_clocks: tuple[int, int] = (0, 1_000_000),
) -> RunningBoard:
    """Start a virtual board for a display, and wait until it can be reached.

    Parameters
    ----------
    display
        Its panel and its array.
    port, tcp_port
        A pty, or TCP on loopback at a port (0: any that is free).
    baud
        A bit line of this rate; None: a byte line.
    host_baud
        Rate of a bit line's far end, where it is another: a cable with a wrong setting.
    clock_hz
        Clock that the board says it has, and that the rate is made from.
    fraction_bits
        Word length of its optics.
    capture
        An existing folder for the frames that are scanned out.
    ready
        JSON file that tells where to connect while it runs.
    trace, trace_clocks
        Waveforms (.fst) from a clock to another.

    Raises
    ------
    DeviceError
        When it ends at once, such as for a port that is taken.
    InputError
        For a rate that it cannot have.
    """
    step = 0 if baud is None else step_of(baud, clock_hz)
    program = compiled(display, board_build(display, fraction_bits), baud is None, clock_hz, trace is not None)
    with tempfile.TemporaryDirectory() as work:
        told = ready or Path(work) / "ready.json"
        told.unlink(missing_ok=True)
        command = [
            str(program), "--line", port, "--port", str(tcp_port), "--identity", display.identity,
            "--ready", str(told), "--step", str(step),
        ]  # fmt: skip
        if host_baud is not None:
            command += ["--host-step", str(step_of(host_baud, clock_hz))]
        if capture is not None:
            command += ["--capture", str(capture)]
        if trace is not None:
            command += [
                "--trace", str(trace), "--trace-from", str(trace_clocks[0]), "--trace-to", str(trace_clocks[1]),
            ]  # fmt: skip
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            return RunningBoard(_wait(process, told), process)
        except BaseException:
            process.kill()
            process.wait()
            raise


def _wait(process: subprocess.Popen[str], ready: Path) -> str:
    """Return the URL that the ready file tells."""
    until = time.monotonic() + START_SECONDS
    while time.monotonic() < until:
        if ready.exists():
            url: str = json.loads(ready.read_text())["url"]
            return url
        if process.poll() is not None:
            _, err = process.communicate()
            raise DeviceError(f"the virtual board did not start ({err.strip()}); choose another port")
        time.sleep(0.01)
    raise DeviceError(f"the virtual board did not start within {START_SECONDS:.0f} s; is the machine overloaded?")


@contextlib.contextmanager
def running(display: Display, **options: Any) -> Iterator[RunningBoard]:
    """Run a virtual board for the length of a with block; options as `start` takes them."""
    board = start(display, **options)
    try:
        yield board
    finally:
        if board.process.stdout and not board.process.stdout.closed:  # not yet asked what it did
            with contextlib.suppress(LippmannError):
                board.stop()


def keep_as_png(folder: Path, display: Display) -> list[Path]:
    """Turn the captured frames of a folder (frame-NUMBER.rgb) into PNG files that `lippmann observe` takes.

    Raises
    ------
    CaptureError
        When one cannot be written; the captured frame stays.
    """
    panel = display.panel
    shape = panel.height_px, panel.width_px, 3
    made = []
    for raw in sorted(folder.glob("frame-*.rgb")):
        if raw.stat().st_size != math.prod(shape):
            continue  # another board's, which it could not keep
        values = np.frombuffer(raw.read_bytes(), np.uint8).reshape(shape)
        metadata = {"identity": display.identity, "display": display.name}
        made.append(raw.with_suffix(".png"))
        try:
            write_picture(made[-1], decode(values / 255.0, panel.transfer), metadata, panel.transfer)
        except InputError as error:
            raise CaptureError(f"{error}; the frame stays in {raw.name}") from None
        raw.unlink()
    return made


def compiled(display: Display, build: Build, byte_link: bool, clock_hz: int = CLOCK_HZ, trace: bool = False) -> Path:
    """Return the program of a board, compiled unless it is there.

    Raises
    ------
    MissingLibraryError
        When a tool is missing.
    RtlError
        When Verilator or the compiler refuses.
    """
    top = repository()
    files = [top / "rtl" / "registers" / "lint.vlt", *needed("board", rtl_sources(top, *RTL_FOLDERS))]
    parts = sorted((top / "sim" / "board").iterdir())
    panel = display.panel
    numbers = {
        **{name: value for name, value in parameters(build).items() if name != "Aims"},
        "ByteLink": int(byte_link),
        "ClockHz": clock_hz,
        "Width": panel.width_px,
        "Height": panel.height_px,
    }
    edges = timing(panel.width_px, panel.height_px)
    numbers |= {
        "HFront": edges.h_front, "HSync": edges.h_sync, "HBack": edges.h_back,
        "VFront": edges.v_front, "VSync": edges.v_sync, "VBack": edges.v_back,
    }  # fmt: skip
    defines = [
        f"-DLIPPMANN_WIDTH={panel.width_px}", f"-DLIPPMANN_HEIGHT={panel.height_px}",
        f"-DLIPPMANN_BYTE_LINK={int(byte_link)}", *["-DLIPPMANN_TRACE"] * trace,
    ]  # fmt: skip
    options = ["--x-assign", "fast", "--x-initial", "fast", "--noassert", *["--trace-fst"] * trace]

    def make(path: Path) -> None:
        main = [part for part in parts if part.suffix == ".cpp"]
        flags = [*(SHORT if trace else FAST), *defines]  # writing waveforms takes far longer than the model itself
        verilated(path, "board", files, main, numbers, options=options, flags=flags, link=["-lutil"])

    inputs: list[Path | str] = [*files, *parts, Path(__file__), *map(repr, (sorted(numbers.items()), defines, options))]
    return kept(top / "build" / "sim" / f"board-{panel.width_px}x{panel.height_px}", inputs, make)

"""The share of a serial line's time that carries pixels, and the speed of the virtual board (`lippmann bench link`).

The board itself times a line: its UART receives the wire's bits clock by clock, and its clock counter gives the time.
Boards on slow lines have slow clocks, so that a measurement ends within minutes.
"""

from __future__ import annotations

import dataclasses
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lippmann.board.board import Board
from lippmann.board.stream import send_frame
from lippmann.display import Display, load_display
from lippmann.registers import BOARD_REGISTERS
from lippmann.sim import virtual_board

#: Baud rate, clock of the board, panel.
LINES = (
    (115_200, 16 * 115_200, (192, 128)),
    (921_600, 16 * 921_600, (256, 192)),
    (3_000_000, virtual_board.CLOCK_HZ, (192, 128)),
    (12_000_000, virtual_board.CLOCK_HZ, (256, 192)),
)
#: Panels to which a whole frame is sent.
PANELS = ((640, 480), (1920, 1080), (2400, 2400))
BITS_A_BYTE = 10
#: Fewest clocks a second at which a virtual board runs.
SIMULATED_HZ = 300_000


@dataclass(frozen=True)
class Efficiency:
    """A frame of noise over a line: the share of the line's time that carries pixels, and the protocol's overhead."""

    baud: int
    clock_hz: int
    payload_bytes: int
    seconds: float
    efficiency: float
    overhead: float
    resends: int
    clocks_per_second: float


@dataclass(frozen=True)
class WholeFrame:
    """A frame of noise sent to a virtual board over a line of bytes, while its video runs."""

    panel: str
    seconds: float
    kilobytes_per_second: float
    clocks_per_second: float
    bytes_differ: int
    verified: bool


def measure_lines(scenes: Path, seed: int) -> Iterator[Efficiency]:
    """Measure each line of LINES."""
    for baud, clock_hz, size in LINES:
        panel = _display(scenes, *size)
        image = _noise(*size, seed)
        with (
            virtual_board.running(panel, baud=baud, clock_hz=clock_hz) as virtual,
            # Over a socket the rate only sets the time-out of a packet. A simulation needs a longer one.
            Board.open(virtual.url, baud * SIMULATED_HZ // clock_hz, 60.0) as board,
        ):
            begun, first = time.monotonic(), _clocks(board)
            sent = send_frame(board, image)
            clocks = (_clocks(board) - first) & 0xFFFFFFFF
            simulated = clocks / (time.monotonic() - begun)
            seconds = clocks / board.info.clock_hz
        yield Efficiency(
            baud, clock_hz, sent.payload_bytes, seconds, sent.payload_bytes * BITS_A_BYTE / baud / seconds,
            sent.overhead, sent.resends, simulated,
        )  # fmt: skip


def measure_frames(scenes: Path, seed: int) -> Iterator[WholeFrame]:
    """Send a frame to each panel of PANELS, and compare what the board scans out byte by byte."""
    for size in PANELS:
        panel = _display(scenes, *size)
        image = _noise(*size, seed)
        with tempfile.TemporaryDirectory() as folder:
            virtual = virtual_board.start(panel, capture=Path(folder))
            try:
                with Board.open(virtual.url, patience_s=60.0) as board:
                    sent = send_frame(board, image)
                    shown = board.panel_crc()
            finally:
                done = virtual.stop()
            last = max(Path(folder).glob("frame-*.rgb"))
            differ = int((np.frombuffer(last.read_bytes(), np.uint8) != image.ravel()).sum())
        yield WholeFrame(
            f"{size[0]} x {size[1]}", sent.seconds, sent.rate / 1000, done["clocks"] / done["seconds"], differ,
            shown == sent.crc,
        )  # fmt: skip


def _display(scenes: Path, width: int, height: int) -> Display:
    display = load_display(scenes / "displays/paper-square.toml")
    return dataclasses.replace(display, panel=dataclasses.replace(display.panel, width_px=width, height_px=height))


def _noise(width: int, height: int, seed: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return an image of noise, which no coding makes smaller."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3)).astype(np.uint8)


def _clocks(board: Board) -> int:
    return board.read(BOARD_REGISTERS["clocks"].address)[0]

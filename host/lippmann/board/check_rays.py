"""Comparison of a board's rays with those of the integer twin: the CRC-32 of a region's rays from both."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from lippmann.board.board import Board
from lippmann.display.description import Display
from lippmann.fixed.configuration import configuration
from lippmann.fixed.raster import TABLE_ENTRIES, Raster, raster
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.registers import optics_writes, raster_writes

#: Most rays that the twin traces at once.
CHUNK_RAYS = 1 << 20


@dataclass(frozen=True)
class Check:
    """A region's rays, and the CRC-32 of all their words from the board and from the twin."""

    rays: int
    board_crc: int
    twin_crc: int

    @property
    def equal(self) -> bool:
        """Whether every word of every ray is the same."""
        return self.board_crc == self.twin_crc


def check_rays(board: Board, display: Display, columns: tuple[int, int], rows: tuple[int, int]) -> Check:
    """Write a display's optics into the board and compare the chief rays of a region's pixels.

    `columns` and `rows` are first and last of the region; (0, 0) is the panel's top left pixel. Raises InputError for a
    region off the panel, and for a display that the board's optics do not support.
    """
    panel = display.panel
    frame = Raster(panel.width_px, panel.height_px, columns, rows)
    build = board.optics_build()
    config = configuration(display, build, build.model)
    board.write_all([*optics_writes(config), *raster_writes(frame)])
    rays, board_crc = board.sign(frame.rays)
    twin_crc = 0
    band = max(1, CHUNK_RAYS // (columns[1] - columns[0] + 1))
    for first in range(rows[0], rows[1] + 1, band):
        part = Raster(panel.width_px, panel.height_px, columns, (first, min(first + band - 1, rows[1])))
        words = raster(part, np.zeros(TABLE_ENTRIES, np.int64), build.fraction_bits)
        zero = np.zeros_like(words.u)
        traced = ray_pipeline(words.u, words.v, zero, zero, config, build)
        twin_crc = zlib.crc32(np.stack(traced, axis=1).astype("<i4").tobytes(), twin_crc)
    return Check(rays, board_crc, twin_crc)

"""Tiles: a frame in squares of 32 pixels, each under its own CRC and in its cheapest coding."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import qoi

#: Side of a tile in pixels.
TILE = 32
#: Bytes of QOI's header, and of its end marker; the link carries neither.
QOI_HEADER, QOI_END = 14, 8

Pixels = npt.NDArray[np.uint8]
Crcs = npt.NDArray[np.uint32]


class Coding(IntEnum):
    """How a tile's pixels are written."""

    RAW = 0
    SOLID = 1
    QOI = 2
    COPY = 3


class Coded(NamedTuple):
    """A tile's coding and its data."""

    coding: Coding
    data: bytes


@dataclass(frozen=True)
class Grid:
    """The tiles of a frame of width x height pixels, row by row; those at the right and lower edge are clipped."""

    width: int
    height: int

    @property
    def columns(self) -> int:
        """Tiles side by side."""
        return -(-self.width // TILE)

    @property
    def count(self) -> int:
        """All tiles."""
        return self.columns * -(-self.height // TILE)

    def cut(self, image: Pixels, tile: int) -> Pixels:
        """Return a tile's pixels (rows, columns, 3) of an image (height, width, 3)."""
        row, column = divmod(tile, self.columns)
        y, x = row * TILE, column * TILE
        return np.ascontiguousarray(image[y : y + TILE, x : x + TILE])

    def crcs(self, image: Pixels) -> Crcs:
        """Return the CRC-32 of each tile (count,) of an image (height, width, 3): rows top to bottom, R G B."""
        return np.array([frame_crc(self.cut(image, tile)) for tile in range(self.count)], np.uint32)


def frame_crc(image: Pixels) -> int:
    """Return the CRC-32 of an image (height, width, 3): rows top to bottom, R G B."""
    return zlib.crc32(np.ascontiguousarray(image).data)


def code_tile(pixels: Pixels) -> Coded:
    """Return the shortest of raw, solid and QOI for a tile (rows, columns, 3)."""
    ways = [raw_tile(pixels), Coded(Coding.QOI, qoi.encode(pixels)[QOI_HEADER:-QOI_END])]
    if (pixels == pixels[0, 0]).all():
        ways.append(Coded(Coding.SOLID, pixels[0, 0].tobytes()))
    return min(ways, key=lambda way: len(way.data))


def raw_tile(pixels: Pixels) -> Coded:
    """Return a tile (rows, columns, 3) with its pixels as they are."""
    return Coded(Coding.RAW, pixels.tobytes())

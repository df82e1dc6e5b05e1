"""Tiles of 32 x 32 pixels: cut a frame, compute CRC-32 values, choose the shortest coding."""

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

Pixels = npt.NDArray[np.uint8]
Crcs = npt.NDArray[np.uint32]


class Coding(IntEnum):
    """Coding of a tile's pixels."""

    RAW = 0
    SOLID = 1
    QOI = 2
    COPY = 3


class Coded(NamedTuple):
    """A coded tile: the coding and the coded bytes."""

    coding: Coding
    data: bytes


@dataclass(frozen=True)
class TileGrid:
    """Grid of a frame's tiles, numbered row by row; the frame's edges clip the last tiles."""

    width: int
    height: int

    @property
    def columns(self) -> int:
        """Number of tiles in a row."""
        return -(-self.width // TILE)

    @property
    def count(self) -> int:
        """Number of tiles in the frame."""
        return self.columns * -(-self.height // TILE)

    def cut(self, frame: Pixels, tile: int) -> Pixels:
        """Return the pixels (rows, columns, 3) of a tile in a frame (height, width, 3)."""
        row, column = divmod(tile, self.columns)
        y, x = row * TILE, column * TILE
        return np.ascontiguousarray(frame[y : y + TILE, x : x + TILE])

    def crcs(self, frame: Pixels) -> Crcs:
        """Return the CRC-32 of each tile (count,) in a frame (height, width, 3)."""
        return np.array([frame_crc(self.cut(frame, tile)) for tile in range(self.count)], np.uint32)


def frame_crc(frame: Pixels) -> int:
    """Return the CRC-32 of a frame (height, width, 3): rows top to bottom, R G B."""
    return zlib.crc32(np.ascontiguousarray(frame).data)


def code_tile(pixels: Pixels) -> Coded:
    """Return the shortest coding of a tile (rows, columns, 3): raw, solid or QOI."""
    # The link omits QOI's 14-byte header and 8-byte end marker.
    codings = [raw_tile(pixels), Coded(Coding.QOI, qoi.encode(pixels)[14:-8])]
    if (pixels == pixels[0, 0]).all():
        codings.append(Coded(Coding.SOLID, pixels[0, 0].tobytes()))
    return min(codings, key=lambda coded: len(coded.data))


def raw_tile(pixels: Pixels) -> Coded:
    """Return the raw coding of a tile (rows, columns, 3): its pixel bytes."""
    return Coded(Coding.RAW, pixels.tobytes())

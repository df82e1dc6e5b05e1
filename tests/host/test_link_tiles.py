"""Tiles: places and CRCs by hand, codings read back by the qoi package and by the model board."""

import zlib

import numpy as np
import pytest
import qoi
from lippmann.board.tiles import Coding, TileGrid, code_tile, frame_crc, raw_tile
from model_board import qoi_pixels
from scene_cases import generator

SEED = 4502
#: What the link leaves out of a QOI file: magic, width, height, channels, colour space; seven zeros and a one.
QOI_END = bytes(7) + b"\1"


def qoi_file(data, width, height):
    return b"qoif" + width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([3, 0]) + data + QOI_END


def test_tiles_are_clipped_at_the_edges():
    grid = TileGrid(70, 33)
    image = generator(SEED).integers(0, 256, (33, 70, 3), np.uint8)
    assert (grid.columns, grid.count) == (3, 6)
    np.testing.assert_array_equal(grid.cut(image, 0), image[0:32, 0:32])
    np.testing.assert_array_equal(grid.cut(image, 2), image[0:32, 64:70])
    np.testing.assert_array_equal(grid.cut(image, 5), image[32:33, 64:70])
    assert grid.crcs(image)[5] == zlib.crc32(image[32:33, 64:70].tobytes())
    assert frame_crc(image) == zlib.crc32(image.tobytes())
    assert frame_crc(image[:, ::-1]) == zlib.crc32(image[:, ::-1].tobytes())
    assert [TileGrid(*size).count for size in ((1, 1), (32, 32), (33, 32), (1920, 1080), (2400, 2400))] == [
        1, 1, 2, 60 * 34, 75 * 75,
    ]  # fmt: skip


def test_codings_by_hand():
    black = np.zeros((32, 32, 3), np.uint8)
    assert code_tile(black) == (Coding.SOLID, bytes(3))
    assert code_tile(black + np.uint8(9)) == (Coding.SOLID, b"\x09\x09\x09")
    # One pixel: QOI's run of one.
    assert code_tile(black[:1, :1]) == (Coding.QOI, b"\xc0")
    # (1, 0, 0): DIFF +1 0 0 is 01 11 10 10; then a run of 3.
    red = np.array([[[1, 0, 0]] * 4 + [[1, 2, 0]]], np.uint8)
    assert code_tile(red) == (Coding.QOI, bytes([0b01111010, 0b11000010, 0b10100010, 0b01100110]))
    noise = generator(SEED, "noise").integers(0, 256, (32, 32, 3), np.uint8)
    assert code_tile(noise) == raw_tile(noise) == (Coding.RAW, noise.tobytes())


@pytest.mark.parametrize("levels", [2, 4, 9, 60, 256])
@pytest.mark.parametrize("shape", [(32, 32), (8, 32), (32, 5), (1, 1)])
def test_codings_are_read_back(levels, shape):
    rng = generator(SEED, levels, *shape)
    for _ in range(20):
        steps = rng.integers(0, levels, (*shape, 3)) * (rng.random((*shape, 1)) < 0.3)
        pixels = np.cumsum(steps, axis=1).astype(np.uint8)
        coded = code_tile(pixels)
        assert len(coded.data) <= pixels.size
        if coded.coding == Coding.QOI:
            np.testing.assert_array_equal(qoi.decode(qoi_file(coded.data, shape[1], shape[0])), pixels)
            assert qoi_pixels(coded.data, shape[0] * shape[1]) == pixels.tobytes()
            assert len(coded.data) < pixels.size
        elif coded.coding == Coding.SOLID:
            assert coded.data * (shape[0] * shape[1]) == pixels.tobytes()
        else:
            assert coded.data == pixels.tobytes()

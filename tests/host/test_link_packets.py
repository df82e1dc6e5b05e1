"""Packets and tiles: bytes by hand, by zlib, cobs and qoi; a reader that any bytes may meet."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import qoi
from cobs import cobs
from lippmann.board.packets import MAX_PACKET, MAX_STUFFED, Packet, PacketReader, packed
from lippmann.board.retries import FIRST_S, LONGEST_S, SHORTEST_S, RoundTrip
from lippmann.board.tiles import Coding, TileGrid, code_tile, frame_crc, raw_tile
from model_board import qoi_pixels
from scene_cases import generator

SEED = 4501


def by_zlib(kind, seq, body):
    plain = struct.pack("<BH", kind, seq) + body
    return plain + struct.pack("<I", zlib.crc32(plain))


def on_line(kind, seq, body):
    return cobs.encode(by_zlib(kind, seq, body)) + b"\0"


@pytest.mark.parametrize("size", [0, 1, 246, 247, 248, 253, 254, 255, 3076, MAX_PACKET - 7])
@pytest.mark.parametrize("fill", ["zeros", "ones", "noise"])
def test_packets_of_every_length_come_back(size, fill):
    noise = generator(SEED, size, fill).bytes(size)
    body = {"zeros": bytes(size), "ones": b"\1" * size, "noise": noise}[fill]
    line = packed(0x84, 0xFFFE, body)
    assert line == on_line(0x84, 0xFFFE, body)
    assert line.index(0) == len(line) - 1
    assert PacketReader().feed(line) == [Packet(0x84, 0xFFFE, body)]
    with pytest.raises(ValueError, match="3201"):
        packed(4, 0, bytes(MAX_PACKET - 6))


@pytest.mark.parametrize(
    "bad",
    [
        cobs.encode(by_zlib(1, 5, b"abd")[:-4] + by_zlib(1, 5, b"abc")[-4:]),
        cobs.encode(by_zlib(1, 5, b"abc")[:6]),
        b"\x09abc",
        cobs.encode(by_zlib(1, 5, bytes(MAX_PACKET - 6))),
        b"\1" * (MAX_STUFFED + 1),
        b"\xff" * 100_000,
        b"",
    ],
)
@pytest.mark.parametrize("chunk", [1, 7, 10**6])
def test_bad_packets_are_counted_and_the_next_is_read(bad, chunk):
    reader = PacketReader()
    line = bad + b"\0" + on_line(2, 9, b"next")
    found = [p for at in range(0, len(line), chunk) for p in reader.feed(line[at : at + chunk])]
    assert found == [Packet(2, 9, b"next")]
    assert reader.accepted == 1
    assert reader.bytes == len(line)


def test_fuzz():
    """Random and mutated bytes, good packets among them; every good packet that was left alone must come out."""
    rng = generator(SEED, "fuzz")
    reader = PacketReader()
    kept, found = [], []
    for number in range(120):
        body = rng.bytes(int(rng.integers(0, 3000)))
        good = on_line(4, number, body)
        mutated = np.frombuffer(good, np.uint8).copy()
        spots = rng.integers(0, len(good), rng.integers(1, 4))
        mutated[spots] = rng.integers(0, 256, len(spots), np.uint8)
        noise, cut = rng.bytes(int(rng.integers(1, 9000))), good[: rng.integers(0, len(good))]
        kind = int(rng.integers(4))
        kept += [Packet(4, number, body)] * (kind == 0)
        part = (b"\0" + good, mutated.tobytes(), noise, cut)[kind]
        for piece in np.array_split(np.frombuffer(part, np.uint8), int(rng.integers(1, 4))):
            found += reader.feed(piece.tobytes())
            assert len(reader._held) <= MAX_STUFFED + 1
    rest = iter(found)
    assert all(packet in rest for packet in kept)
    # A mutation of a byte into itself leaves a good packet.
    assert len(found) - len(kept) <= 1
    assert reader.accepted == len(found)
    assert 10 < len(kept) < 110


def test_time_out_follows_the_round_trip():
    time = RoundTrip()
    assert time.time_out_s == FIRST_S
    # RFC 6298: the first sample sets smoothed = R, deviation = R / 2, time-out = R + 4 R / 2.
    time.sample(0.2)
    assert time.time_out_s == pytest.approx(0.6)
    # deviation = 3/4 x 0.1 + 1/4 x |0.2 - 0.4|, smoothed = 7/8 x 0.2 + 1/8 x 0.4.
    time.sample(0.4)
    assert time.time_out_s == pytest.approx(0.225 + 4 * 0.125)
    time.back_off()
    assert time.time_out_s == pytest.approx(1.5 * 0.725)
    time.ease()
    time.ease()
    assert time.time_out_s == pytest.approx(0.725)
    for _ in range(9):
        time.back_off()
    assert time.time_out_s == LONGEST_S
    for _ in range(99):
        time.sample(1e-4)
    assert time.time_out_s == SHORTEST_S


def test_the_example_of_the_protocols_page():
    text = (Path(__file__).parents[2] / "docs/reference/protocol.md").read_text()
    lines = text.split("For example,")[1].split("\n\n")[1].splitlines()
    ask, asked, reply, replied = (bytes.fromhex(line) for line in lines)
    assert (by_zlib(2, 5, b"\0\0\1"), by_zlib(0x82, 5, b"\0BPIL")) == (ask, reply)
    assert asked == packed(2, 5, b"\0\0\1")
    assert PacketReader().feed(replied) == [Packet(0x82, 5, b"\0BPIL")]


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

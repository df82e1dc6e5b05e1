"""Packets: bytes by hand, by zlib and by cobs; a reader that any bytes may meet."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from cobs import cobs
from lippmann.board.packets import MAX_PACKET, MAX_STUFFED, Packet, PacketReader, packed
from lippmann.board.retries import FIRST_S, LONGEST_S, SHORTEST_S, RoundTrip
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

"""Packets of the link: type, sequence number, body, CRC-32; COBS-encoded, ended by a zero."""

from __future__ import annotations

import struct
import zlib
from enum import IntEnum
from typing import NamedTuple

from cobs import cobs  # type: ignore[import-untyped]  # the package comes without types

#: Protocol versions, in the order in which this host tries them.
VERSIONS = (2, 3, 1)
#: First protocol versions with ABORT and RESET, and with drawn scenes.
RESET_VERSION, SCENE_VERSION = 2, 3
#: Maximum length of a packet with its CRC before COBS encoding, bytes.
MAX_PACKET = 3200
#: Maximum length of a COBS-encoded packet; COBS adds a byte per started 254 bytes.
MAX_STUFFED = MAX_PACKET + -(-MAX_PACKET // 254)
#: Byte that ends a packet; a COBS-encoded packet contains no zero byte.
DELIMITER = b"\0"
#: Bit of the packet type that marks a reply.
REPLY = 0x80

#: Numbers of the frame buffers: tiles are written to BACK, FRONT is scanned out.
BACK, FRONT = 0, 1

HEADER = struct.Struct("<BH")
CRC = struct.Struct("<I")
#: Length of a packet with an empty body, bytes.
MIN_PACKET = HEADER.size + CRC.size


class Kind(IntEnum):
    """Types of request packets."""

    HELLO = 1
    READ = 2
    WRITE = 3
    TILE = 4
    PRESENT = 5
    TILES = 6
    TRACE = 7
    SIGN = 8
    ABORT = 9
    RESET = 10
    BLOCK = 11
    BLOCKS = 12


class ReplyStatus(IntEnum):
    """First byte of a reply's body: the outcome of the request."""

    OK = 0
    UNKNOWN_TYPE = 1
    WRONG_LENGTH = 2
    NO_SUCH_ADDRESS = 3
    STALE_EPOCH = 4
    BAD_TILE_DATA = 5
    FRAME_CRC_DIFFERS = 6
    NO_SUCH_TILE = 7
    WRONG_VERSION = 8
    OPTICS_REFUSED = 9
    BUSY = 10


class Packet(NamedTuple):
    """A valid packet: type with the reply bit, 16-bit sequence number, body."""

    kind: int
    seq: int
    body: bytes


def packed(kind: int, seq: int, body: bytes) -> bytes:
    """Return a COBS-encoded packet with its delimiter.

    Raises ValueError for a packet longer than `MAX_PACKET` bytes.
    """
    data = HEADER.pack(kind, seq) + body
    data += CRC.pack(zlib.crc32(data))
    if len(data) > MAX_PACKET:
        raise ValueError(f"the packet has {len(data)} bytes; at most {MAX_PACKET} are allowed")
    return bytes(cobs.encode(data)) + DELIMITER


class PacketReader:
    """Finds the valid packets in a byte stream; counts received bytes and valid packets."""

    def __init__(self) -> None:
        self.bytes = self.accepted = 0
        self._held = b""

    def feed(self, data: bytes) -> list[Packet]:
        """Take received bytes; return the valid packets that end in these bytes."""
        self.bytes += len(data)
        *ended, unfinished = (self._held + data).split(DELIMITER)
        # One byte more than allowed is enough to refuse an overlong packet.
        self._held = unfinished[: MAX_STUFFED + 1]
        packets = [packet for packet in map(_parse, ended) if packet]
        self.accepted += len(packets)
        return packets


def _parse(stuffed: bytes) -> Packet | None:
    try:
        data = bytes(cobs.decode(stuffed)) if len(stuffed) <= MAX_STUFFED else b""
    except cobs.DecodeError:
        return None
    crc = CRC.pack(zlib.crc32(data[: -CRC.size]))
    if not MIN_PACKET <= len(data) <= MAX_PACKET or data[-CRC.size :] != crc:
        return None
    kind, seq = HEADER.unpack(data[: HEADER.size])
    return Packet(kind, seq, data[HEADER.size : -CRC.size])

"""The link's packets: what is right, by zlib and the cobs package, and traffic that is not."""

import random
import zlib
from collections.abc import Callable
from typing import NamedTuple

from cobs import cobs
from pins import Pin

LONGEST = 3200
SHORTEST = 7

#: What becomes of a packet, as the bench writes it: taken, or the first cause that holds.
TAKEN, LONG, CUT, SHORT, CRC = "alcsr"


class Joined:
    """Several handles as one word, the first at the top."""

    def __init__(self, *handles):
        self._handles = [handle if isinstance(handle, Pin) else Pin(handle) for handle in handles]
        self._masks = [(1 << len(handle)) - 1 for handle in handles]

    @property
    def value(self) -> int:
        word = 0
        for handle, mask in zip(self._handles, self._masks, strict=True):
            word = word * (mask + 1) + int(handle.value)
        return word

    def put(self, word: int) -> None:
        for handle, mask in zip(reversed(self._handles), reversed(self._masks), strict=True):
            handle.value = word & mask
            word //= mask + 1


def with_crc(body: bytes) -> bytes:
    """A packet of a type, seq and body."""
    return body + zlib.crc32(body).to_bytes(4, "little")


def frame(packet: bytes) -> bytes:
    """A packet on the wire."""
    return cobs.encode(packet) + b"\0"


def marked(body: bytes) -> list[int]:
    """A packet stream's words: last in bit 8."""
    return [*body[:-1], body[-1] | 0x100]


def some_bytes(random_: random.Random, count: int) -> bytes:
    """Bytes with few, some, many or only zeros, or none."""
    zeros = random_.choice([0.0, 0.004, 0.05, 0.5, 1.0])
    if zeros == 0.0:
        return bytes(random_.choices(range(1, 256), k=count))
    data = bytearray(random_.randbytes(count))
    for k in range(count):
        if random_.random() < zeros:
            data[k] = 0
    return bytes(data)


def edges(random_: random.Random, longest: int) -> list[bytes]:
    """Packets around all that COBS counts: groups of 253, 254 and 255 bytes, alone and behind others."""
    bodies = [bytes([k]) for k in (0, 1, 255)]
    for count in (1, 2, 3, 252, 253, 254, 255, 256, 507, 508, 509, 762, 763):
        full = bytes(random_.choices(range(1, 256), k=count))
        bodies += [full, full + b"\0", b"\0" + full, full + b"\0\0" + full, full + b"\0" + full, bytes(count)]
    return [body for body in bodies if len(body) <= longest]


class Fate(NamedTuple):
    """Of a packet: the cause, and what comes out."""

    cause: str
    body: bytes


def fate(encoded: bytes) -> Fate | None:
    """What a frame without its delimiter must become; None for an empty one."""
    if not encoded:
        return None
    length = decoded_length(encoded)
    if length > LONGEST:
        return Fate(LONG, b"")
    try:
        packet = cobs.decode(encoded)
    except cobs.DecodeError:
        return Fate(CUT, b"")
    assert len(packet) == length
    if length < SHORTEST:
        return Fate(SHORT, b"")
    if zlib.crc32(packet[:-4]) != int.from_bytes(packet[-4:], "little"):
        return Fate(CRC, b"")
    return Fate(TAKEN, packet[:-4])


def decoded_length(encoded: bytes) -> int:
    """Bytes of a frame, also of one that was cut short: what its groups hold and the zeros between them."""
    return len(decode_cut(encoded)[0])


def decode_cut(encoded: bytes) -> tuple[bytes, bool]:
    """A frame's bytes, and whether its last group was cut short; then those there are."""
    for missing in range(255):
        try:
            packet = cobs.decode(encoded + b"\1" * missing)
        except cobs.DecodeError:
            continue
        return packet[: len(packet) - missing], missing > 0
    raise AssertionError(encoded)


def traffic(random_: random.Random, count: int) -> bytes:
    """About `count` bytes on the wire: good packets, and every way to spoil them."""
    ways: list[Callable[[bytearray], None]] = [
        lambda data: data.pop(random_.randrange(len(data))),
        lambda data: data.insert(random_.randrange(len(data)), random_.randrange(256)),
        lambda data: data.__setitem__(random_.randrange(len(data)), random_.randrange(256)),
        lambda data: data.__setitem__(random_.randrange(len(data)), 0),
        lambda data: data.__delitem__(slice(random_.randrange(len(data)), None)),
        lambda data: data.__delitem__(slice(0, random_.randrange(len(data)))),
        lambda data: data.extend(data[random_.randrange(len(data)) :]),
    ]
    parts: list[bytes] = []
    made = 0
    while made < count:
        kind = random_.random()
        if kind < 0.1:
            data = bytearray(random_.randbytes(random_.choice([1, 3, 20, 300])))
        elif kind < 0.2:
            # Too short to be a packet, or just long enough.
            data = bytearray(frame(with_crc(some_bytes(random_, random_.randrange(4)))))
        elif kind < 0.25:
            size = LONGEST + random_.choice([-1, 0, 0, 1, 1, 2, random_.randrange(3000)])
            data = bytearray(frame(with_crc(some_bytes(random_, size - 4))))
        elif kind < 0.3:
            data = bytearray(bytes(random_.randrange(5)))
        else:
            size = random_.choice([3, 4, 10, 60, random_.randrange(3, 600), random_.randrange(3, LONGEST - 3)])
            data = bytearray(frame(with_crc(some_bytes(random_, size))))
        if random_.random() < 0.4 and data:
            for _ in range(random_.choice([1, 1, 1, 2, 5])):
                if data:
                    random_.choice(ways)(data)
        parts.append(bytes(data))
        made += len(data)
    return b"".join(parts)


def fates(wire: bytes) -> list[Fate]:
    """What all that came over the wire must become; what is behind the last delimiter is no packet yet."""
    found = (fate(encoded) for encoded in wire.split(b"\0")[:-1])
    return [each for each in found if each is not None]

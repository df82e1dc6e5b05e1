"""Requests of all kinds for the dispatcher's test, right ones and wrong ones, some said twice."""

import random
import struct
from collections.abc import Iterator

import rules
from protocol import ABORT, BLOCK, BLOCKS, KINDS, READ, RESET, SIGN, TILE, TILES, TRACE, WRITE, Reference, request


def addresses() -> tuple[int, int]:
    """A range of registers: mostly there, often at an end, sometimes off it."""
    count = random.choice([1, 1, 2, 3, 5, 64, random.randint(1, 64)])
    low, behind = random.choice(rules.RANGES)
    first = random.choice([low, behind - 4 * count, random.randrange(low, behind, 4)])
    if random.random() < 0.15:
        first = random.choice(
            [first + 4, first + 1, first + 2, 0x100, 0x1FC, 0x400, 0x800, 0xFFFC, random.getrandbits(16)]
        )
    return first % (1 << 16), count


def epoch(reference: Reference) -> int:
    return (reference.epoch + random.choice([0, 0, 0, 0, 0, 1, -1, 256, random.getrandbits(16)])) % (1 << 16)


def hello(_: Reference) -> bytes:
    good = [rules.VERSION] * 4
    return struct.pack("<BI", random.choice([*good, 0, 1, 2, 3, 0x82]), random.getrandbits(32))


def read(_: Reference) -> bytes:
    return struct.pack("<HB", *random.choice([addresses(), addresses(), (rules.STATUS, 1)]))


def write(_: Reference) -> bytes:
    first, count = addresses()
    chance = random.random()
    if chance < 0.3:
        word = random.choice([1, 2, 2, 3, 4, 6, 7, random.getrandbits(32)])
        return struct.pack("<HI", *random.choice([(rules.CONTROL, word), (rules.SOURCE, word), (rules.WINDOW, word)]))
    if rules.LAYERS and chance < 0.45:
        # The panel is drawn, or no longer; with some of the picture's registers, which follow.
        words = [random.choice([0, 0, 1, random.getrandbits(32)]), *(random.getrandbits(32) for _ in range(7))]
        return struct.pack("<H", rules.DRAW) + struct.pack("<8I", *words)[: 4 * random.choice([1, 1, 1, 2, 7, 8])]
    if chance < 0.8:
        # Words that can be written, or one more.
        low, last = random.choice(rules.WRITABLE)
        first = random.randrange(low, last + 4, 4)
        count = random.randint(1, min(64, (last - first) // 4 + random.choice([1, 1, 1, 2])))
    return struct.pack(f"<H{count}I", first, *(random.getrandbits(32) for _ in range(count)))


def tile(reference: Reference) -> bytes:
    number = random.choice([0, reference.tiles - 1, random.randrange(reference.tiles)])
    number += random.choice([0] * 6 + [reference.tiles, 0x8000])
    size = random.choice([0, 0, 1, 3, 20, 300])
    coding = random.choice([0, 1, 2, 3, 4, 255])
    return struct.pack("<HHB", epoch(reference), number, coding) + random.randbytes(size)


def present(reference: Reference) -> bytes:
    return struct.pack("<HI", epoch(reference), random.getrandbits(32))


def tiles(reference: Reference) -> bytes:
    most = min(reference.tiles, 512)
    count = random.choice([1, 2, random.randint(1, 12), most if random.random() < 0.1 else 3])
    first = random.choice([0, reference.tiles - count, random.randrange(reference.tiles - count + 1)])
    first = random.choice([first] * 8 + [first + 1, reference.tiles, 0xFFFF])
    return struct.pack("<BHH", random.choice([0, 1, 0, 1, 0, 1, 2, 255]), first, count)


def trace(_: Reference) -> bytes:
    """Rays of any aims; a pixel's words end where theirs do, or now and then beyond."""
    ends = [-(1 << 17), (1 << 17) - 1]
    if random.random() < 0.1:
        ends += [-(1 << 17) - 1, 1 << 17, -(1 << 31), (1 << 31) - 1]
    pixels = [*ends, *(random.randrange(-(1 << 17), 1 << 17) for _ in range(4))]
    rays = range(random.choice([1, 1, 2, 3, 64 if random.random() < 0.1 else 4]))
    return b"".join(struct.pack("<2i", *random.choices(pixels, k=2)) + random.randbytes(8) for _ in rays)


def block(_: Reference) -> bytes:
    slot, number = place()
    return bytes([slot, number]) + random.randbytes(rules.BLOCK_BYTES)


def blocks(_: Reference) -> bytes:
    slot, first = place()
    there = max(rules.blocks_of(slot) - first, 1)
    return bytes([slot, first, random.choice([1, there, min(there + 1, 255), random.randint(1, 255)])])


def place() -> tuple[int, int]:
    """A slot and a block of it: mostly there, sometimes behind the last."""
    slot = random.choice([0, 1, rules.SLOTS - 1, rules.SLOTS, rules.CURVE, rules.CURVE, random.randrange(256)])
    last = max(rules.blocks_of(slot), 1) - 1
    return slot, random.choice([0, last, random.randint(0, last), min(last + 1, 255), random.randrange(256)])


#: Bodies of the right length; what they say may be wrong.
_BODIES = (hello, read, write, tile, present, tiles, trace, *[lambda _: b""] * 3, block, blocks)
BODIES = dict(zip(KINDS, _BODIES, strict=False))
#: Kinds that change little for the requests behind them.
OFTEN = [kind for kind in KINDS if kind not in (ABORT, RESET)]


def bad_length(kind: int, body: bytes) -> bytes:
    """Another length: a little, a lot, or a count that is none."""
    counts = {
        READ: lambda: body[:2] + bytes([random.choice([0, 65, 128, 255])]),
        TILES: lambda: body[:3] + struct.pack("<H", random.choice([0, 513, 0x8001, 0xFFFF])),
        WRITE: lambda: body[:2] + random.randbytes(4 * random.choice([0, 65, 66, 256, 257, 320, 600])),
        TILE: lambda: body[: random.randrange(5)],
        TRACE: lambda: random.randbytes(random.choice([1020, 1028, 1040, 1025, 1041, 2048, 4 * 513])),
        BLOCK: lambda: body[:2] + random.randbytes(random.choice([0, 1, 1020, 1023, 1025, 1028, 2048, 3000])),
        BLOCKS: lambda: body[:2] + bytes(1),
    }
    if random.random() < 0.4 and kind in counts:
        return counts[kind]()
    cut = body[: random.randrange(len(body) + 1)]
    more = body + random.randbytes(random.choice([2, 3, 4, 12, 50]))
    return random.choice([cut, cut, body[:-1], body + b"\1", more])


def traffic(reference: Reference, count: int) -> Iterator[tuple[bytes, bytes]]:
    """Requests, each with its reply."""
    sent: list[bytes] = []
    number = random.getrandbits(16)
    for _ in range(count):
        kind = random.choice([*OFTEN, WRITE, WRITE, SIGN, TRACE] if random.random() < 0.8 else KINDS)
        # Mostly a newer one; some come again, late, or after many that were lost.
        number = (number + random.choice([1] * 8 + [0, -1, 5, -5, 0x7FFF, 0x8000, -0x7FFF])) % (1 << 16)
        chance = random.random()
        if chance < 0.2 and sent:
            packet = random.choice(sent[-3:])
        elif chance < 0.25:
            unknown = random.choice([0, KINDS[-1] + 1, 0x10, 0x80, 0x81, 0x88, 0x8B, 0xFF])
            packet = request(unknown, number, random.randbytes(random.choice([0, 0, 1, 5, 40])))
        else:
            body = BODIES[kind](reference)
            packet = request(kind, number, bad_length(kind, body) if chance < 0.4 else body)
        sent.append(packet)
        yield packet, reference.reply(packet)

"""How the dispatcher's neighbours behave in its test, as far as the protocol can see: functions of what they are told.

The reference (protocol.py) and the neighbours at the RTL's ports (neighbours.py) share these rules, but no state.
"""

import struct
import zlib

BUILD, CONTROL, STATUS, SOURCE = 0x208, 0x20C, 0x210, 0x214
#: A frame of the raster is refused while its lowest bit is set.
WINDOW = 0x300
APPLY, START = 1, 2
BUSY, REFUSED = 1, 4
OK, STALE, FRAME_CRC = 0, 4, 6


def _hash(*words: int) -> int:
    return zlib.crc32(struct.pack(f"<{len(words)}q", *words))


def can_read(at: int) -> bool:
    return at in (BUILD, STATUS, SOURCE, WINDOW) or (at != CONTROL and _hash(1, at) % 8 != 0)


#: First and last of the words that can be written, from the tables in docs/reference.
WRITABLE = ((0x018, 0x01C), (0x20C, 0x20C), (0x214, 0x214), (0x240, 0x2D0), (0x2E0, 0x3FC))


def can_write(at: int) -> bool:
    return any(first <= at <= last for first, last in WRITABLE)


def at_reset() -> dict[int, int]:
    """The registers."""
    registers = {at: _hash(3, at) for at in (*range(0, 0x100, 4), *range(0x200, 0x400, 4))}
    return registers | {CONTROL: 0, STATUS: 0, SOURCE: 0, WINDOW: 0}


def tile_is_good(tile: int, coding: int, data: bytes) -> bool:
    return coding <= 3 and zlib.crc32(data, tile) % 4 != 0


def table_crc(front: bool, tile: int) -> int:
    return _hash(4, front, tile)


def presented(crc: int) -> int:
    """The status of a frame of this CRC."""
    return (FRAME_CRC, STALE, OK, OK)[crc % 4]


def exit_ray(ray: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(_hash(5, k, *ray) for k in range(9))


def signature(frames: int) -> tuple[int, int]:
    """Rays and CRC of the raster's n-th frame."""
    return _hash(6, frames), _hash(7, frames)

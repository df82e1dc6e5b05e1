"""How the dispatcher's neighbours behave in its test, as far as the protocol can see: functions of what they are told.

The reference (protocol.py) and the neighbours at the RTL's ports (neighbours.py) share these rules, but no state.
"""

import struct
import zlib

import cocotb

BUILD, CONTROL, STATUS, SOURCE = 0x208, 0x20C, 0x210, 0x214
#: A frame of the raster is refused while its lowest bit is set.
WINDOW = 0x300
APPLY, START, ABORT = 1, 2, 4
BUSY, RUNNING, REFUSED, OCCUPIED = 1, 2, 4, 8
OK, STALE, FRAME_CRC = 0, 4, 6
#: Of the scene, when the board has one: its layers, slots and blocks of a slot, and the register that has it drawn.
LAYERS, SLOTS, BLOCKS = (int(cocotb.plusargs[name]) for name in ("Layers", "Slots", "Blocks"))
DRAW, LOOK = 0x40C, 0x61C
CURVE, CURVE_BLOCKS = 15, 8
BLOCK_BYTES = 1024
#: The version of the protocol.
VERSION = 3 if LAYERS else 2


def _hash(*words: int) -> int:
    return zlib.crc32(struct.pack(f"<{len(words)}q", *words))


def can_read(at: int) -> bool:
    return at in (BUILD, STATUS, SOURCE, WINDOW) or (at != CONTROL and _hash(1, at) % 8 != 0)


#: First and last of the words that can be written, from the tables in docs/reference.
WRITABLE = ((0x018, 0x01C), (0x20C, 0x20C), (0x214, 0x214), (0x240, 0x2D0), (0x2E0, 0x3FC))
if LAYERS:
    WRITABLE += ((0x40C, 0x424), (0x600, 0x600 + 32 * LAYERS - 4))
#: First of each block of registers, and behind its last.
RANGES = ((0, 0x100), (0x200, 0x400)) + ((0x400, 0x800),) * bool(LAYERS)


def can_write(at: int) -> bool:
    return any(first <= at <= last for first, last in WRITABLE)


def at_reset() -> dict[int, int]:
    """The registers."""
    registers = {at: _hash(3, at) for first, behind in RANGES for at in range(first, behind, 4)}
    return registers | {CONTROL: 0, STATUS: 0, SOURCE: 0, WINDOW: 0}


def slots(look: int, drawn: bool) -> int:
    """A bit for each slot that cannot be written now: of some value of a register, while the panel is drawn."""
    return drawn * (_hash(12, look) & 0x7FFF | 1 << CURVE)


def blocks_of(slot: int) -> int:
    """Blocks of a slot; 0 where there is none."""
    return CURVE_BLOCKS if slot == CURVE else BLOCKS * (slot < SLOTS)


def block_crc(slot: int, block: int) -> int:
    return _hash(13, slot, block)


class Drawing:
    """Whether the optics draw the panel: once that is written, and for some requests after it was ended."""

    def __init__(self) -> None:
        self._source, self._left, self._ends = False, 0, 0

    @property
    def on(self) -> bool:
        return self._source or self._left > 0

    def write(self, word: int) -> None:
        if self._source and not word & 1:
            self._ends += 1
            self._left = _hash(14, self._ends) % 3
        self._source = bool(word & 1)

    def next_request(self) -> None:
        self._left = max(self._left - 1, 0)


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


def so_far(frames: int) -> int:
    """Rays of that frame while it runs."""
    return _hash(8, frames)


def lasts(frames: int) -> int:
    """Requests that are executed while that frame runs."""
    return _hash(11, frames) % 5


class Optics:
    """The optics block as the bus sees it: commands and status. Its time is that of the requests.

    An apply, and the rays that an abort leaves, last for some looks at the status, and end with the request. The n-th
    frame runs while so many further requests are executed, if the raster is the source.
    """

    def __init__(self) -> None:
        self.source = self.stream = False  # as written, and in effect
        self.refused = self.running = False
        self.frames = 0
        self._busy = self._occupied = self._requests = 0

    def status(self) -> int:
        """A look at its status."""
        seen = BUSY * bool(self._busy) | OCCUPIED * bool(self._occupied)
        seen |= RUNNING * self.running | REFUSED * self.refused
        self._occupied = max(self._occupied - 1, 0)
        if self._busy:
            self._busy -= 1
            self._take()
        return seen

    def control(self, word: int, window: int) -> None:
        """A write of its commands."""
        if word & ABORT:
            self.running, self._occupied = False, _hash(9, self.frames) % 4
        if word & APPLY:
            self._busy = 1 + _hash(10, self.frames, self.source) % 3
        if word & START:
            assert not self.running, "a frame began while another one was running"
            self.frames += 1
            self.refused = bool(window & 1)
            self.running, self._requests = not self.refused, lasts(self.frames)

    def next_request(self) -> bool:
        """Time passes; whether a frame ends."""
        if self._busy:
            self._busy = 0
            self._take()
        self._occupied = 0
        if not self.running or self.stream:
            return False
        self._requests -= 1
        self.running = self._requests >= 0
        return not self.running

    def _take(self) -> None:
        if not self._busy:
            self.stream = self.source

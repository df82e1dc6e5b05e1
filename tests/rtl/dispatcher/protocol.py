"""The board's side of the protocol, from docs/reference/protocol.md, over the rules of the test's neighbours."""

import struct

import rules

HELLO, READ, WRITE, TILE, PRESENT, TILES, TRACE, SIGN, ABORT, RESET, BLOCK, BLOCKS = range(1, 13)
KINDS = range(1, 13 if rules.LAYERS else 11)
(OK, UNKNOWN, LENGTH, ADDRESS, STALE, BAD_TILE, FRAME_CRC, NO_TILE, VERSION, OPTICS, BUSY) = range(11)
#: Kinds that are executed once.
ONCE = (WRITE, SIGN, ABORT, RESET)
RUNS_FRAME, RUNS_SIGN, RUNS_THIS, RUNS_SCENE, RUNS_SLOT = 1, 2, 3, 4, 5


def request(kind: int, number: int, body: bytes = b"") -> bytes:
    return struct.pack("<BH", kind, number) + body


class Reference:
    """Replies to requests one after the other, and keeps what they must have done."""

    def __init__(self, width: int, height: int, clock_hz: int, identity: int, epoch: int):
        self.width, self.height, self.clock_hz, self.identity, self.epoch = width, height, clock_hz, identity, epoch
        self.tiles = -(-width // 32) * -(-height // 32)
        self.registers, self.optics, self.drawing = rules.at_reset(), rules.Optics(), rules.Drawing()
        self.stale = self.tile_bad = 0
        #: The words of each update of the scene's registers.
        self.updates: list[list[tuple[int, int]]] = []
        #: The last sign's frame, while it runs, and what became of it.
        self.signing = False
        self.signed = OK
        self.executed: tuple[int, int] | None = None
        self.executed_status = OK
        self.newest = self.nonce = 0
        #: What was done, in order.
        self.log: list[tuple] = []

    def reply(self, packet: bytes) -> bytes:
        kind, number = struct.unpack("<BH", packet[:3])
        if self.optics.next_request():
            self.signing = False
        self.drawing.next_request()
        status, rest = self._execute(kind, number, packet[3:])
        if (number - self.newest) % (1 << 16) <= 1 << 15:
            self.newest = number
        if self.executed and (self.newest - self.executed[1]) % (1 << 16) >= 1 << 15:
            self.executed = None
        return struct.pack("<BHB", kind | 0x80, number, status) + (rest if status in (OK, BUSY) else b"")

    def _execute(self, kind: int, number: int, body: bytes) -> tuple[int, bytes]:
        if kind not in KINDS:
            return UNKNOWN, b""
        if not self._length_is_right(kind, body):
            return LENGTH, b""
        if kind in ONCE:
            return self._execute_once(kind, number, body)
        if kind == HELLO:
            return self._hello(number, body)
        return {
            READ: self._read, TILE: self._tile, PRESENT: self._present, TILES: self._tiles, TRACE: self._trace,
            BLOCK: self._block, BLOCKS: self._blocks,
        }[kind](body)  # fmt: skip

    def _execute_once(self, kind: int, number: int, body: bytes) -> tuple[int, bytes]:
        if self.executed == (kind, number):
            return self._signed() if kind == SIGN else (self.executed_status, b"")
        if self.executed and not 0 < (number - self.executed[1]) % (1 << 16) <= 1 << 15:
            self.stale += 1
            return STALE, b""
        at = int.from_bytes(body[:2], "little") if kind == WRITE else 0
        optics = kind == SIGN or 0x200 <= at < (0x400 if rules.LAYERS else 0x10000)
        if optics and self.drawing.on:
            return self._busy()
        draws = rules.LAYERS and at == rules.DRAW and body[2] & 1 and not self.drawing.on
        if (optics or draws) and self._is_busy():
            return self._busy()
        if draws:
            self._have(stream=1)
        self.executed = (kind, number)
        if kind == SIGN:
            return self._sign()
        self.executed_status = {WRITE: self._write, ABORT: self._abort, RESET: self._reset}[kind](body)
        return self.executed_status, b""

    def _is_busy(self) -> bool:
        """Whether the optics can be had: not while a frame runs. An apply is waited for."""
        while True:
            status = self.optics.status()
            if status & rules.RUNNING or self.signing:
                return True
            if not status & rules.BUSY:
                return False

    def _busy(self, sign: int = RUNS_SIGN) -> tuple[int, bytes]:
        if self.drawing.on:
            return BUSY, struct.pack("<BI", RUNS_SCENE, 0)
        if self.signing:
            return BUSY, struct.pack("<BI", sign, rules.so_far(self.optics.frames))
        return BUSY, struct.pack("<BI", RUNS_FRAME, 0)

    def _length_is_right(self, kind: int, body: bytes) -> bool:
        size = len(body)
        if kind == READ:
            return size == 3 and 1 <= body[2] <= 64
        if kind == WRITE:
            return size % 4 == 2 and 1 <= size // 4 <= 64
        if kind == TILES:
            return size == 5 and 1 <= int.from_bytes(body[3:], "little") <= 512
        if kind == BLOCKS:
            return size == 3 and body[2] > 0
        if kind == TRACE:
            pixels = (word for k, (word,) in enumerate(struct.iter_unpack("<i", body[: size & ~3])) if k % 4 < 2)
            return size % 16 == 0 and 1 <= size // 16 <= 64 and all(-(1 << 17) <= one < 1 << 17 for one in pixels)
        return size >= 5 if kind == TILE else size == {HELLO: 5, PRESENT: 6, BLOCK: 2 + rules.BLOCK_BYTES}.get(kind, 0)

    def _hello(self, number: int, body: bytes) -> tuple[int, bytes]:
        version, nonce = struct.unpack("<BI", body)
        if version == rules.VERSION and nonce != self.nonce:
            self.nonce, self.newest, self.executed = nonce, number, None
        sizes, state = (self.width, self.height, 32, 3200), (self.clock_hz, self.epoch, self.registers[rules.BUILD])
        told = struct.pack("<BIQHHBHIHI", rules.VERSION, nonce, self.identity, *sizes, *state)
        return (OK if version == rules.VERSION else VERSION), told

    def _range_is_there(self, first: int, count: int) -> bool:
        wanted = range(first, first + 4 * count, 4)
        return first % 4 == 0 and any(set(wanted) <= set(range(*block)) for block in rules.RANGES)

    def _read(self, body: bytes) -> tuple[int, bytes]:
        first, count = struct.unpack("<HB", body)
        if not self._range_is_there(first, count):
            return ADDRESS, b""
        found = [self._read_one(at) for at in range(first, first + 4 * count, 4)]
        return OK, struct.pack(f"<{count}I", *found)

    def _read_one(self, at: int) -> int:
        if at == rules.STATUS:
            return self.optics.status()
        return self.registers[at] if rules.can_read(at) else 0

    def _write(self, body: bytes) -> int:
        first, *words = struct.unpack(f"<H{len(body) // 4}I", body)
        if not self._range_is_there(first, len(words)):
            return ADDRESS
        if not all(rules.can_write(first + 4 * k) for k in range(len(words))):
            return ADDRESS
        if first >= 0x400:
            self.updates.append([(first + 4 * k, word) for k, word in enumerate(words)])
        for k, word in enumerate(words):
            self._write_one(first + 4 * k, word)
        return OK

    def _write_one(self, at: int, word: int) -> None:
        self.log.append(("write", at, word))
        if at == rules.CONTROL:
            self.optics.control(word, self.registers[rules.WINDOW])
            return
        self.registers[at] = word
        if at == rules.SOURCE:
            self.optics.source = bool(word & 1)
        if at == rules.DRAW:
            self.drawing.write(word)

    def _tile(self, body: bytes) -> tuple[int, bytes]:
        epoch, tile, coding = struct.unpack("<HHB", body[:5])
        if epoch != self.epoch:
            self.stale += 1
            return STALE, b""
        if tile >= self.tiles:
            return NO_TILE, b""
        self.log.append(("tile", tile, coding, body[5:]))
        if not rules.tile_is_good(tile, coding, body[5:]):
            self.tile_bad += 1
            return BAD_TILE, b""
        return OK, struct.pack("<H", tile)

    def _present(self, body: bytes) -> tuple[int, bytes]:
        epoch, crc = struct.unpack("<HI", body)
        self.log.append(("present", epoch, crc))
        status = rules.presented(crc)
        self.epoch = (self.epoch + (status == OK)) % (1 << 16)
        self.stale += status == STALE
        return status, struct.pack("<H", self.epoch)

    def _tiles(self, body: bytes) -> tuple[int, bytes]:
        buffer, first, count = struct.unpack("<BHH", body)
        if buffer > 1 or first + count > self.tiles:
            return NO_TILE, b""
        crcs = [rules.table_crc(bool(buffer), first + k) for k in range(count)]
        return OK, struct.pack(f"<HH{count}I", self.epoch, first, *crcs)

    def _block(self, body: bytes) -> tuple[int, bytes]:
        slot, block = body[:2]
        if block >= rules.blocks_of(slot):
            return NO_TILE, b""
        if rules.slots(self.registers[rules.LOOK], self.drawing.on) >> slot & 1:
            return BUSY, struct.pack("<BI", RUNS_SLOT, 0)
        self.log.append(("block", slot, block, body[2:]))
        return OK, body[:2]

    def _blocks(self, body: bytes) -> tuple[int, bytes]:
        slot, first, count = body
        if first + count > rules.blocks_of(slot):
            return NO_TILE, b""
        return OK, body[:2] + struct.pack(f"<{count}I", *(rules.block_crc(slot, first + k) for k in range(count)))

    def _have(self, stream: int) -> None:
        """Take the optics, with the stream or the raster as the source, once they are empty."""
        self._write_one(rules.SOURCE, stream)
        self._write_one(rules.CONTROL, rules.APPLY)
        while self.optics.status() & rules.BUSY:
            pass

    def _trace(self, body: bytes) -> tuple[int, bytes]:
        if self.drawing.on or self._is_busy():
            return self._busy()
        self._have(stream=1)
        rays = list(struct.iter_unpack("<4I", body))
        self.log += [("ray", *ray) for ray in rays]
        self._have(stream=0)
        return OK, b"".join(struct.pack("<9I", *rules.exit_ray(ray)) for ray in rays)

    def _sign(self) -> tuple[int, bytes]:
        self._have(stream=0)
        self._write_one(rules.CONTROL, rules.START)
        self.optics.status()
        self.signing = self.optics.running
        self.signed = OK if self.signing else OPTICS
        return self._signed()

    def _signed(self) -> tuple[int, bytes]:
        if self.signing:
            return self._busy(RUNS_THIS)
        return self.signed, struct.pack("<II", *rules.signature(self.optics.frames))

    def _abort(self, _: bytes) -> int:
        if self.drawing.on:
            return OK
        self._write_one(rules.CONTROL, rules.ABORT)
        while self.optics.status() & (rules.OCCUPIED | rules.RUNNING | rules.BUSY):
            pass
        self.signing = False
        return OK

    def _reset(self, _: bytes) -> int:
        self.log.append(("reset",))
        self.registers, self.optics, self.drawing = rules.at_reset(), rules.Optics(), rules.Drawing()
        self.signing, self.epoch = False, 0
        return OK

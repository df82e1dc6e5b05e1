"""The board's side of the protocol, from docs/reference/protocol.md, over the rules of the test's neighbours."""

import struct

import rules

HELLO, READ, WRITE, TILE, PRESENT, TILES, TRACE, SIGN = KINDS = range(1, 9)
(OK, UNKNOWN, LENGTH, ADDRESS, STALE, BAD_TILE, FRAME_CRC, NO_TILE, VERSION, OPTICS) = range(10)


def request(kind: int, number: int, body: bytes = b"") -> bytes:
    return struct.pack("<BH", kind, number) + body


class Reference:
    """Replies to requests one after the other, and keeps what they must have done."""

    def __init__(self, width: int, height: int, clock_hz: int, identity: int, epoch: int):
        self.width, self.height, self.clock_hz, self.identity, self.epoch = width, height, clock_hz, identity, epoch
        self.tiles = -(-width // 32) * -(-height // 32)
        self.registers = rules.at_reset()
        self.frames = self.stale = self.tile_bad = 0
        self.executed: tuple[int, int] | None = None
        self.executed_status = OK
        self.newest = self.nonce = 0
        #: What was done, in order; the source is looked at when rays come.
        self.log: list[tuple] = []

    def reply(self, packet: bytes) -> bytes:
        kind, number = struct.unpack("<BH", packet[:3])
        status, rest = self._execute(kind, number, packet[3:])
        if (number - self.newest) % (1 << 16) < 1 << 15:
            self.newest = number
        if self.executed and (self.newest - self.executed[1]) % (1 << 16) >= 1 << 15:
            self.executed = None
        return struct.pack("<BHB", kind | 0x80, number, status) + (rest if status == OK else b"")

    def _execute(self, kind: int, number: int, body: bytes) -> tuple[int, bytes]:
        if kind not in KINDS:
            return UNKNOWN, b""
        if not self._length_is_right(kind, body):
            return LENGTH, b""
        if kind == HELLO:
            return self._hello(number, body)
        if kind not in (WRITE, SIGN):
            return {
                READ: self._read, TILE: self._tile, PRESENT: self._present, TILES: self._tiles,
                TRACE: self._trace,
            }[kind](body)  # fmt: skip
        if self.executed != (kind, number):
            if self.executed and not 0 < (number - self.executed[1]) % (1 << 16) < 1 << 15:
                self.stale += 1
                return STALE, b""
            self.executed = (kind, number)
            self.executed_status = self._write(body) if kind == WRITE else self._sign()
        return self.executed_status, struct.pack("<II", *rules.signature(self.frames)) if kind == SIGN else b""

    def _length_is_right(self, kind: int, body: bytes) -> bool:
        size = len(body)
        if kind == READ:
            return size == 3 and 1 <= body[2] <= 64
        if kind == WRITE:
            return size % 4 == 2 and 1 <= size // 4 <= 64
        if kind == TILES:
            return size == 5 and 1 <= int.from_bytes(body[3:], "little") <= 512
        if kind == TRACE:
            return size % 16 == 0 and 1 <= size // 16 <= 64
        return size >= 5 if kind == TILE else size == {HELLO: 5, PRESENT: 6, SIGN: 0}[kind]

    def _hello(self, number: int, body: bytes) -> tuple[int, bytes]:
        version, nonce = struct.unpack("<BI", body)
        if version == 1 and nonce != self.nonce:
            self.nonce, self.newest, self.executed = nonce, number, None
        build = self.registers[rules.BUILD]
        told = (1, nonce, self.identity, self.width, self.height, 32, 3200, self.clock_hz, self.epoch, build)
        return (OK if version == 1 else VERSION), struct.pack("<BIQHHBHIHI", *told)

    def _range_is_there(self, first: int, count: int) -> bool:
        wanted = range(first, first + 4 * count, 4)
        return first % 4 == 0 and any(set(wanted) <= set(block) for block in (range(0x100), range(0x200, 0x400)))

    def _read(self, body: bytes) -> tuple[int, bytes]:
        first, count = struct.unpack("<HB", body)
        if not self._range_is_there(first, count):
            return ADDRESS, b""
        found = [self.registers[at] if rules.can_read(at) else 0 for at in range(first, first + 4 * count, 4)]
        return OK, struct.pack(f"<{count}I", *found)

    def _write(self, body: bytes) -> int:
        first, *words = struct.unpack(f"<H{len(body) // 4}I", body)
        if not self._range_is_there(first, len(words)):
            return ADDRESS
        if not all(rules.can_write(first + 4 * k) for k in range(len(words))):
            return ADDRESS
        for k, word in enumerate(words):
            at = first + 4 * k
            if at != rules.SOURCE:
                self.log.append(("write", at, word))
            self.registers[at] = word
        return OK

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

    def _trace(self, body: bytes) -> tuple[int, bytes]:
        self.registers[rules.SOURCE] = 1
        rays = list(struct.iter_unpack("<4I", body))
        self.log += [("ray", *ray) for ray in rays]
        return OK, b"".join(struct.pack("<9I", *rules.exit_ray(ray)) for ray in rays)

    def _sign(self) -> int:
        self.registers[rules.SOURCE] = 0
        self.log.append(("frame",))
        if self.registers[rules.WINDOW] & 1:
            return OPTICS
        self.frames += 1
        return OK

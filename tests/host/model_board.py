"""A board in Python, after the link's specification alone: what the host is tested against where no RTL is needed.

It shares no code with the host but the packages cobs and numpy; QOI is decoded here, step by step.
"""

from __future__ import annotations

import os
import select
import socket
import struct
import threading
import time
import zlib
from collections import Counter, deque
from types import SimpleNamespace

import numpy as np
from cobs import cobs
from serial.urlhandler import protocol_socket

# pyserial rests for 0.3 s whenever it closes a socket; the tests close many.
protocol_socket.time = SimpleNamespace(sleep=lambda seconds: None)

OK, UNKNOWN, LENGTH, ADDRESS, STALE, BAD_TILE, CRC_DIFFERS, NO_TILE, VERSION, OPTICS = range(10)
MAX_PACKET = 3200
OPTICS_BUILD = 0x2AD7


class RefusedError(Exception):
    def __init__(self, status):
        super().__init__(status)
        self.status = status


def qoi_pixels(data, count):
    """Decode QOI's operations for `count` pixels; return their bytes, or None for bad data."""
    index = [(0, 0, 0)] * 64
    r = g = b = 0
    out = bytearray()
    at = 0
    try:
        while at < len(data):
            tag = data[at]
            at += 1
            run = 1
            if tag == 0xFF:
                return None
            if tag == 0xFE:
                r, g, b = data[at], data[at + 1], data[at + 2]
                at += 3
            elif tag >> 6 == 0:
                r, g, b = index[tag]
            elif tag >> 6 == 1:
                r, g, b = (r + (tag >> 4 & 3) - 2) & 255, (g + (tag >> 2 & 3) - 2) & 255, (b + (tag & 3) - 2) & 255
            elif tag >> 6 == 2:
                green = (tag & 63) - 32
                red, blue = (data[at] >> 4) - 8 + green, (data[at] & 15) - 8 + green
                at += 1
                r, g, b = (r + red) & 255, (g + green) & 255, (b + blue) & 255
            else:
                run = (tag & 63) + 1
            index[(3 * r + 5 * g + 7 * b + 11 * 255) % 64] = (r, g, b)
            out += bytes((r, g, b)) * run
            if len(out) > 3 * count:
                return None
    except IndexError:
        return None
    return bytes(out) if len(out) == 3 * count else None


class ModelBoard:
    """Serves TCP (`url`), or a pty; the state outlives connections, and ends with `power_cycle`."""

    def __init__(self, width=96, height=72, identity=0x79EE8471D40B2533, pty=False, latency_s=0.0, delay_s=0.0):
        self.width, self.height, self.identity = width, height, identity
        self.columns = -(-width // 32)
        self.tiles = self.columns * -(-height // 32)
        self.version = 1
        #: Work on each request, and how long replies are on their way, s.
        self.latency_s = latency_s
        self.delay_s = delay_s
        #: Every frame shown, the blank one at reset not counted.
        self.shown = []
        #: Good TILE packets by tile, requests carried out by type, and by status.
        self.tile_writes = Counter()
        self.executed = Counter()
        self.statuses = Counter()
        self.writes = []
        self.longest = 0
        #: While set, nothing is read.
        self.stalled = threading.Event()
        #: While set, requests are carried out and no reply is given.
        self.mute = False
        #: Numbers of packets that it does not hear.
        self.deaf = set()
        #: Called with (board, packet number) before a packet is looked at.
        self.on_packet = None
        self.packets = 0
        self._lock = threading.RLock()
        self._ended = threading.Event()
        self.power_cycle()
        if pty:
            self._master, self._slave = os.openpty()
            import tty

            tty.setraw(self._slave)
            self.url = os.ttyname(self._slave)
            self._thread = threading.Thread(target=self._serve_pty, daemon=True)
        else:
            self._listener = socket.create_server(("127.0.0.1", 0))
            self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
            self._thread = threading.Thread(target=self._serve_tcp, daemon=True)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()

    def power_cycle(self):
        with self._lock:
            self.buffers = [np.zeros((self.height, self.width, 3), np.uint8) for _ in range(2)]
            self.tables = [[0] * self.tiles, [0] * self.tiles]
            self.front = 0
            self.epoch = 0
            self.last_crc = None
            self.last_done = None
            self.registers = dict.fromkeys([*range(0, 0x40, 4), *range(0x200, 0x300, 4)], 0)
            self.held = b""

    # --- the line -----------------------------------------------------------------------------------

    def _serve_tcp(self):
        with self._listener:
            while not self._ended.is_set():
                if select.select([self._listener], [], [], 0.02)[0]:
                    with self._listener.accept()[0] as line:
                        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                        self._talk(line.fileno())

    def _serve_pty(self):
        self._talk(self._master)
        os.close(self._master)
        os.close(self._slave)

    def _talk(self, line):
        answers = deque()
        while not self._ended.is_set():
            ready = not self.stalled.is_set() and select.select([line], [], [], 0.002 if answers else 0.02)[0]
            try:
                if ready:
                    data = os.read(line, 4096)
                    if not data:
                        return
                    answers.append((time.monotonic() + self.delay_s, self.take(data)))
                elif not answers:
                    time.sleep(0.001)
                while answers and answers[0][0] <= time.monotonic():
                    answer = answers.popleft()[1]
                    while answer:
                        answer = answer[os.write(line, answer) :]
            except OSError:
                return

    def take(self, data):
        """Take bytes of the line; return what goes back."""
        with self._lock:
            *packets, self.held = (self.held + data).split(b"\0")
            # Longer than any packet: all that matters is that it stays so.
            self.held = self.held[: 2 * MAX_PACKET]
            self.longest = max(self.longest, len(self.held))
            return b"".join(self._reply(packet) for packet in packets if packet)

    def _reply(self, stuffed):
        self.packets += 1
        if self.on_packet:
            self.on_packet(self, self.packets)
        if self.packets in self.deaf:
            return b""
        try:
            packet = cobs.decode(stuffed)
        except cobs.DecodeError:
            return b""
        if not 7 <= len(packet) <= MAX_PACKET or struct.pack("<I", zlib.crc32(packet[:-4])) != packet[-4:]:
            return b""
        time.sleep(self.latency_s)
        kind, seq = struct.unpack("<BH", packet[:3])
        body = packet[3:-4]
        try:
            answer = bytes([OK]) + self._do(kind, seq, body)
        except RefusedError as refused:
            answer = bytes([refused.status])
        self.statuses[answer[0]] += 1
        packet = struct.pack("<BH", kind | 0x80, seq) + answer
        if self.mute:
            return b""
        return cobs.encode(packet + struct.pack("<I", zlib.crc32(packet))) + b"\0"

    # --- requests -----------------------------------------------------------------------------------

    def _do(self, kind, seq, body):
        known = {1: self._hello, 2: self._read, 3: self._write, 4: self._tile, 5: self._present, 6: self._tiles}
        known |= {7: self._trace, 8: self._sign}
        if kind not in known:
            raise RefusedError(UNKNOWN)
        if kind in (3, 8) and self.last_done and self.last_done[0] == (kind, seq):
            if self.last_done[1]:
                raise RefusedError(self.last_done[1])
            return self.last_done[2]
        self.executed[kind] += 1
        status, answer = OK, b""
        try:
            answer = known[kind](body)
        except struct.error:
            status = LENGTH
        except RefusedError as refused:
            status = refused.status
        if kind in (3, 8):
            self.last_done = (kind, seq), status, answer
        if status:
            raise RefusedError(status)
        return answer

    def _hello(self, body):
        version, nonce = struct.unpack("<BI", body)
        if version != self.version:
            raise RefusedError(VERSION)
        self.last_done = None
        limits = self.identity, self.width, self.height, 32, MAX_PACKET, 50_000_000, self.epoch, OPTICS_BUILD
        return struct.pack("<BIQHHBHIHI", version, nonce, *limits)

    def _read(self, body):
        address, count = struct.unpack("<HB", body)
        addresses = range(address, address + 4 * count, 4)
        if not 1 <= count <= 64:
            raise RefusedError(LENGTH)
        if not all(a in self.registers for a in addresses):
            raise RefusedError(ADDRESS)
        return struct.pack(f"<{count}I", *(self.registers[a] for a in addresses))

    def _write(self, body):
        count = (len(body) - 2) // 4
        address, *words = struct.unpack(f"<H{count}I", body)
        if not 1 <= count <= 64:
            raise RefusedError(LENGTH)
        addresses = range(address, address + 4 * count, 4)
        if not all(a in self.registers for a in addresses):
            raise RefusedError(ADDRESS)
        self.writes.append((address, tuple(words)))
        self.registers.update(zip(addresses, words, strict=True))
        return b""

    def _tile(self, body):
        epoch, tile, coding = struct.unpack("<HHB", body[:5])
        data = body[5:]
        if epoch != self.epoch:
            raise RefusedError(STALE)
        if tile >= self.tiles:
            raise RefusedError(NO_TILE)
        back = 1 - self.front
        row, column = divmod(tile, self.columns)
        place = slice(32 * row, 32 * row + 32), slice(32 * column, 32 * column + 32)
        view = self.buffers[back][place]
        count = view.shape[0] * view.shape[1]
        self.tables[back][tile] = 0
        if coding == 0:
            pixels = data if len(data) == 3 * count else None
        elif coding == 1:
            pixels = data * count if len(data) == 3 else None
        elif coding == 2:
            pixels = qoi_pixels(data, count)
        elif coding == 3 and not data:
            pixels = self.buffers[self.front][place].tobytes()
        else:
            pixels = None
        if pixels is None:
            raise RefusedError(BAD_TILE)
        view[:] = np.frombuffer(pixels, np.uint8).reshape(view.shape)
        self.tables[back][tile] = zlib.crc32(pixels)
        self.tile_writes[tile] += 1
        return struct.pack("<H", tile)

    def _present(self, body):
        epoch, crc = struct.unpack("<HI", body)
        if (epoch + 1) % 65536 == self.epoch and crc == self.last_crc:
            return struct.pack("<H", self.epoch)
        if epoch != self.epoch:
            raise RefusedError(STALE)
        back = self.buffers[1 - self.front]
        if zlib.crc32(back.tobytes()) != crc:
            raise RefusedError(CRC_DIFFERS)
        self.front = 1 - self.front
        self.epoch = (self.epoch + 1) % 65536
        self.last_crc = crc
        self.shown.append(back.copy())
        return struct.pack("<H", self.epoch)

    def _tiles(self, body):
        buffer, first, count = struct.unpack("<BHH", body)
        if buffer > 1 or not 1 <= count <= 512:
            raise RefusedError(LENGTH)
        if first + count > self.tiles:
            raise RefusedError(NO_TILE)
        table = self.tables[self.front if buffer else 1 - self.front]
        return struct.pack(f"<HH{count}I", self.epoch, first, *table[first : first + count])

    def _trace(self, body):
        rays = np.frombuffer(body, "<i4")
        if not len(rays) or len(rays) % 4 or len(rays) > 256:
            raise RefusedError(LENGTH)
        u, v, a, b = rays.reshape(-1, 4).T
        # Any nine words of each ray will do.
        return np.stack([u, v, a, b, u - v, a - b, -u, -v, u & 7], axis=1).astype("<i4").tobytes()

    def _sign(self, body):
        if body:
            raise RefusedError(LENGTH)
        if self.registers[0x200] == 0xBAD:
            raise RefusedError(OPTICS)
        return struct.pack("<II", 4711, 0x12345678)

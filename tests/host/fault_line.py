"""A line with faults: a seeded proxy between host and board that damages bytes as cables, adapters and drivers do."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
import time
import tty
from collections import Counter
from dataclasses import dataclass

import numpy as np
from lippmann.board.packets import DELIMITER, MAX_STUFFED
from lippmann.board.port import BITS_A_BYTE, open_port
from lippmann.errors import DeviceError

#: Longest chunk that is passed on at once: bytes, and time on a paced line in s.
CHUNK_BYTES = 4096
CHUNK_S = 0.002
#: Pause between two checks whether the proxy is to end, s.
LOOK_S = 0.05
#: Longest lag that a paced line makes up for, s.
MAX_LAG_S = 0.25


@dataclass(frozen=True)
class Faults:
    """Probabilities of faults in one direction."""

    # Per byte: one bit is inverted, the byte is lost, followed by a random byte, sent twice, or replaced by a random
    # byte (garble = 1 simulates a wrong baud rate).
    flip: float = 0.0
    drop: float = 0.0
    insert: float = 0.0
    duplicate: float = 0.0
    garble: float = 0.0
    # Per byte: the next two runs of `run` bytes change places, the next run is lost, or the line stops for `stall_s`.
    reorder: float = 0.0
    cut: float = 0.0
    stall: float = 0.0
    # Per packet: it is lost, sent twice, or sent after the next one.
    lose: float = 0.0
    repeat: float = 0.0
    swap: float = 0.0
    run: int = 64
    stall_s: float = 0.2
    #: Delay of each chunk, s.
    delay_s: float = 0.0


#: A line without faults.
NO_FAULTS = Faults()
#: Faults of a bad line that still lets something through.
FAULTS = {
    **{name: Faults(**{name: 1e-4}) for name in ("flip", "drop", "insert", "duplicate", "garble")},
    "reorder": Faults(reorder=1e-4, run=32),
    "cut": Faults(cut=3e-5, run=2000),
    "stall": Faults(stall=2e-5, stall_s=0.3),
    "delay": Faults(delay_s=0.01),
    "lose": Faults(lose=0.1),
    "repeat": Faults(repeat=0.3),
    "swap": Faults(swap=0.2),
    "all": Faults(3e-5, 3e-5, 3e-5, 3e-5, 3e-5, 1e-5, 1e-5, 1e-5, 0.02, 0.05, 0.05, stall_s=0.05),
}


class Mangler:
    """Puts faults into the bytes of one direction; `done` counts the faults of each kind.

    Each kind has its own random generator and draws one number per byte or packet, so the faults depend on the seed and
    on the bytes, not on the size of the chunks.
    """

    def __init__(self, seed, direction):
        self.done = Counter()
        self._seed = seed, direction
        self._generators = {}
        self._packet = bytearray()
        self._behind = b""
        self._cutting = 0

    def __call__(self, data, faults):
        """Return bytes with faults, and the pause before them, s."""
        data = self._packets(data, faults)
        if faults == NO_FAULTS:
            self._cutting = 0
            return data, 0.0
        rest_s = faults.delay_s + faults.stall_s * int(self._hits("stall", len(data), faults.stall).sum())
        values = np.frombuffer(data, np.uint8).copy()
        for start in np.flatnonzero(self._hits("reorder", len(values), faults.reorder)):
            first, second = np.split(values[start : start + 2 * faults.run], [faults.run])
            values[start : start + len(first) + len(second)] = np.concatenate([second, first])
        garbled = self._hits("garble", len(values), faults.garble)
        values[garbled] = self._values("garble", int(garbled.sum()))
        flipped = self._hits("flip", len(values), faults.flip)
        values[flipped] ^= np.uint8(1) << (self._values("flip", int(flipped.sum())) & np.uint8(7))
        copies = np.ones(len(values), np.int64)
        copies[self._hits("duplicate", len(values), faults.duplicate)] = 2
        copies[self._hits("drop", len(values), faults.drop)] = 0
        copies[self._cut(len(values), faults)] = 0
        inserted = self._hits("insert", len(values), faults.insert)
        extra = self._values("insert", int(inserted.sum()))
        values = np.insert(values, np.flatnonzero(inserted) + 1, extra)
        copies = np.insert(copies, np.flatnonzero(inserted) + 1, 1)
        return np.repeat(values, copies).tobytes(), rest_s

    def _generator(self, kind):
        if kind not in self._generators:
            self._generators[kind] = np.random.default_rng([*self._seed, *kind.encode()])
        return self._generators[kind]

    def _hits(self, kind, count, chance):
        """Return which of the next bytes or packets a fault hits."""
        if not chance:
            return np.zeros(count, np.bool_)
        hits = self._generator(kind).random(count) < chance
        self.done[kind] += int(hits.sum())
        return hits

    def _values(self, kind, count):
        # Narrow integers are drawn several at once, which would depend on the chunks.
        return self._generator(kind + " values").integers(0, 256, count).astype(np.uint8)

    def _cut(self, count, faults):
        """Return which of the next bytes lie in a run that is lost."""
        lost = np.zeros(count, np.bool_)
        starts = np.flatnonzero(self._hits("cut", count, faults.cut)).tolist()
        for start, length in [(0, self._cutting), *((start, faults.run) for start in starts)]:
            lost[start : start + length] = True
            self._cutting = max(start + length - count, 0)
        return lost

    def _packets(self, data, faults):
        """Lose, repeat and swap whole packets; without such faults, return all bytes, held ones first."""
        if not (faults.lose or faults.repeat or faults.swap):
            out = self._behind + bytes(self._packet) + data
            self._packet.clear()
            self._behind = b""
            return out
        self._packet += data
        out = b""
        while (end := self._packet.find(DELIMITER) + 1) or len(self._packet) > MAX_STUFFED:
            end = end or len(self._packet)
            packet = bytes(self._packet[:end])
            del self._packet[:end]
            lost, twice, later = (self._hits(kind, 1, getattr(faults, kind))[0] for kind in ("lose", "repeat", "swap"))
            packet = b"" if lost else packet * 2 if twice else packet
            if later and not self._behind:
                self._behind = packet
            else:
                out += packet + self._behind
                self._behind = b""
        return out


class Proxy:
    """A line with faults between `url`, which the host opens, and the board at `board_url`.

    On TCP each connection of the host opens one to the board; on a pty the connection stays open. `down` (faults to the
    board) and `up` may be set at any time. `baud` limits the rate of both directions, 10 bits a byte; None: no limit.
    """

    def __init__(self, board_url, seed, down=NO_FAULTS, up=NO_FAULTS, baud=None, pty=False):
        self.down, self.up, self.baud = down, up, baud
        self._board_url = board_url
        self._manglers = Mangler(seed, 0), Mangler(seed, 1)
        #: Numbers of faults of each kind, down and up.
        self.done = self._manglers[0].done, self._manglers[1].done
        self._ended = threading.Event()
        self._unplugged = threading.Event()
        self._down_bytes = None
        if pty:
            master, slave = os.openpty()
            os.set_blocking(master, False)
            self.url = os.ttyname(slave)
            # The slave stays open here while hosts open and close it.
            self._thread = threading.Thread(target=self._serve_pty, args=(master, slave), daemon=True)
        else:
            listener = socket.create_server(("127.0.0.1", 0))
            self.url = f"socket://127.0.0.1:{listener.getsockname()[1]}"
            self._thread = threading.Thread(target=self._serve_tcp, args=(listener,), daemon=True)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def restore(self):
        self.down = self.up = NO_FAULTS

    def unplug(self):
        """Close the host's connection; it may connect again."""
        self._unplugged.set()

    def unplug_after(self, count):
        """Close the connection when `count` more bytes have gone to the board over TCP, which takes all of them."""
        self._down_bytes = count

    def close(self):
        self._ended.set()
        self._thread.join()

    def _serve_tcp(self, listener):
        with listener:
            while not self._ended.is_set():
                if not select.select([listener], [], [], LOOK_S)[0]:
                    continue
                host = listener.accept()[0]
                with host:
                    host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    host.setblocking(False)
                    self._connect(host.fileno())

    def _serve_pty(self, master, slave):
        try:
            tty.setraw(slave)
            while not self._ended.is_set():
                self._connect(master)
                self._ended.wait(LOOK_S)
        finally:
            os.close(master)
            os.close(slave)

    def _connect(self, host):
        """Connect the host to the board until either closes."""
        try:
            port = open_port(self._board_url)
        except DeviceError:
            return
        self._unplugged.clear()
        self._down_bytes = None
        gone = threading.Event()
        try:
            board = port.fileno()
            up = threading.Thread(target=self._carry, args=(board, host, 1, gone), daemon=True)
            up.start()
            self._carry(host, board, 0, gone)
            up.join()
        finally:
            port.close()

    def _carry(self, source, target, direction, gone):
        """Copy bytes in one direction until a side has closed."""
        due = time.monotonic()
        # A side that has closed ends both directions.
        with contextlib.suppress(OSError):
            while not self._over(gone):
                ready = select.select([source], [], [], 0.0)[0]
                if not ready:
                    ready = select.select([source], [], [], LOOK_S)[0]
                    # The line was idle: no lag to make up for.
                    due = max(due, time.monotonic())
                    if not ready:
                        continue
                limit = CHUNK_BYTES
                if self.baud:
                    limit = min(limit, max(int(self.baud / BITS_A_BYTE * CHUNK_S), 1))
                data = os.read(source, limit)
                if not data:
                    break
                if self.baud:
                    due = max(due, time.monotonic() - MAX_LAG_S) + len(data) * BITS_A_BYTE / self.baud
                    time.sleep(max(due - time.monotonic(), 0.0))
                data, rest_s = self._manglers[direction](data, self.up if direction else self.down)
                if rest_s:
                    gone.wait(rest_s)
                if direction or self._down_bytes is None:
                    self._write(target, data, gone)
                    continue
                self._write(target, data[: self._down_bytes], gone)
                self._down_bytes = max(self._down_bytes - len(data), 0)
                if not self._down_bytes:
                    # The board reads to the end, then closes; a port closed here could lose what it has not read.
                    with socket.socket(fileno=os.dup(target)) as board:
                        board.shutdown(socket.SHUT_WR)
                    return
        gone.set()

    def _write(self, target, data, gone):
        """Write all bytes, as fast as the target accepts them."""
        while data and not self._over(gone):
            if select.select([], [target], [], LOOK_S)[1]:
                with contextlib.suppress(BlockingIOError):
                    data = data[os.write(target, data) :]

    def _over(self, gone):
        return gone.is_set() or self._ended.is_set() or self._unplugged.is_set()

"""Requests that meet a running frame: each is answered in time, none gets another's rays, and the board goes on."""

import os
import struct
import time
import zlib

import numpy as np
import pytest
from board_scenes import HEIGHT, WIDTH, display_of
from lippmann.board.board import Board
from lippmann.board.packets import packed
from lippmann.fixed.configuration import configuration
from lippmann.fixed.raster import TABLE_ENTRIES, Raster, raster
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.registers import BOARD_REGISTERS, optics_writes, raster_writes
from lippmann.simulation import virtual_board

SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))
#: Longest time of an answer, s; the longest of these takes the simulator some hundredths.
SOON = 5.0
# Numbers of docs/reference/protocol.md.
HELLO, READ, WRITE, TILE, PRESENT, TILES, TRACE, SIGN, ABORT, RESET = range(1, 11)
OK, LENGTH, ADDRESS, STALE, OPTICS, BUSY, ABORTED = 0, 2, 3, 4, 9, 10, 11
FRAME_RUNS, SIGN_RUNS, THIS_RUNS = 1, 2, 3
CONTROL, SOURCE, COLUMNS, SEED_AT = 0x20C, 0x214, 0x2C0, 0x2D0
APPLY, START, ABORT_BIT = 1, 2, 4

DISPLAY = display_of("square")
BUILD = virtual_board.board_build(DISPLAY)
OPTICS_WORDS = configuration(DISPLAY, BUILD, "exact")
#: Frames of 17920 rays, of 65 million, of 12, and none.
SHORT = Raster(WIDTH, HEIGHT, (0, WIDTH - 1), (0, HEIGHT - 1), samples=2, jitter="lfsr", seed=SEED or 1)
SMALL = Raster(WIDTH, HEIGHT, (5, 8), (7, 9))


class Raw:
    """A board, asked packet by packet."""

    def __init__(self, url):
        self.board = Board.open(url)

    def __enter__(self):
        self.board.write_all([*optics_writes(OPTICS_WORDS), *raster_writes(SHORT)])
        return self

    def __exit__(self, *_):
        self.board.close()

    def ask(self, kind, body=b"", seq=None):
        """Send one packet; return status and body of its reply."""
        seq = self.board.next_seq() if seq is None else seq
        self.board.line.send(packed(kind, seq, body), 2.0)
        until = time.monotonic() + SOON
        while (reply := self.board.line.receive(max(until - time.monotonic(), 0.0))) is not None:
            if reply.seq == seq and reply.kind == kind | 0x80:
                return reply.body[0], reply.body[1:]
        raise AssertionError(f"no reply to {kind:02x} {body[:16].hex()}")

    def write(self, at, *words):
        return self.ask(WRITE, struct.pack(f"<H{len(words)}I", at, *words))

    def trace(self, count=3):
        return self.ask(TRACE, TRACED[: 16 * count].tobytes())

    def sign(self):
        """Send a SIGN, then the same packet until the frame has ended."""
        seq = self.board.next_seq()
        until = time.monotonic() + 30
        status, body = self.ask(SIGN, seq=seq)
        while status == BUSY and body[0] == THIS_RUNS and time.monotonic() < until:
            time.sleep(0.01)
            status, body = self.ask(SIGN, seq=seq)
        return status, body

    def idle(self):
        """Wait until no frame runs."""
        until = time.monotonic() + 30
        while self.board.read(0x210)[0] & 3:
            assert time.monotonic() < until
            time.sleep(0.01)


RANDOM = np.random.default_rng(SEED)
U, V = RANDOM.integers(-8 * WIDTH, 8 * WIDTH, 64), RANDOM.integers(-8 * HEIGHT, 8 * HEIGHT, 64)
TRACED = np.stack([U, V, 0 * U, 0 * U], axis=1).astype("<i4").view("<u1").reshape(-1)


def rays_of(u, v):
    return np.stack(ray_pipeline(u, v, 0 * u, 0 * u, OPTICS_WORDS, BUILD), axis=1).astype("<i4").tobytes()


def traced(count=3):
    return OK, rays_of(U[:count], V[:count])


def signed(frame):
    words = raster(frame, np.zeros(TABLE_ENTRIES, np.int64), BUILD.fraction_bits)
    return OK, struct.pack("<II", frame.rays, zlib.crc32(rays_of(words.u, words.v)))


@pytest.fixture(scope="module")
def virtual():
    print(f"seed {SEED}")
    with virtual_board.running(DISPLAY) as board:
        yield board


@pytest.fixture
def raw(virtual):
    with Raw(virtual.url) as raw:
        yield raw
        raw.ask(ABORT)


def test_trace_start_sign_trace(raw):
    """The raster is the source again behind a trace: the frame ends without an abort."""
    assert raw.write(SOURCE, 1) == (OK, b"")
    for _ in range(3):
        assert raw.trace() == traced()
        assert raw.board.read(SOURCE) == [0]
        assert raw.write(CONTROL, START) == (OK, b"")
        assert raw.trace()[0] in (OK, BUSY)
        raw.idle()
        assert raw.sign() == signed(SHORT)
    assert raw.trace() == traced()


def test_numbers_halfway_round_are_newer_and_remembered(raw):
    brightness = 0x18

    def write(word, number):
        status, _ = raw.ask(WRITE, struct.pack("<HI", brightness, word), seq=number % 65536)
        return status, raw.board.read(brightness)[0] & 0xFF

    number = raw.board.next_seq()
    assert raw.ask(HELLO, struct.pack("<BI", 2, 0xC0FFEE ^ SEED), seq=number)[0] == OK
    for first in (number + 0x8000, number + 2 * 0x8000):  # the first of a session, then one after another
        assert write(11, first) == (OK, 11)
        assert write(12, first) == (OK, 11), "executed once"
        assert write(13, first - 1) == (STALE, 11)


def test_a_sign_counts_its_own_rays_only(raw):
    """Two starts, then a sign, at any moment of the frames before it."""
    assert raw.sign() == signed(SHORT)
    for k in range(12):
        raw.write(CONTROL, START)
        time.sleep(0.002 * k)
        raw.write(CONTROL, START)
        status, body = raw.sign()
        while status == BUSY:
            assert body[0] == FRAME_RUNS
            status, body = raw.sign()
        assert (status, body) == signed(SHORT)


def test_a_sign_after_frames_that_the_stream_held(raw):
    for _ in range(5):
        assert raw.write(SOURCE, 1)[0] == OK
        assert raw.write(CONTROL, APPLY)[0] == OK
        assert raw.write(CONTROL, START)[0] == OK
        assert raw.ask(SIGN) == (BUSY, struct.pack("<BI", FRAME_RUNS, 0))
        assert raw.write(CONTROL, START) == (BUSY, struct.pack("<BI", FRAME_RUNS, 0))
        assert raw.ask(ABORT) == (OK, b"")
        assert raw.sign() == signed(SHORT)


def test_a_board_answers_while_it_signs(raw):
    """A window of 65536 rays a pixel takes the board days: all else is answered meanwhile, and an abort ends it."""
    first, second = raw.board.read(COLUMNS, 2)
    jitter = raw.board.read(0x2CC)[0]
    assert raw.write(0x2CC, jitter & ~0xFFFF) == (OK, b"")
    seq = raw.board.next_seq()
    status, body = raw.ask(SIGN, seq=seq)
    assert (status, body[0]) == (BUSY, THIS_RUNS)
    counts = [struct.unpack("<I", body[1:])[0]]
    assert raw.ask(READ, struct.pack("<HB", COLUMNS, 2)) == (OK, struct.pack("<2I", first, second))
    for answer in (raw.trace(), raw.write(CONTROL, START), raw.write(COLUMNS, 0), raw.ask(SIGN)):
        assert (answer[0], answer[1][0], len(answer[1])) == (BUSY, SIGN_RUNS, 5)
        counts.append(struct.unpack("<I", answer[1][1:])[0])
    assert raw.write(BOARD_REGISTERS["display"].address, 0xFF) == (OK, b"")
    assert raw.ask(TILE, struct.pack("<HHB", raw.board.info.epoch, 0, 1) + b"abc") == (OK, b"\0\0")
    assert raw.ask(TILES, struct.pack("<BHH", 0, 0, 1))[0] == OK
    # The last one executed is the WRITE: the sign's number is an old one now.
    assert raw.ask(SIGN, seq=seq) == (STALE, b"")
    assert counts == sorted(counts)
    assert counts[-1] > counts[0]
    assert raw.ask(ABORT) == (OK, b"")
    assert not raw.board.read(0x210)[0] & 0b1011
    assert raw.write(0x2CC, jitter) == (OK, b"")
    assert raw.sign() == signed(SHORT)


def test_an_aborted_sign_says_so(raw):
    jitter = raw.board.read(0x2CC)[0]
    assert raw.write(0x2CC, jitter & ~0xFFFF) == (OK, b"")
    assert raw.ask(SIGN)[0] == BUSY
    aborted = raw.board.next_seq()
    assert raw.ask(ABORT, seq=aborted) == (OK, b"")
    assert raw.write(0x2CC, jitter) == (OK, b"")
    # A late copy of the abort ends no later frame.
    seq = raw.board.next_seq()
    assert raw.ask(SIGN, seq=seq)[0] == BUSY
    assert raw.ask(ABORT, seq=aborted) == (STALE, b"")
    while (answer := raw.ask(SIGN, seq=seq))[0] == BUSY:
        pass
    assert answer == signed(SHORT)


def test_a_reset_over_the_line(raw):
    """The board is as after power-up, and the packets behind the reset are answered."""
    display = BOARD_REGISTERS["display"].address
    assert raw.write(display, 0x7F) == (OK, b"")
    assert raw.write(CONTROL, START) == (OK, b"")
    tile = struct.pack("<HHB", raw.board.info.epoch, 3, 1) + b"abc"
    assert raw.ask(TILE, tile) == (OK, b"\3\0")
    assert raw.board.tiles(0).crcs[3] != 0
    seq = raw.board.next_seq()
    late = raw.board.next_seq()
    raw.board.line.send(packed(RESET, seq, b"") + packed(READ, late, struct.pack("<HB", display, 1)), 2.0)
    answers = [raw.board.line.receive(SOON) for _ in range(2)]
    assert answers == [(RESET | 0x80, seq, b"\0"), (READ | 0x80, late, b"\0" + struct.pack("<I", 0xFF))]
    assert not raw.board.tiles(0).crcs.any()
    assert raw.board.read(BOARD_REGISTERS["counters_packets"].address)[0] < 20
    assert raw.board.read(SEED_AT)[0] == 1
    raw.board.write_all([*optics_writes(OPTICS_WORDS), *raster_writes(SMALL)])
    assert raw.sign() == signed(SMALL)
    # The same packet again does not reset again.
    assert raw.ask(RESET, seq=seq) == (STALE, b"")
    assert raw.ask(READ, struct.pack("<HB", SEED_AT, 1)) == (OK, struct.pack("<I", 1))

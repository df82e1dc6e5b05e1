"""Whole frames of 1280 x 720 from an SDRAM: no pixel is late while tiles come, frames are copied and checked."""

import os
import zlib

import numpy as np
import pytest
from board_scenes import display_of
from lippmann.board.board import Board
from lippmann.board.port import BITS_A_BYTE
from lippmann.board.streaming import send_frame
from lippmann.board.virtual_loop import PATIENCE_S
from lippmann.fixed.registers import BOARD_REGISTERS
from lippmann.simulation import virtual_board

SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))
WIDTH, HEIGHT = 1280, 720
#: Of the line in the figures that are promised, and the clocks of a frame at 60 a second.
BAUD, FRAME_CLOCKS = 3_000_000, 1650 * 750
FRAMES = 40


@pytest.mark.full
def test_no_pixel_is_late_while_frames_are_streamed_copied_and_checked(tmp_path):
    rng = np.random.default_rng([SEED, 41])
    print(f"seed {SEED}")
    counter = {name: BOARD_REGISTERS[name].address for name in ("frames", "counters_late", "shown_crc")}
    image = rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    sent = []
    with (
        virtual_board.running(display_of("square", (WIDTH, HEIGHT)), memory="sdram", capture=tmp_path) as running,
        Board.open(running.url, patience_s=PATIENCE_S) as board,
    ):
        clock_hz = board.info.clock_hz
        first, written, copied = board.read(counter["frames"])[0], board.line.written, 0
        while board.read(counter["frames"])[0] - first < FRAMES:
            # A band of new tiles; the others are copied on the board, or are there from two frames ago.
            top = int(rng.integers(0, HEIGHT - 96))
            image = image.copy()
            image[top : top + 96] = rng.integers(0, 256, (96, WIDTH, 3), np.uint8)
            result = send_frame(board, image)
            copied += result.copied
            sent.append(image.tobytes())
        shown = board.read(counter["frames"])[0] - first
        rate = (board.line.written - written) * BITS_A_BYTE * clock_hz / (shown * FRAME_CLOCKS)
        print(f"{shown} frames, {len(sent)} sent, {copied} tiles copied, the line at {rate / 1e6:.1f} Mbaud")
        assert copied > 0
        assert rate >= BAUD
        assert board.read(counter["counters_late"]) == [0]
        until = board.read(counter["frames"])[0] + 2
        while board.read(counter["frames"])[0] < until:
            pass
        assert board.read(counter["shown_crc"]) == [zlib.crc32(sent[-1])]
        assert running.stop()["memory_violations"] == 0
    allowed = {*sent, bytes(3 * WIDTH * HEIGHT)}
    captured = [path.read_bytes() for path in tmp_path.glob("frame-*.rgb")]
    assert len(captured) > 2
    assert all(frame in allowed for frame in captured)

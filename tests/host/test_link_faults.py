"""The fault line against the model board: frames shown are frames sent, and the host ends in time."""

import time

import numpy as np
import pytest
from fault_line import FAULTS, NO_FAULTS, Faults, Proxy
from lippmann.board.board import Board
from lippmann.board.port import SEND_S
from lippmann.board.streaming import send_frame
from lippmann.errors import DeviceError, NoBoardError
from model_board import ModelBoard
from scene_cases import generator

SEED = 4504
FAST_BAUD = 12_000_000
PATIENCE_S = 8.0
#: Bound of a frame on a bad line that still lets something through; what is measured is a tenth.
FRAME_S = 30.0

#: Replies are short: a byte of theirs is hit often enough to matter.
UP = {
    **{name: Faults(**{name: 0.004}) for name in ("flip", "drop", "insert", "duplicate", "garble")},
    "reorder": Faults(reorder=0.004, run=8),
    "cut": Faults(cut=0.003, run=40),
    "stall": Faults(stall=0.003, stall_s=0.3),
    "lose": Faults(lose=0.2),
    "repeat": Faults(repeat=0.3),
    "swap": Faults(swap=0.2),
}


def frames(model, *key):
    """Two frames of noise with a part that codes well, the second a little different."""
    rng = generator(SEED, *key)
    first = rng.integers(0, 256, (model.height, model.width, 3), np.uint8)
    first[40:90] = np.arange(model.width, dtype=np.uint8)[None, :, None]
    second = first.copy()
    second[60:140] = rng.integers(0, 256, (80, model.width, 3), np.uint8)
    return first, second


def stream_through(pty, down, up, *key):
    """Stream two frames over a bad line and one when the line is back; return resends, and the faults each way."""
    seed = SEED + sum(map(ord, "".join(key)))
    print(f"proxy seed {seed}")
    resends = 0
    with ModelBoard(256, 160, pty=pty) as model:
        first, second = frames(model, *key)
        with Proxy(model.url, seed, down, up, pty=pty) as line, Board.open(line.url, FAST_BAUD, PATIENCE_S) as board:
            for image in (first, second):
                begun = time.monotonic()
                resends += send_frame(board, image).resends
                assert time.monotonic() - begun < FRAME_S
                np.testing.assert_array_equal(model.buffers[model.front], image)
            line.restore()
            begun = time.monotonic()
            send_frame(board, first)
            assert time.monotonic() - begun < PATIENCE_S
    # No frame but those, and none twice.
    np.testing.assert_array_equal(model.shown, [first, second, first])
    return resends, line.done


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_on_the_way_to_the_board(fault):
    resends, (down, _) = stream_through(True, FAULTS[fault], NO_FAULTS, fault)
    assert down[fault] or fault in ("delay", "all")
    assert resends or fault in ("stall", "delay", "repeat", "swap")


@pytest.mark.parametrize("fault", UP)
def test_faults_on_the_way_back(fault):
    _, (_, up) = stream_through(True, NO_FAULTS, UP[fault], "up", fault)
    # A reply that is lost need not cost a resend: a later one may tell of the same tile.
    assert up[fault]


def test_the_first_request_after_an_outage_is_repeated_as_often():
    """The time-out that grew while the line was dead would leave it one send, which noise can swallow."""
    sends = []
    with ModelBoard(256, 160) as model, Proxy(model.url, SEED) as line, Board.open(line.url, FAST_BAUD, 1.0) as board:
        line.down = Faults(lose=1.0)
        for _ in range(2):
            before = line.done[0]["lose"]
            with pytest.raises(NoBoardError):
                board.hello()
            sends.append(line.done[0]["lose"] - before)
    assert min(sends) >= 3


@pytest.mark.parametrize(
    ("down", "up"),
    [
        (Faults(lose=1.0), NO_FAULTS),
        (NO_FAULTS, Faults(garble=1.0)),
        (Faults(flip=0.5), NO_FAULTS),
        (NO_FAULTS, Faults(drop=0.5)),
    ],
)
def test_a_dead_line_ends_in_time(down, up):
    with ModelBoard(256, 160) as model, Proxy(model.url, SEED) as line, Board.open(line.url, FAST_BAUD, 0.5) as board:
        first, second = frames(model)
        send_frame(board, first)

        def spoil(done, _):
            if done == 2:
                line.down, line.up = down, up

        begun = time.monotonic()
        with pytest.raises(DeviceError, match=r"not answered.*cable"):
            send_frame(board, second, spoil, window_bytes=4000)
        assert time.monotonic() - begun < 0.5 + SEND_S
        np.testing.assert_array_equal(model.shown, [first])
        # The line is back: the frame goes on where it was.
        line.restore()
        sent = send_frame(board, second)
        assert sent.skipped >= 2
    np.testing.assert_array_equal(model.shown, [first, second])


def test_requests_get_through_and_are_done_once():
    with ModelBoard() as model:
        up = Faults(flip=0.003, lose=0.3, repeat=0.2)
        down = Faults(flip=0.003, lose=0.2, repeat=0.2)
        with Proxy(model.url, SEED, down, up) as line, Board.open(line.url, FAST_BAUD, PATIENCE_S) as board:
            expected = []
            for k in range(20):
                board.write(0x200, [k, ~k & 0xFFFFFFFF])
                expected.append((0x200, (k, ~k & 0xFFFFFFFF)))
                assert board.read(0x200, 2) == [k, ~k & 0xFFFFFFFF]
        assert model.writes == expected

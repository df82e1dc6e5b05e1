"""Streaming to the model board: what is sent and what is not, efficiency, resume."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from fault_line import Proxy
from lippmann.base.tones import encode
from lippmann.board import retries
from lippmann.board.board import Board
from lippmann.board.packets import Kind, packed
from lippmann.board.retries import RoundTrip
from lippmann.board.streaming import BoardSink, send_frame
from lippmann.errors import DeviceError, InputError
from lippmann.rendering.executors import RenderedBand
from model_board import ModelBoard
from optics_cases import display_of
from scene_cases import generator
from test_link_board import FAST_BAUD, joined

SEED = 4503


def noise(model, *key):
    return generator(SEED, *key).integers(0, 256, (model.height, model.width, 3), np.uint8)


def test_a_frame_is_shown_as_it_was_sent():
    seen = []
    with joined(width=100, height=70) as (model, board):
        image = noise(model)
        image[0:32, 0:32] = 7
        image[32:64, 32:64] = np.arange(32, dtype=np.uint8)[:, None]
        sent = send_frame(board, image, lambda *step: seen.append(step))
    assert len(model.shown) == 1
    np.testing.assert_array_equal(model.shown[0], image)
    assert (sent.tiles, sent.raw, sent.solid, sent.qoi, sent.copied) == (12, 10, 1, 1, 0)
    assert (sent.sends, sent.resends, sent.skipped, sent.rounds, sent.epoch) == (12, 0, 0, 1, 1)
    assert sent.image_bytes == 100 * 70 * 3
    assert seen == [(k, 12) for k in range(1, 13)]
    assert set(model.tile_writes.values()) == {1}


@pytest.mark.parametrize("reset", [False, True])
def test_rows_are_sent_as_they_come(reset):
    """Each tile once, when its last row has come; a board that is reset in between gets them again."""
    with joined(width=100, height=70) as (model, board):
        image = noise(model)
        display = display_of("hex", "panel", width_px=100, height_px=70)
        rows = BoardSink(board, SimpleNamespace(display=display, bands=(range(70),)), force=True)
        for first, tiles in ((50, 0), (0, 0), (64, 4), (16, 8), (32, 8)):
            last = {50: 64, 64: 70}.get(first, first + 16)
            rows.add_rows(first, image[first:last])
            assert len(model.tile_writes) == tiles
        rows.add_rows(48, image[48:50])
        assert (len(model.tile_writes), model.shown) == (12, [])
        if reset:
            model.power_cycle()
        sent = rows.finish()
    np.testing.assert_array_equal(model.shown, [image])
    assert (sent.tiles, sent.skipped, sent.sends) == (12, 0, 24 if reset else 12)
    assert set(model.tile_writes.values()) == {1 + reset}


def test_a_render_is_sent_band_by_band():
    """The first tiles arrive before the second band is rendered; a render that fails leaves the panel as it was."""
    display = display_of("hex", "panel", width_px=96, height_px=72)
    light = generator(SEED, "render").random((72, 96, 3), np.float32)
    plan = SimpleNamespace(display=display, bands=(range(40), range(40, 72)), rays=1, prepare_seconds=0.0)
    tiles = []
    with joined(identity=int(display.identity, 16)) as (model, board):

        def executor(bands, _, fails=False):
            for band in bands:
                tiles.append(len(model.tile_writes))
                yield RenderedBand(band, light[band.rows.start : band.rows.stop], {})
                if fails:
                    raise DeviceError("all workers are lost; start them again")

        with pytest.raises(DeviceError, match="workers"):
            board.show_render(plan, lambda bands, report: executor(bands, report, fails=True))
        assert (tiles, model.shown) == ([0], [])
        sent = board.show_render(plan, executor)
        assert tiles == [0, 3, 3]
        assert (sent.tiles, sent.skipped + sent.sends) == (9, 9)
    np.testing.assert_array_equal(model.shown, [np.rint(encode(light, "srgb") * 255)])
    with joined() as (model, board), pytest.raises(InputError, match="panel belongs to display"):
        board.show_render(plan, executor)


def test_what_the_board_holds_is_not_sent():
    with joined() as (model, board):
        first, second = noise(model, 1), noise(model, 2)
        send_frame(board, first)
        again = send_frame(board, first)
        assert again.unchanged
        assert (again.sends, again.payload_bytes, again.overhead, again.skipped) == (0, 0, 0.0, again.tiles)
        # One tile of the frame that is shown changes: the others are copied on the board.
        changed = first.copy()
        changed[40, 40] ^= 1
        part = send_frame(board, changed)
        assert (part.raw, part.copied, part.resends) == (1, part.tiles - 1, 0)
        assert send_frame(board, second).raw == part.tiles
        # The back buffer still holds the frame before.
        back = send_frame(board, changed)
        assert (back.sends, back.unchanged, back.skipped) == (0, False, back.tiles)
    for shown, frame in zip(model.shown, [first, changed, second, changed], strict=True):
        np.testing.assert_array_equal(shown, frame)


def test_overhead_of_raw_tiles():
    with joined(width=640, height=480) as (model, board):
        before = board.line.written
        sent = send_frame(board, noise(model))
    assert sent.raw == 300
    assert sent.payload_bytes == sent.image_bytes == 640 * 480 * 3
    assert sent.wire_bytes == board.line.written - before
    # 12 bytes of packet, 13 of COBS at most, one delimiter to 3072 bytes; the tables come on top.
    assert 0.0 < sent.overhead <= 0.01


@pytest.mark.parametrize(("baud", "size"), [(460_800, (128, 96)), (12_000_000, (480, 320))])
def test_efficiency_on_a_paced_line(baud, size):
    """Little but tiles is on the line, and it is never empty: counted, as times tell of the machine's other work."""
    ahead = []
    with ModelBoard(*size) as model, Proxy(model.url, SEED, baud=baud) as line, Board.open(line.url, baud) as board:
        before = board.line.written

        def look(model, _):
            if model.tile_writes:
                received = sum(model.tile_writes.values())
                ahead.append((received, board.line.written - before - received * 3 * 32 * 32))

        model.on_packet = look
        sent = send_frame(board, noise(model))
    least_s = sent.payload_bytes * 10 / baud
    assert sent.resends == 0
    assert sent.raw == sent.tiles
    # A line that is not slowed down would show here.
    assert sent.seconds >= least_s
    assert sent.overhead <= 0.05
    # As a tile arrives, eight are on their way, or all that are left: who waits for replies has sent one.
    enough = [on_the_way >= min(8, sent.tiles - received) * 3 * 32 * 32 for received, on_the_way in ahead]
    assert sum(enough) >= 0.7 * len(enough), ahead


def test_a_tile_spoilt_on_the_board_is_mended():
    with joined() as (model, board):
        image = noise(model)

        def spoil(model, _):
            if all(model.tables[1 - model.front]) and 4 not in spoilt:
                # A reset of one tile, as when its writing was broken off.
                spoilt.add(4)
                model.tables[1 - model.front][4] = 0
                model.buffers[1 - model.front][32:64, 32:64] = 0

        spoilt = set()
        model.on_packet = spoil
        sent = send_frame(board, image)
        assert sent.rounds == 2
        assert model.tile_writes == Counter({k: 1 + (k == 4) for k in range(sent.tiles)})
    np.testing.assert_array_equal(model.shown, [image])


def test_tiles_that_share_a_crc_are_told_apart():
    # Four bytes more turn any CRC-32 into any other: a tile of other content with the CRC of this one.
    with joined(width=32, height=32) as (model, board):
        image = noise(model)
        model.tables[1 - model.front][0] = board.info.grid.crcs(image)[0]
        sent = send_frame(board, image)
        assert (sent.rounds, sent.sends) == (2, 1)
    np.testing.assert_array_equal(model.shown, [image])


def test_codings_and_copies_that_the_board_refuses_are_sent_raw():
    with joined() as (model, board):
        image = np.zeros((model.height, model.width, 3), np.uint8)
        image[:] = np.arange(model.width, dtype=np.uint8)[:, None]
        changed = image.copy()
        changed[0, 0] ^= 1
        original = model._tile
        model._tile = lambda body: original(body if body[4] == 0 else body[:4] + b"\4")
        for frame in (image, changed):
            sent = send_frame(board, frame)
            assert (sent.raw, sent.qoi, sent.copied) == (sent.tiles, 0, 0)
            assert sent.resends == sent.tiles or frame is changed
    np.testing.assert_array_equal(model.shown, [image, changed])


@pytest.mark.parametrize("lost", [{4}, {10, 11, 20}, set(range(5, 15))])
def test_a_loss_that_later_replies_tell_of_waits_for_no_time_out(lost, monkeypatch):
    with joined(width=256, height=160) as (model, board):
        # HELLO and two TILES came before the 40 tiles.
        model.deaf = lost
        # A time-out that no load of this machine brings about.
        monkeypatch.setattr("lippmann.board.retries.SHORTEST_S", 4.0)
        monkeypatch.setattr(RoundTrip, "back_off", lambda _: pytest.fail("waited in vain"))
        image = noise(model)
        sent = send_frame(board, image)
        assert (sent.sends, sent.resends) == (40 + len(lost), len(lost))
    np.testing.assert_array_equal(model.shown, [image])


def test_the_last_packets_are_found_lost_by_time_out(monkeypatch):
    waits = []
    # A loaded machine must not delay the reply beyond the time-out.
    monkeypatch.setattr("lippmann.board.retries.SHORTEST_S", 0.5)
    back_off = RoundTrip.back_off
    monkeypatch.setattr(RoundTrip, "back_off", lambda self: waits.append(back_off(self)))
    with joined(width=256, height=160) as (model, board):
        model.deaf = {41, 42, 43}
        sent = send_frame(board, noise(model))
        # One asks, its reply tells of the others.
        assert (len(waits), sent.resends) == (1, 3)
    assert len(model.shown) == 1


def test_no_more_is_on_its_way_than_the_window_holds():
    with joined(0.5, width=640, height=480) as (model, board):
        image = noise(model)
        model.on_packet = lambda model, number: number == 3 and model.stalled.set()
        before = board.line.written
        with pytest.raises(DeviceError, match="not answered"):
            send_frame(board, image, window_bytes=20_000)
        # 7 packets fill it; the line is asked again after each time-out, three times at most in half a second.
        assert 20_000 <= board.line.written - before <= (7 + 3) * 3100


@pytest.mark.parametrize("shape", [(72, 95, 3), (72, 96), (72, 96, 4)])
def test_an_image_of_another_size_is_refused(shape):
    with joined() as (model, board), pytest.raises(InputError, match="96 x 72"):
        send_frame(board, np.zeros(shape, np.uint8))
    assert model.executed[Kind.TILE] == 0


def test_late_tiles_of_another_frame_do_no_harm():
    with joined() as (model, board):
        first, second = noise(model, 1), noise(model, 2)
        send_frame(board, first)
        board.line.send(packed(Kind.TILE, board.next_seq(), b"\0\0\0\0\1abc"), 1.0)
        send_frame(board, second)
        assert model.statuses[4] == 1
    np.testing.assert_array_equal(model.shown, [first, second])


def test_a_good_line_that_is_slow_at_times_is_given_its_time():
    """Every second reply comes a third of a second later: only late replies tell that it is worth the wait."""
    with joined(width=160, height=96) as (model, board):
        image = noise(model)
        model.on_packet = lambda model, number: setattr(model, "delay_s", 0.01 if number % 2 else 0.3)
        sent = send_frame(board, image, window_bytes=3000)
    # The first time-outs are too short. Without the late replies each of the tiles is sent twice.
    assert sent.resends <= sent.tiles / 5
    np.testing.assert_array_equal(model.shown, [image])


@pytest.fixture
def patient(monkeypatch):
    """Time-outs that a slow machine does not reach: the loss of the line alone has tiles sent again."""
    monkeypatch.setattr(retries, "FIRST_S", retries.LONGEST_S)
    monkeypatch.setattr(retries, "SHORTEST_S", retries.LONGEST_S)


@pytest.mark.parametrize(("count", "held"), [(20_000, 6), (191_500, 67)])
def test_resume_after_a_replug(count, held, patient):
    """The line is cut after a number of bytes: the board has the tiles that were whole by then, and no other."""
    with ModelBoard(320, 200) as model, Proxy(model.url, SEED, baud=3_000_000) as line:
        image = noise(model)
        with Board.open(line.url, FAST_BAUD) as board:
            line.unplug_after(count)
            with pytest.raises(DeviceError, match=r"connection is lost.*check that the board runs"):
                send_frame(board, image)
        with Board.open(line.url, FAST_BAUD) as board:
            assert np.count_nonzero(model.tables[1 - model.front]) == held
            sent = send_frame(board, image)
    assert (sent.skipped, sent.sends, sent.resends) == (held, 70 - held, 0)
    np.testing.assert_array_equal(model.shown, [image])
    assert set(model.tile_writes.values()) == {1}


@pytest.mark.parametrize(("before", "share"), [(0, 0.05), (1, 0.5), (0, 0.99)])
def test_a_power_cycle_within_a_frame(before, share):
    with joined(width=320, height=200) as (model, board):
        for k in range(before):
            send_frame(board, noise(model, "before", k))
        model.shown.clear()
        model.tile_writes.clear()
        lost = []

        def cycle(model, _):
            if not lost and model.tile_writes.total() >= share * model.tiles:
                lost.append(model.tile_writes.total())
                model.power_cycle()

        model.on_packet = cycle
        image = noise(model)
        sent = send_frame(board, image)
        assert lost
    np.testing.assert_array_equal(model.shown, [image])
    # What the board lost it gets again, and at most one tile more.
    assert model.tile_writes.total() <= sent.tiles + lost[0] + 1
    assert 2 <= sent.rounds <= 3


@pytest.mark.parametrize("before_reply", [False, True])
def test_a_power_cycle_as_the_frame_is_presented(before_reply):
    with joined() as (model, board):
        send_frame(board, noise(model, 1))
        original, cycled = model._present, []

        def present(body):
            if not cycled:
                cycled.append(1)
                if before_reply:
                    original(body)
                model.power_cycle()
            return original(body)

        model._present = present
        image = noise(model, 2)
        send_frame(board, image)
    np.testing.assert_array_equal(model.shown[-1], image)
    assert model.buffers[model.front].tobytes() == image.tobytes()

"""`lippmann stream` against the model board: when it waits for the board again, and when it ends."""

import json
import time

import numpy as np
import pytest
from fault_line import Proxy
from lippmann.base.images import write_picture
from lippmann.base.tones import decode
from lippmann.board import panel_frames
from lippmann.board.board import Board
from lippmann.cli import run
from lippmann.fixed.registers import BOARD_REGISTERS, SCENE_REGISTERS
from model_board import BAD_TILE, CRC_DIFFERS, OPTICS, RESET, ModelBoard, RefusedError
from scene_cases import generator

SEED = 4507
DISPLAY, FRAMES, SHOWN_CRC = (BOARD_REGISTERS[name].address for name in ("display", "frames", "shown_crc"))

SCENE_STATUS = 0x400 + SCENE_REGISTERS["status"].address


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """A board that is silent for half a second counts as gone."""
    opened = Board.open
    monkeypatch.setattr(Board, "open", lambda url, baud: opened(url, 12_000_000, 0.5))


@pytest.fixture
def picture(tmp_path):
    def make(model):
        image = generator(SEED).integers(0, 256, (model.height, model.width, 3), np.uint8)
        path = tmp_path / "image.png"
        write_picture(path, decode(image / 255.0, "srgb"), {"identity": f"{model.identity:016x}"})
        return str(path), image

    return make


def refuse(status):
    def answer(_):
        raise RefusedError(status)

    return answer


@pytest.mark.parametrize("verifying", [False, True])
def test_a_lost_line_is_waited_for_and_the_frame_verified(picture, capsys, verifying):
    with ModelBoard(320, 200) as model, Proxy(model.url, SEED) as line:
        path, image = picture(model)
        pulled = []

        def pull(model, _):
            if not pulled and (model.shown if verifying else model.tile_writes.total() == 20):
                pulled.append(1)
                line.unplug()
            # The panel goes on by itself.
            model.registers[FRAMES] += 1
            model.registers[SHOWN_CRC] = model.last_crc or 0

        model.on_packet = pull
        model.registers[DISPLAY] = 0xFF
        words = ["stream", path, "--port", line.url, "--verify", "--resume", "20", "--json"]
        assert run(words) == 0
    out, err = capsys.readouterr()
    assert pulled
    assert "searching for the board for 20 s" in err
    frame = json.loads(out.splitlines()[-1])["frames"][0]
    assert (frame["tiles"], frame["rounds"], frame["verified"], frame["unchanged"]) == (70, 2, True, False)
    assert frame["sends"] == (70 if verifying else 70 - frame["skipped"] + frame["resends"])
    np.testing.assert_array_equal(model.shown, [image])


@pytest.mark.parametrize("shown", [False, True])
def test_a_frame_behind_a_scene_is_stored_and_said_so(picture, capsys, shown):
    """It cannot be verified there, and nothing is sent then."""
    with ModelBoard(scene=(4, 5, 6, 48)) as model:
        path, image = picture(model)
        model.registers[SCENE_STATUS] = int(shown)
        words = ["stream", path, "--port", model.url]
        if shown:
            assert run([*words, "--verify"]) == 1
            err = capsys.readouterr().err
            assert "cannot be verified; end the scene first: lippmann board write scene.source scene=0" in err
            assert not model.tile_writes
        assert run([*words, "--json"]) == 0
        out, err = capsys.readouterr()
        assert json.loads(out.splitlines()[-1])["behind_scene"] is shown
        assert ("the frame is stored, and shown when the scene ends" in err) is shown
        np.testing.assert_array_equal(model.shown, [image])
        assert run(words) == 0
        assert ("stored already" if shown else "already on the panel") in capsys.readouterr().out


def test_images_are_decoded_one_by_one_after_all_files_are_checked(picture, monkeypatch, tmp_path, capsys):
    """A long animation needs the memory of one frame; a file that does not belong is refused before the first frame."""
    with ModelBoard() as model:
        path, image = picture(model)
        other = str(tmp_path / "other.png")
        write_picture(other, decode(image[::-1] / 255.0, "srgb"), {"identity": f"{model.identity:016x}"})
        foreign = str(tmp_path / "foreign.png")
        write_picture(foreign, decode(image / 255.0, "srgb"), {"identity": "0123456789abcdef"})
        shown_before = []
        read = panel_frames.read_picture
        monkeypatch.setattr(
            panel_frames, "read_picture", lambda *words: (shown_before.append(len(model.shown)), read(*words))[1]
        )
        cut = tmp_path / "cut.exr"
        write_picture(cut, decode(image / 255.0, "srgb"), {"identity": f"{model.identity:016x}"})
        cut.write_bytes(cut.read_bytes()[:-3000])
        for bad in (foreign, str(cut)):
            assert run(["stream", path, other, bad, "--port", model.url]) == 2
        assert (shown_before, model.shown) == ([], [])
        assert run(["stream", path, other, "--port", model.url]) == 0
        assert shown_before == [0, 1]
        monkeypatch.setattr(
            panel_frames, "read_picture", lambda *words: read(*words) if str(words[0]) == path else 1 / 0
        )
        capsys.readouterr()
        assert run(["stream", path, other, "--port", model.url]) == 70
        assert f"{path}: " in capsys.readouterr().err
    np.testing.assert_array_equal(model.shown, [image, image[::-1], image])


@pytest.mark.parametrize("kind", ["tile", "present", "optics"])
def test_a_board_that_refuses_is_not_asked_for_ever(kind, picture, capsys):
    with ModelBoard() as model:
        path, _ = picture(model)
        if kind == "tile":
            model._tile = refuse(BAD_TILE)
        else:
            model._present = refuse(CRC_DIFFERS if kind == "present" else OPTICS)
        assert run(["stream", path, "--port", model.url, "--resume", "600"]) == 1
    err = capsys.readouterr().err
    assert {"tile": "refuses TILE", "present": "8 attempts", "optics": "refuses PRESENT"}[kind] in err
    assert "searching for the board" not in err
    assert len(err.splitlines()) == 1
    assert model.executed[1] == 1 or kind == "present"
    assert model.shown == []


@pytest.mark.parametrize("version", [1, 2])
def test_a_board_that_falls_silent_at_the_same_place_is_not_asked_for_ever(picture, capsys, version):
    """A board that can be reset over the line is, once."""
    with ModelBoard() as model:
        model.version = version
        path, _ = picture(model)
        shown = model._present

        def present(body):
            model.mute = True
            return shown(body[:2])  # malformed: nothing is shown

        model._present = present
        model.on_packet = lambda model, _: setattr(model, "mute", False)
        assert run(["stream", path, "--port", model.url, "--resume", "600"]) == 1
    *logs, end = capsys.readouterr().err.splitlines()
    assert ["searching for the board" in log for log in logs] == [[True], [True, True, False]][version - 1]
    assert version == 1 or "no tile arrives; resetting the board" in logs[2]
    assert "not answered" in end
    assert ("no new tile in between", "also after a reset")[version - 1] in end
    assert set(model.tile_writes.values()) == {version}
    assert model.executed[RESET] == version - 1
    assert model.shown == []


def test_a_board_that_does_not_come_back_is_waited_for_so_long(picture, capsys):
    with ModelBoard(320, 200) as model:
        path, _ = picture(model)
        model.on_packet = lambda model, _: model.tile_writes.total() >= 5 and model._ended.set()
        begun = time.monotonic()
        assert run(["stream", path, "--port", model.url, "--resume", "1"]) == 1
        assert 1.0 <= time.monotonic() - begun < 10.0
    assert "waited 1 s; the same command continues the frame" in capsys.readouterr().err


def test_another_board_that_comes_back_is_refused(picture, capsys):
    with ModelBoard(320, 200) as model, Proxy(model.url, SEED) as line:
        path, _ = picture(model)

        def swap(model, _):
            if model.tile_writes.total() == 20:
                model.power_cycle()
                model.tile_writes.clear()
                model.identity += 1
                line.unplug()

        model.on_packet = swap
        assert run(["stream", path, "--port", line.url, "--resume", "20"]) == 1
    assert "another board answers now" in capsys.readouterr().err.splitlines()[-1]
    assert model.shown == []


@pytest.mark.parametrize("more", [[], ["--verify"], ["--force"]])
def test_a_test_pattern_that_hides_the_frame_is_told(picture, capsys, more):
    """Before anything is sent: the frame would arrive and not be seen."""
    with ModelBoard() as model:
        path, image = picture(model)
        words = ["stream", path, "--port", model.url]
        model.registers[DISPLAY] = 0x2FF
        assert run([*words, *more]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert (
            "the panel shows test pattern 2 (lens_centres), not the frame; end the pattern with lippmann board write"
            in line
        )
        assert (model.shown, model.tile_writes.total()) == ([], 0)
        assert run(["board", "write", "display", "pattern=0", "--port", model.url]) == 0
        assert run(words) == 0
    np.testing.assert_array_equal(model.shown, [image])

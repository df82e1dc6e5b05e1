"""Scenes on the model board: loading over good, bad and cut lines, and what moving a layer costs."""

import dataclasses
import json
import math
import re

import numpy as np
import pytest
from fault_line import FAULTS, NO_FAULTS, Proxy
from lippmann import load_layers
from lippmann.board.board import Board
from lippmann.board.drawn_scene import Loaded, SceneBoard, SceneStatus
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import DeviceError, InputError
from lippmann.fixed.build import Build
from lippmann.fixed.registers import BOARD_REGISTERS, build_word
from lippmann.fixed.scene_build import CURVE_SLOT
from lippmann.fixed.scene_configuration import build_curve_table, scene_words, slot_bytes
from lippmann.layers.layers_and_pictures import save_layers
from lippmann.layers.stack import Layer, LayerStack
from lippmann.simulation.toolchain import repository
from model_board import DRAW, LOOK, ModelBoard
from scene_cases import generator

SEED = 2116
FAST_BAUD = 12_000_000
#: 4 layers, 5 slots of 64 x 48 texels: 3 blocks, and the palette's.
SCENE = (4, 5, 6, 48)
DISPLAY = load_display("scenes/displays/paper-square.toml")


@pytest.fixture
def model():
    with ModelBoard(scene=SCENE) as board:
        word = build_word(Build.of(DISPLAY, "exact", 16, aims=False))
        board.registers |= {0x200: 0x4C495050, 0x204: 3 << 16, 0x208: word}
        yield board


def layer(rng, **changes):
    texels = rng.integers(0, 256, (48, 64), np.uint8)
    palette = rng.integers(0, 256, (256, 4), np.uint8)
    matrix = np.column_stack([rng.uniform(-2, 2, (2, 2)), rng.uniform(0, 60, 2)])
    return dataclasses.replace(Layer(texels, palette, rng.uniform(-9, 9), matrix, rng.random()), **changes)


def slot_contents(stack, build, slots=(4, 0, 2)):
    return {slot: slot_bytes(one, build).tobytes() for slot, one in zip(slots, stack.layers, strict=True)}


def stored(model, slot):
    return b"".join(model.blocks[slot, block] for block in range(model.blocks_of(slot)))


def test_a_stack_is_loaded_whole(model):
    rng = generator(SEED, "whole")
    stack = LayerStack(tuple(layer(rng) for _ in range(3)))
    with Board.open(model.url, FAST_BAUD) as board:
        assert board.info.version == 3
        scene = SceneBoard(board)
        assert (scene.build.layers, scene.build.slots, scene.build.width, scene.build.height) == (4, 5, 64, 48)
        seen = []
        loaded = scene.load(slot_contents(stack, scene.build), lambda done, total: seen.append((done, total)))
        assert (loaded.blocks, loaded.skipped, loaded.sends) == (12, 0, 12)
        assert seen == [(done, 12) for done in range(1, 13)]
        for slot, one in zip([4, 0, 2], stack.layers, strict=True):
            assert stored(model, slot) == one.texels.tobytes() + one.palette.tobytes()
        assert scene.load(slot_contents(stack, scene.build)).skipped == 12
        curve = build_curve_table(DISPLAY).tobytes()
        assert scene.load({CURVE_SLOT: curve}).sends == 8
        assert (scene.holds(CURVE_SLOT, curve), scene.holds(CURVE_SLOT, curve[::-1])) == (True, False)
        assert len(stored(model, 15)) == 8192
        # A texture with a change in one place costs one block.
        texels = stack.layers[1].texels.copy()
        texels[20, 3] ^= 1
        changed = dataclasses.replace(stack.layers[1], texels=texels)
        stack = LayerStack((stack.layers[0], changed, stack.layers[2]))
        assert scene.load(slot_contents(stack, scene.build)).sends == 1
    assert max(model.block_writes.values()) == 2
    assert sum(model.block_writes.values()) == 12 + 8 + 1


@pytest.mark.parametrize("fault", [name for name in FAULTS if name not in ("stall", "delay", "all")])
@pytest.mark.parametrize("window", [1100, 8000])
def test_a_bad_line_loads_what_was_sent(model, fault, window):
    rng = generator(SEED, fault, window)
    contents = {slot: rng.bytes(4096) for slot in range(5)}
    with Proxy(model.url, SEED, FAULTS[fault], FAULTS[fault]) as line, Board.open(line.url, FAST_BAUD, 8.0) as board:
        SceneBoard(board).load(contents, window_bytes=window)
        line.down = line.up = NO_FAULTS
    assert {slot: stored(model, slot) for slot in contents} == contents


@pytest.mark.parametrize("window", [1100, 2080, 8000])
def test_a_cut_load_sends_nothing_twice_that_had_arrived(model, window):
    rng = generator(SEED, "cut", window)
    contents = {slot: rng.bytes(4096) for slot in range(5)}
    loaded = Loaded()

    class UnpluggedError(Exception):
        pass

    def progress(done, total):
        if done == 7:
            raise UnpluggedError

    with Board.open(model.url, FAST_BAUD) as board, pytest.raises(UnpluggedError):
        SceneBoard(board).load(contents, progress, window, loaded)
    with Board.open(model.url, FAST_BAUD) as board:
        SceneBoard(board).load(contents, None, window, loaded)
    assert {slot: stored(model, slot) for slot in contents} == contents
    assert max(model.block_writes.values()) == 1
    # Sent again were those on their way at most.
    assert loaded.sends - 20 <= math.ceil(window / 1041)


def test_a_layer_moves_by_one_short_write(model):
    rng = generator(SEED, "move")
    stack = LayerStack(tuple(layer(rng) for _ in range(4)), rng.random(3))
    with Board.open(model.url, FAST_BAUD) as board:
        scene = SceneBoard(board)
        scene.prepare(DISPLAY, stack)
        words = scene_words(DISPLAY, stack, scene.build, (0, 1, 2, 3))
        assert model.writes[-1] == (0x600, tuple(word for one in words.layers for word in one.words))
        common = (words.lattice_xi, words.lattice_xj, words.lattice_yj, *words.background)
        assert model.writes[-2] == (0x410, tuple(word % (1 << 32) for word in common))

        def sent(*changes):
            nonlocal stack
            layers = list(stack.layers)
            for number, change in changes:
                layers[number] = dataclasses.replace(layers[number], **change)
            stack = dataclasses.replace(stack, layers=tuple(layers))
            before, count = board.line.written, len(model.writes)
            scene.set_stack(DISPLAY, stack)
            return board.line.written - before, model.writes[count:]

        for number in range(4):
            size, ((first, _),) = sent((number, {"matrix": rng.uniform(-2, 2, (2, 3)), "depth_mm": rng.uniform(-9, 9)}))
            assert (first, size <= 40) == (0x600 + 32 * number, True)
        assert sent() == (0, [])
        _, ((first, new),) = sent((2, {"visible": False}))
        assert (first, len(new), new[0] & 1) == (LOOK + 64, 1, 0)
        # Two layers change in one write, or a frame would show one without the other.
        _, ((first, new),) = sent((1, {"brightness": 0.25}), (3, {"brightness": 0.5}))
        assert (first, len(new), new[0] >> 8, new[-1] >> 8) == (LOOK + 32, 17, 64, 128)
        # What others have written before is not relied on.
        scene = SceneBoard(board)
        _, ((first, new),) = sent()
        assert (first, len(new)) == (0x600, 32)


def test_slots_are_chosen_by_what_they_hold_and_what_is_shown(model):
    rng = generator(SEED, "slots")
    contents = [rng.bytes(4096) for _ in range(4)]
    with Board.open(model.url, FAST_BAUD) as board:
        scene = SceneBoard(board)
        scene.load({3: contents[0], 1: contents[2]})
        # The rest of a cut load goes where its beginning is.
        model.blocks[4, 0] = contents[3][:1024]
        chosen = scene.free_slots(contents)
        assert (chosen[0], chosen[2], chosen[3]) == (3, 1, 4)
        assert chosen[1] in (0, 2)
        board.write(LOOK, [1 | 0 << 4])
        board.write(DRAW, [1])
        model.registers[0x428] = 1 << 16 | 1 << 31 | 1
        assert scene.free_slots(contents)[1] == 2
        model.registers[0x428] = 0b11111 << 16
        with pytest.raises(DeviceError, match=r"4 textures need slots, but the board shows 5 of its 5 slots; end"):
            scene.free_slots(contents)
        with pytest.raises(DeviceError, match="refuses BLOCK: the slot is shown"):
            scene.load({0: contents[0]})
        with pytest.raises(DeviceError, match="while its optics draw a scene"):
            board.write(0x240, [0])
        # What a shown slot holds takes no free one, also when a free one holds it too.
        board.write(DRAW, [0])
        scene.load({0: contents[0], 3: contents[2], 4: contents[0]})
        model.registers[0x428] = 0b11110 << 16
        assert scene.free_slots([contents[0], contents[1]]) == [4, 0]


@pytest.mark.parametrize(
    ("depths", "says"),
    [
        ((0.0, 600.0), "600 mm is not in front of the eyes .*; give less than 600"),
        (
            (0.0,) * 5,
            "5 layers do not fit the board, which draws 4; cut the scene again with lippmann layers --count 4",
        ),
    ],
)
def test_stacks_that_cannot_be_drawn_are_refused_by_every_write(model, depths, says):
    rng = generator(SEED, "refused")
    stack = LayerStack(tuple(layer(rng, depth_mm=depth) for depth in depths))
    with Board.open(model.url, FAST_BAUD) as board:
        scene = SceneBoard(board)
        for write in (scene.prepare, scene.set_stack):
            with pytest.raises(InputError, match=says):
                write(DISPLAY, stack)
    assert not model.writes


@pytest.mark.parametrize(
    ("contents", "says"),
    [
        ({5: bytes(4096)}, "no slot 5; give 0 to 4, or 15 for the curve"),
        ({-1: bytes(4096)}, "no slot -1"),
        ({0: bytes(4095)}, "slot 0 takes 4096 bytes, not 4095"),
        ({15: bytes(4096)}, "slot 15 takes 8192 bytes, not 4096"),
    ],
)
def test_contents_that_do_not_fit_are_refused(model, contents, says):
    with Board.open(model.url, FAST_BAUD) as board, pytest.raises(InputError, match=says):
        SceneBoard(board).load(contents)
    assert not model.block_writes


def test_boards_that_do_not_draw():
    with ModelBoard(scene=SCENE) as model, Board.open(model.url, FAST_BAUD) as board:
        model.registers[0x400] ^= 1
        with pytest.raises(DeviceError, match="this host does not know the scene block"):
            SceneBoard(board)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("read scene.layer_7_s0", "scene.layer_7_s0: the board has 4 layers, 0 to 3; see docs/generated/scene-reg"),
        ("read 0x680", "0x680: the board has 4 layers"),
        ("read scene.layer_3_s0 9", "scene.layer_3_s0: the board has 4 layers"),
        ("write scene.layer_4_s0 1", "scene.layer_4_s0: the board has 4 layers"),
        ("write scene.layer_0_look slot=9", "slot=9: the board has no slot 9; give a slot from 0 to 4"),
        ("write scene.layer_1_look 0x51", "0x51: the board has no slot 5; give a slot from 0 to 4"),
        ("write scene.layer_0_d 7 0xF0", "7 0xF0: the board has no slot 15"),
    ],
)
def test_layers_and_slots_that_a_board_lacks_are_refused(model, refusal_of, words, says):
    assert refusal_of("board", *words.split(), "--port", model.url).startswith(f"lippmann: {says}")
    assert not model.writes
    for good in ("read scene.layer_3_look", "write scene.layer_0_look slot=4", "read display 8"):
        assert run(["board", *good.split(), "--port", model.url]) == 0


def test_a_board_without_a_scene_says_so_by_name(refusal_of):
    with ModelBoard() as plain:
        for words in (["read", "scene.status"], ["write", "scene.source", "scene=1"]):
            line = refusal_of("board", *words, "--port", plain.url, code=1)
            assert "draws no scenes; use a board that draws (lippmann board start --layers 4)" in line


@pytest.fixture
def playing(model, tmp_path, monkeypatch):
    rng = generator(SEED, "play")
    model.identity = int(DISPLAY.identity, 16)
    save_layers(tmp_path / "stack", LayerStack((layer(rng), layer(rng))), ["one", "two"])
    display = str(repository() / "scenes/displays/paper-square.toml")
    monkeypatch.chdir(tmp_path)
    # The panel of the model shows what is written at once.
    monkeypatch.setattr(SceneBoard, "wait", lambda *_: None)
    shown = SceneStatus(True, False, frozenset(), 0, 0)
    monkeypatch.setattr(SceneBoard, "status", lambda self: dataclasses.replace(shown, is_shown=model.is_drawn()))
    return ["--display", display, "--force", "--port", model.url]


FILM = """layers = "stack"
frames = 3
frames_per_second = 1000
[[layer]]
name = "one"
keys = [{ frame = 0 }, { frame = 2, offset_mm = [1, 0, 0] }]
"""


def test_play_says_what_a_folder_cost(playing, capfd):
    assert run(["play", "stack", *playing]) == 0
    blocks, shown = capfd.readouterr().out.splitlines()
    assert re.fullmatch(r"16 of 16 blocks in [\d.]+ s, \d{3} bytes of registers", blocks)
    assert shown == "1 frame; 0 pixels late"
    assert run(["play", "stack", *playing, "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert (told["frames"], told["bytes"], told["load"]["skipped"]) == (1, 0, 16)
    assert told["first_bytes"] > 60


def test_play_until_ctrl_c_says_what_was_played(playing, capfd, monkeypatch, tmp_path):
    (tmp_path / "film.toml").write_text(FILM)
    set_stack, calls = SceneBoard.set_stack, []

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) == 8:
            raise KeyboardInterrupt
        return set_stack(*arguments)

    monkeypatch.setattr(SceneBoard, "set_stack", interrupted)
    assert run(["play", "film.toml", *playing, "--repeat", "0"]) == 130
    assert re.search(r"^7 frames in .* bytes on the line, .* 0 pixels late$", capfd.readouterr().out, re.M)
    calls.clear()
    assert run(["play", "film.toml", *playing, "--repeat", "0", "--json"]) == 130
    assert json.loads(capfd.readouterr().out)["frames"] == 6  # the first write prepares the scene that is shown


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("offset_mm = [0, 0, -50000]", r"frame \d: layer 'one', register depth: -\d+.* mm is outside its range \[-33"),
        ("scale = 1e-4", r"frame \d: layer 'one', register a: .* texels/mm is outside its range"),
        ("offset_mm = [1e6, 0, 0]", r"frame \d: layer 'one', register s0: .* texels is outside its range"),
    ],
)
def test_motion_beyond_a_register_names_the_film(playing, capfd, tmp_path, key, says):
    (tmp_path / "film.toml").write_text(FILM.replace("offset_mm = [1, 0, 0]", key))
    assert run(["play", "film.toml", *playing]) == 2
    (line,) = [one for one in capfd.readouterr().err.splitlines() if not one.startswith("note:")]
    assert re.match(rf"lippmann: film.toml: {says}", line)


def test_depths_that_a_film_reaches_beyond_the_display_are_told(playing, capfd, tmp_path):
    """At rest the layers are within 9 mm; (far, near) is pitch D / pixel pitch to both sides."""
    reach = DISPLAY.array.finest_mm * DISPLAY.aperture_distance_mm / DISPLAY.panel.coarsest_mm
    assert run(["play", "stack", *playing]) == 0
    assert "note" not in capfd.readouterr().err
    (tmp_path / "film.toml").write_text(FILM.replace("[1, 0, 0]", f"[0, 0, {-2.0 * reach}]"))
    assert run(["play", "film.toml", *playing]) == 0
    (note,) = [line for line in capfd.readouterr().err.splitlines() if line.startswith("note:")]
    worst = load_layers("stack").layers[0].depth_mm - 2.0 * reach
    assert f"fine detail is lost in 'one' ({worst:+.4g} mm): the display's depth range is z = {-reach:.4g}" in note


def test_nothing_is_played_behind_a_test_pattern(playing, model, capfd):
    model.registers[BOARD_REGISTERS["display"].address] = 0x0400 | 0xFF
    assert run(["play", "stack", *playing]) == 1
    assert "shows test pattern" in capfd.readouterr().err
    assert not model.block_writes


def test_a_film_that_is_not_there_is_told_with_what_can_be_given(playing, refusal_of):
    line = refusal_of("play", "nothing", *playing)
    assert "give a film of layers (.toml), or a folder that lippmann layers made" in line

"""A virtual board that draws: what the panel shows is what the integer twin draws, whatever the line does."""

import contextlib
import dataclasses
import os
import time
import zlib

import numpy as np
import pytest
from board_scenes import HEIGHT, USUAL, WIDTH, display_of, moved, random_layer, random_stack, twin
from fault_line import NO_FAULTS, Faults, Proxy
from lippmann.board.board import Board, check_rays
from lippmann.board.drawn_scene import Loaded, SceneBoard
from lippmann.board.film_player import load_textures, play_film
from lippmann.board.packets import Kind
from lippmann.board.streaming import send_frame
from lippmann.board.virtual_loop import capturing, frames_differ
from lippmann.errors import DeviceError, InputError, NoBoardError
from lippmann.fixed.scene_build import CURVE_SLOT, SceneBuild
from lippmann.fixed.scene_configuration import build_curve_table, slot_bytes
from lippmann.layers.stack import LayerStack
from lippmann.motion.layer_film import LayerFilm
from lippmann.simulation import virtual_board

SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))
BUILDS = {
    "square-nearest": ("square", USUAL),
    "hex-bilinear-2": ("hex", SceneBuild(layers=2, width=64, height=32, bilinear=True, samples=2)),
    "square-bilinear-4": ("square", SceneBuild(layers=1, slots=1, width=32, height=32, bilinear=True, samples=4)),
    "hex-nearest-8": ("hex", SceneBuild(layers=8, width=32, height=32)),
}


def captured(folder):
    return [path.read_bytes() for path in sorted(folder.glob("frame-*.rgb"))]


@pytest.fixture
def drawing(request, tmp_path):
    """A board that draws, its display and build, and the folder of its frames."""
    print(f"seed {SEED}")
    grid, build = BUILDS[getattr(request, "param", "square-nearest")]
    display = display_of(grid)
    with virtual_board.running(display, capture=tmp_path, scene=build) as board:
        board.display, board.build, board.folder = display, build, tmp_path
        yield board


def show(scene, display, stack, slots=None):
    scene.load({CURVE_SLOT: build_curve_table(display).tobytes()})
    places = range(len(stack.layers)) if slots is None else slots
    scene.load({k: slot_bytes(one, scene.build).tobytes() for k, one in zip(places, stack.layers, strict=True)})
    scene.prepare(display, stack, slots)
    scene.draw(True)


@pytest.mark.parametrize(
    "drawing",
    [name if name == "square-nearest" else pytest.param(name, marks=pytest.mark.full) for name in BUILDS],
    indirect=True,
)
def test_drawn_frames_are_the_twins(drawing):
    """Random scenes, and motions of each: 0 pixels differ, none comes late, and no other frame is ever shown."""
    rng = np.random.default_rng([SEED, 1])
    display, build = drawing.display, drawing.build
    wanted = {bytes(3 * WIDTH * HEIGHT)}
    with Board.open(drawing.url) as board:
        scene = SceneBoard(board)
        assert scene.build == build
        for turn in range(3):
            stack = random_stack(rng, display, build)
            slots = rng.permutation(build.slots_built)[: len(stack.layers)].tolist()
            if turn:
                scene.draw(False)
            show(scene, display, stack, slots)
            for _ in range(8):
                picture = twin(display, stack, build).tobytes()
                wanted.add(picture)
                assert board.panel_crc() == zlib.crc32(picture)
                stack = moved(rng, display, build, stack)
                wanted.add(twin(display, stack, build).tobytes())
                assert scene.set_stack(display, stack, slots) <= 8 * build.layers
                scene.wait(True)
        assert scene.status().frames >= 24
        assert scene.status().underflows == 0
    frames = captured(drawing.folder)
    assert len(frames) >= 24
    assert set(frames) <= wanted


#: Grid, panel, rotation in degrees, and build. Scenes have 1 layer to as many as the build has.
WHOLE = [
    ("square", (640, 480), 0.0, SceneBuild(layers=8, width=64, height=96)),
    ("hex", (640, 480), 11.0, SceneBuild(bilinear=True)),
    ("square", (640, 480), 33.0, SceneBuild(layers=2, width=512, height=30, bilinear=True, samples=2)),
    ("hex", (640, 480), 90.0, SceneBuild(layers=3, width=128, height=64, samples=4)),
    ("square", (1280, 720), 3.3, SceneBuild(layers=5, slots=6, width=128, height=96, bilinear=True)),
    ("hex", (1280, 720), -1.5, SceneBuild()),
    ("hex", (1280, 720), 0.0, SceneBuild(layers=1, slots=2, width=1024, height=192)),
]


@pytest.mark.full
@pytest.mark.parametrize(("grid", "size", "angle", "build"), WHOLE)
def test_whole_frames_are_the_twins(grid, size, angle, build):
    """Optics, scene and scan-out together: 24 frames, of three random scenes that move, and no other frame between."""
    rng = np.random.default_rng([SEED, 9])
    print(f"seed {SEED}")
    display = display_of(grid, size, angle)
    black = np.zeros((size[1], size[0], 3), np.uint8)
    with capturing(display, build) as captured:
        wanted = [black]
        captured.board.panel_crc()
        scene = SceneBoard(captured.board)
        for _ in range(3):
            stack = random_stack(rng, display, build)
            show(scene, display, stack)
            for turn in range(8):
                wanted.append(twin(display, stack, build))
                if turn < 7:
                    stack = moved(rng, display, build, stack)
                    scene.set_stack(display, stack)
                    scene.wait(True)
            assert scene.status().underflows == 0
            scene.draw(False)
            wanted.append(black)
        captured.board.panel_crc()
    # A frame like the one before it is captured once.
    wanted = [one for k, one in enumerate(wanted) if not k or (one != wanted[k - 1]).any()]
    assert frames_differ(captured.frames, wanted) == 0
    assert len(wanted) > 20


def test_what_the_drawing_keeps_from_others(drawing):
    rng = np.random.default_rng([SEED, 3])
    display, build = drawing.display, drawing.build
    stack = LayerStack(tuple(dataclasses.replace(random_layer(rng, display, build), visible=True) for _ in range(3)))
    textures = slot_bytes(stack.layers[0], build).tobytes()
    with Board.open(drawing.url) as board:
        scene = SceneBoard(board)
        show(scene, display, stack, [2, 0, 1])
        crc = board.panel_crc()
        assert scene.status().slots == {0, 1, 2, 15}
        with pytest.raises(DeviceError, match="refuses SIGN while its optics draw a scene"):
            board.sign(1)
        with pytest.raises(DeviceError, match="refuses WRITE while its optics draw a scene"):
            board.write(0x214, [0])
        for slot, content in ((1, bytes(255 - byte for byte in textures)), (15, bytes(8192))):
            with pytest.raises(DeviceError, match="refuses BLOCK: the slot is shown"):
                scene.load({slot: content})
        # A slot that is written to be shown is kept from then on; one that is no longer shown is free after a frame.
        scene.load({3: textures})
        scene.set_stack(display, stack, [3, 0, 1])
        scene.wait(True)
        assert scene.status().slots == {0, 1, 3, 15}
        scene.load({2: textures})
        assert scene.status().underflows == 0
        scene.set_stack(display, stack, [2, 0, 1])
        scene.wait(True)
        assert board.panel_crc() == crc
        scene.draw(False)
        scene.load({15: bytes(8192)})
        # The optics are free again, and have their raster.
        assert check_rays(board, display, (3, 9), (5, 8)).equal


def test_what_a_moving_layer_costs(drawing):
    """So 60 moves a second take 0.8 % of a line of 3 Mbaud."""
    rng = np.random.default_rng([SEED, 4])
    display, build = drawing.display, drawing.build
    stack = LayerStack(tuple(dataclasses.replace(random_layer(rng, display, build), visible=True) for _ in range(3)))
    with Board.open(drawing.url) as board:
        scene = SceneBoard(board)
        show(scene, display, stack)
        costs = []
        for brighter in (False, True) * 20:
            other = random_layer(rng, display, build)
            layers = list(stack.layers)
            layers[1] = dataclasses.replace(layers[1], depth_mm=other.depth_mm, matrix=other.matrix)
            if brighter:
                layers[1] = dataclasses.replace(layers[1], brightness=other.brightness)
            stack = dataclasses.replace(stack, layers=tuple(layers))
            before = board.line.written
            scene.set_stack(display, stack)
            costs.append(board.line.written - before)
        assert (max(costs[::2]), max(costs[1::2])) == (39, 43)
        scene.wait(True)
        assert board.panel_crc() == zlib.crc32(twin(display, stack, build).tobytes())


def test_no_pixel_is_late_while_the_line_is_full(drawing):
    """Blocks of a slot that is not shown, tiles, reads and updates, as many as the board takes."""
    rng = np.random.default_rng([SEED, 5])
    display, build = drawing.display, drawing.build
    stack = random_stack(rng, display, build)
    wanted = {bytes(3 * WIDTH * HEIGHT)}
    with Board.open(drawing.url) as board:
        scene = SceneBoard(board)
        show(scene, display, stack)
        until = scene.status().frames + 40
        turn = 0
        while scene.status().frames < until:
            stack = moved(rng, display, build, stack)
            wanted.add(twin(display, stack, build).tobytes())
            scene.load({3: rng.bytes(build.slot_bytes)}, window_bytes=6000)
            scene.set_stack(display, stack)
            if turn % 8 == 0:
                send_frame(board, rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8))
            board.read(0, 64)
            turn += 1
        assert scene.status().underflows == 0
        wanted.add(twin(display, stack, build).tobytes())
    shown = captured(drawing.folder)
    assert sum(frame in wanted for frame in shown) >= len(shown) - 1  # the first scene's picture was not noted


FAULTS = {
    "flip": Faults(flip=2e-3),
    "drop": Faults(drop=2e-3),
    "insert": Faults(insert=2e-3),
    "duplicate": Faults(duplicate=2e-3),
    "garble": Faults(garble=2e-3),
    "reorder": Faults(reorder=2e-3),
    # As long as a request of a layer, which is repeated in time.
    "cut": Faults(cut=2e-3, run=40),
    # As long as all that is on its way: the board can be out of reach for as long as the host is patient.
    "outage": Faults(cut=1e-3, run=200),
    "stall": Faults(stall=1e-3, stall_s=0.1),
    "lose": Faults(lose=0.2),
    "repeat": Faults(repeat=0.6),
    "swap": Faults(swap=0.2),
    "delay": Faults(delay_s=0.01),
}


#: Faults that `make test` puts on the line; the others are put by the full tests.
QUICK_FAULTS = ("flip", "cut", "repeat")
#: Least updates, faults of each direction and shown frames (a busy board shows fewer than it gets updates);
#: most updates until there were as many.
LEAST_UPDATES, LEAST_FAULTS, LEAST_FRAMES, MOST_UPDATES = 10, 3, 4, 400
#: So many times shorter is a reply than a request: its bytes have faults more often, in shorter runs.
REPLY_SHARE = 8


def of_replies(faults):
    """Faults that hit as many replies as these hit requests."""
    by_byte = ("flip", "drop", "insert", "duplicate", "garble", "reorder", "cut", "stall")
    more = {name: REPLY_SHARE * getattr(faults, name) for name in by_byte}
    return dataclasses.replace(faults, **more, run=faults.run // REPLY_SHARE)


@pytest.mark.parametrize(
    "fault", [name if name in QUICK_FAULTS else pytest.param(name, marks=pytest.mark.full) for name in FAULTS]
)
def test_a_bad_line_never_tears_a_frame(drawing, fault):
    """Layers move over a line with faults: every frame that is shown is one of those that were asked for, whole."""
    rng = np.random.default_rng([SEED, 6])
    display, build = drawing.display, drawing.build
    stack = LayerStack(tuple(dataclasses.replace(random_layer(rng, display, build), visible=True) for _ in range(3)))
    wanted = {bytes(3 * WIDTH * HEIGHT), twin(display, stack, build).tobytes()}
    with Board.open(drawing.url) as board:
        show(SceneBoard(board), display, stack)
    with Proxy(drawing.url, SEED) as line, Board.open(line.url, 12_000_000, patience_s=3.0) as board:
        scene = SceneBoard(board)
        line.down, line.up = FAULTS[fault], of_replies(FAULTS[fault])
        kind, updates = "cut" if fault == "outage" else fault, 0
        while (
            updates < LEAST_UPDATES
            or (kind != "delay" and min(done[kind] for done in line.done) < LEAST_FAULTS)
            or len(captured(drawing.folder)) < LEAST_FRAMES
        ):
            assert updates < MOST_UPDATES, f"{kind}: too few faults or frames: {line.done}"
            updates += 1
            stack = moved(rng, display, build, stack)
            wanted.add(twin(display, stack, build).tobytes())
            try:
                scene.set_stack(display, stack)
            except DeviceError as error:
                print(f"{fault}: {error}")
                with contextlib.suppress(*[NoBoardError] * (fault == "outage")):
                    board.hello()
        line.down = line.up = NO_FAULTS
        print(f"{updates} updates; faults of requests and replies: {line.done}")
        board.hello()
        scene.set_stack(display, stack)
        scene.wait(True)
        assert board.panel_crc() == zlib.crc32(twin(display, stack, build).tobytes())
        assert scene.status().underflows == 0
    assert set(captured(drawing.folder)) <= wanted


@pytest.mark.parametrize("window", [1100, 8000])
def test_a_cut_load_goes_on(drawing, window, monkeypatch):
    """The line is cut in the middle: no block that has arrived is sent again."""
    # A time-out that no load of this machine brings about.
    monkeypatch.setattr("lippmann.board.retries.SHORTEST_S", 1.5)
    rng = np.random.default_rng([SEED, 7])
    build = drawing.build
    contents = {slot: rng.bytes(build.slot_bytes) for slot in range(4)}
    wanted = {
        slot: [zlib.crc32(content[k : k + 1024]) for k in range(0, len(content), 1024)]
        for slot, content in contents.items()
    }
    loaded = Loaded()
    with Proxy(drawing.url, SEED) as line:
        cut = []

        def progress(done, total):
            assert total == 4 * build.blocks
            if done == 5 and not cut:
                cut.append(done)
                line.unplug()
                time.sleep(0.3)

        with pytest.raises(DeviceError), Board.open(line.url, patience_s=2.0) as board:
            SceneBoard(board).load(contents, progress, window, loaded)
        with Board.open(line.url) as board:
            scene = SceneBoard(board)
            # Blocks of what earlier tests loaded count as missing.
            there = sum(
                found == crc for slot in contents for found, crc in zip(scene.crcs(slot), wanted[slot], strict=True)
            )
            assert there >= 5
            before = loaded.sends
            scene.load(contents, progress, window, loaded)
            assert loaded.sends - before == 4 * build.blocks - there
            # Twice were sent those that were on their way.
            assert loaded.sends - 4 * build.blocks <= max(1, window // 1024)
            for slot, crcs in wanted.items():
                assert scene.crcs(slot) == crcs
            assert scene.load(contents).skipped == 4 * build.blocks


def test_a_film_on_a_board_that_is_reset_fails(drawing):
    """Its frames are written all the same, and show nothing."""
    rng = np.random.default_rng([SEED, 9])
    stack = random_stack(rng, drawing.display, drawing.build)
    names = tuple(f"layer {k}" for k in range(len(stack.layers)))
    film = LayerFilm(stack, names, frames=4, frames_per_second=1000.0)
    with Board.open(drawing.url) as board:
        scene = SceneBoard(board)
        _, slots = load_textures(scene, drawing.display, film)
        assert play_film(scene, drawing.display, film, slots).frames == 4
        with pytest.raises(DeviceError, match=r"no longer draws the scene .*; play the film again"):
            play_film(scene, drawing.display, film, slots, progress=lambda done, _: done == 2 and board.reset())


def test_a_board_without_a_scene_says_so(tmp_path):
    display = display_of("square")
    with virtual_board.running(display) as running, Board.open(running.url) as board:
        assert board.info.version == 2
        with pytest.raises(DeviceError, match="draws no scenes"):
            SceneBoard(board)
        with pytest.raises(InputError, match="no block of registers"):
            board.read(0x400)
        for kind in (Kind.BLOCK, Kind.BLOCKS):
            with pytest.raises(DeviceError, match="does not know this type of request"):
                board.ask(kind, bytes(3), 0)

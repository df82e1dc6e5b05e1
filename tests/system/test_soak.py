"""Long runs: streams, films of layers, live pictures and broken lines; memory, files and frames are counted.

`LIPPMANN_SOAK_S` is how long each lasts, s.
"""

import math
import os
import time
import zlib
from pathlib import Path

import numpy as np
import pytest
from board_scenes import HEIGHT, WIDTH, display_of
from lippmann.base.machine import proc_mb
from lippmann.base.variant import start_mitsuba
from lippmann.board.board import Board
from lippmann.board.drawn_scene import SceneBoard
from lippmann.board.film_player import load_textures, play_film
from lippmann.board.streaming import Sender, send_frame
from lippmann.fixed.scene_build import SceneBuild
from lippmann.layers.stack import Layer, LayerStack
from lippmann.motion.film_frames import Reel
from lippmann.motion.layer_film import LayerFilm, LayerKey, MovingLayer
from lippmann.motion.live_picture import LivePicture, LiveShow
from lippmann.motion.live_windows import Hand, Screens
from lippmann.rendering.options import Settings
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import load_scene
from lippmann.simulation import virtual_board
from lippmann.simulation.toolchain import repository

pytestmark = pytest.mark.full
SOAK_S = float(os.environ.get("LIPPMANN_SOAK_S", "40"))
SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))
SCENE = SceneBuild(layers=2, slots=4, width=64, height=32)
#: Share of the time after which memory must stay, and by which it may grow.
SETTLED, GROWTH = 0.25, 0.02
#: How long a live scene moves and rests in turn, s, and the samples of its resting picture.
MOVES_S, RESTS_S, SAMPLES = 10.0, 5.0, 16
#: By time, s: memory and open files of this process, and of the board's.
Seen = list[tuple[float, tuple[float, int], tuple[float, int]]]


def film(rng) -> LayerFilm:
    """Two layers of noise, of which one moves."""
    palette = rng.integers(0, 256, (256, 4), np.uint8)
    matrix = np.array([[4.0, 0.0, 32.0], [0.0, -4.0, 16.0]])
    layers = tuple(Layer(rng.integers(0, 256, (32, 64), np.uint8), palette, z, matrix) for z in (2.0, -3.0))
    keys = (LayerKey(0), LayerKey(3, (1.0, 0.5, 1.0), 10.0))
    return LayerFilm(LayerStack(layers), ("near", "far"), 4, 1000.0, "linear", (MovingLayer(name="near", keys=keys),))


def state(pid: int) -> tuple[float, int]:
    """Return a process's resident memory, MB, and its open files."""
    return proc_mb(f"{pid}/status", "VmRSS"), len(list(Path(f"/proc/{pid}/fd").iterdir()))


def check_flat(seen: Seen) -> None:
    """Check that memory and open files of both processes, once settled, stay."""
    settled = [one for one in seen if one[0] > SETTLED * SOAK_S]
    for which in (1, 2):
        memory, handles = zip(*(one[which] for one in settled), strict=True)
        print(f"memory {memory[0]:.1f} to {max(memory):.1f} MB, files {min(handles)} to {max(handles)}")
        assert max(memory) <= (1.0 + GROWTH) * memory[0]
        assert max(handles) <= min(handles) + 1  # a connection that is being closed


def test_nothing_grows_and_no_frame_is_lost():
    print(f"seed {SEED}, {SOAK_S:g} s")
    rng = np.random.default_rng(SEED)
    display = display_of("square")
    seen: Seen = []
    frames = films = 0
    with virtual_board.running(display, scene=SCENE) as running:
        began = time.monotonic()
        while (now := time.monotonic() - began) < SOAK_S:
            with Board.open(running.url) as board:
                for _ in range(4):
                    frame = rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
                    sent = send_frame(board, frame)
                    assert sent.crc == zlib.crc32(frame.tobytes())
                    board.verify(sent.crc)
                    frames += 1
                scene, made = SceneBoard(board), film(rng)
                _, slots = load_textures(scene, display, made)
                played = play_film(scene, display, made, slots, every_frame=True)
                assert (played.frames, played.underflows) == (4, 0)
                scene.draw(False)
                board.verify(sent.crc)
                films += 1
            seen.append((now, state(os.getpid()), state(running.process.pid)))
    print(f"{frames} frames, {films} films")
    check_flat(seen)
    assert frames >= 4


class Turner(Screens):
    """A user who swings the scene for a while, rests for a while, and watches the processes."""

    def __init__(self, board_pid: int) -> None:
        super().__init__()
        self.seen: Seen = []
        self._angle = 0.0
        self._began, self._pid = time.monotonic(), board_pid

    def obey(self, hand: Hand, reel: Reel | None = None) -> bool:
        now = time.monotonic() - self._began
        if now % (MOVES_S + RESTS_S) < MOVES_S:
            angle = 20.0 * math.sin(now)  # its front stays to be seen: every picture is another one
            hand.turn(angle - self._angle, 0.0)
            self._angle = angle
        if not self.seen or now > self.seen[-1][0] + 1.0:
            self.seen.append((now, state(os.getpid()), state(self._pid)))
        return super().obey(hand, reel)


def test_live_pictures_do_not_grow_and_the_last_one_stays():
    """Every picture that was sent was shown, the board ends with the newest, and it has all its samples."""
    start_mitsuba("llvm")
    display = display_of("square")
    scene = load_scene(repository() / "scenes/fish/fish.xml").placed(Placement(0.15))
    picture = LivePicture(scene, display, "pinhole", Settings())
    hand = Hand(scene.placement, picture.middle_mm, display.panel.width_mm / WIDTH)
    with virtual_board.running(display) as running, Board.open(running.url) as board:
        before, sender, turner = board.hello().epoch, Sender(board), Turner(running.process.pid)
        played = LiveShow(picture, hand, turner, send=sender.send).run(seconds=SOAK_S, most=SAMPLES)
        sender.finish()
        print(f"{played.frames} pictures drawn, {sender.frames} shown")
        assert (board.hello().epoch - before) % (1 << 16) == sender.frames % (1 << 16)
        assert played.samples == SAMPLES
        assert picture.values.any()
        board.verify(zlib.crc32(picture.values.tobytes()))
    check_flat(turner.seen)

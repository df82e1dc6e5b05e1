"""A long run: streams, films of layers and broken lines without a pause; memory, files and frames are counted.

`LIPPMANN_SOAK_S` is how long it lasts, s.
"""

from __future__ import annotations

import os
import time
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lippmann.board.board import Board
from lippmann.board.film_player import load_textures, play_film
from lippmann.board.scene import SceneBoard
from lippmann.board.stream import send_frame
from lippmann.display import load_display
from lippmann.film.layer_film import LayerFilm, LayerKey, MovingLayer
from lippmann.fixed.scene_build import SceneBuild
from lippmann.layers.stack import Layer, LayerStack
from lippmann.limits import proc_mb
from lippmann.sim import virtual_board
from lippmann.sim.tools import repository

pytestmark = pytest.mark.full
SOAK_S = float(os.environ.get("LIPPMANN_SOAK_S", "40"))
SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))
WIDTH, HEIGHT = 112, 80
SCENE = SceneBuild(layers=2, slots=4, width=64, height=32)
#: Share of the time after which memory must stay, and by which it may grow.
SETTLED, GROWTH = 0.25, 0.02


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


def test_nothing_grows_and_no_frame_is_lost():
    print(f"seed {SEED}, {SOAK_S:g} s")
    rng = np.random.default_rng(SEED)
    plain = load_display(repository() / "scenes/displays/vga-square.toml")
    display = replace(plain, panel=replace(plain.panel, width_px=WIDTH, height_px=HEIGHT))
    seen: list[tuple[float, tuple[float, int], tuple[float, int]]] = []
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
    settled = [one for one in seen if one[0] > SETTLED * SOAK_S]
    for which in (1, 2):
        memory, handles = zip(*(one[which] for one in settled), strict=True)
        print(f"memory {memory[0]:.1f} to {max(memory):.1f} MB, files {min(handles)} to {max(handles)}")
        assert max(memory) <= (1.0 + GROWTH) * memory[0]
        assert max(handles) <= min(handles) + 1  # a connection that is being closed
    assert frames >= 4

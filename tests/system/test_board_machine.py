"""Host commands in any order, over good and bad lines: the panel shows what a model of it says, and nothing else.

A step is what a user may do: show a frame or a scene, move it, set patterns and brightness, trace, ask for what is
refused, reset, unplug, begin anew. Over a line with faults a step may fail. It is then repeated over a good line, where
it must succeed. Until it has, the panel shows the old picture or the new one, never a mixture.

LIPPMANN_STEPS sets the number of steps of the full test; 100000 take some hours.
"""

import contextlib
import os
import zlib
from collections import Counter

import cv2
import hypothesis
import numpy as np
import pytest
from board_scenes import display_of, moved, random_stack, twin
from fault_line import NO_FAULTS, Faults, Proxy
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from lippmann.board.board import Board
from lippmann.board.drawn_scene import SceneBoard
from lippmann.board.panel_frames import image_frame
from lippmann.board.streaming import send_frame
from lippmann.cli import run
from lippmann.errors import DeviceError, InputError
from lippmann.eye.test_patterns import ON_BOARD, draw
from lippmann.fixed.configuration import configuration
from lippmann.fixed.raster import Raster, raster
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.registers import BOARD_REGISTERS, optics_writes, raster_writes, write
from lippmann.fixed.scene_build import CURVE_SLOT, SceneBuild
from lippmann.fixed.scene_configuration import build_curve_table, slot_bytes
from lippmann.simulation import video_timing, virtual_board

SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))
STEPS_A_RUN = 25
#: Patience on a good line, and on one with faults, where a step may fail, s.
PATIENCE_S, FAULTS_S = 5.0, 0.5
#: A small panel with short pauses, whose frames take little time to simulate; tiles at its edges are cut.
SIZE, PAUSES = (72, 48), (8, 8, 16, 2, 2, 4, 1, 0)
#: Slots of two blocks, one of texels and the palette's, take little time to load.
BUILD = SceneBuild(layers=3, slots=4, width=32, height=32)
LOOK, LENS = BOARD_REGISTERS["display"].address, BOARD_REGISTERS["lens"].address

by_byte, by_packet = st.floats(1e-5, 2e-3), st.floats(0.01, 0.3)
FAULTS = st.fixed_dictionaries(
    {},
    optional={
        **dict.fromkeys(("flip", "drop", "insert", "duplicate", "garble", "reorder", "cut"), by_byte),
        **dict.fromkeys(("lose", "repeat", "swap"), by_packet),
        "stall": st.floats(1e-5, 3e-4),
        "delay_s": st.floats(0.0, 0.01),
        "run": st.integers(1, 300),
    },
).map(lambda given: Faults(**given, stall_s=0.05))
lines = st.one_of(st.just(NO_FAULTS), FAULTS)
seeds = st.integers(0, (1 << 32) - 1)
#: A lenslet on the panel or near it, or any that the register holds.
steps_away = st.one_of(st.integers(-3, 3), st.integers(-(1 << 11), (1 << 11) - 1))


class BoardMachine(RuleBasedStateMachine):
    """The model: the stored frame, the scene, whether it is drawn, the pattern and the brightness."""

    #: Of the test: the running board, with its display and the folder of captured frames; and what was done.
    virtual, done = None, Counter()
    #: A scene, and the twin's picture of it.
    twins = None, None

    # ---- the model ----

    def picture(self) -> bytes:
        """What the panel shows."""
        shown = self.frame
        if self.drawn:
            if self.twins[0] is not self.stack:
                self.twins = self.stack, twin(self.virtual.display, self.stack, BUILD)
            shown = self.twins[1]
        if self.pattern:
            shown = self.pattern_of(self.pattern, self.lens)
        return (shown.astype(np.uint16) * (self.brightness + 1) // 256).astype(np.uint8).tobytes()

    def pattern_of(self, pattern, lens) -> np.ndarray:
        """A test pattern, as the command draws it; black where the command refuses a lenslet beside the panel."""
        kind = ON_BOARD[pattern - 1]
        bits = self.board.optics_build().fraction_bits
        try:
            image = draw(self.virtual.display, kind, lens=lens if kind == "single-lens" else None, fraction_bits=bits)
        except InputError as error:
            assert f"lenslet {lens[0]},{lens[1]} owns no pixel" in str(error)  # noqa: PT017 (one of two outcomes)
            return self.black
        return image_frame(image, self.board.info)

    def attempt(self, faults, action, **changes) -> None:
        """Do something over a line with faults, which may fail, then over a good one; it then holds."""
        for name, value in changes.items():
            setattr(self, name, value)
        self.allowed.add(self.picture())
        if faults != NO_FAULTS:
            self.line.down = self.line.up = faults
            self.board.patience_s = FAULTS_S
            with contextlib.suppress(DeviceError):
                action()
            self.board.patience_s = PATIENCE_S
            self.line.restore()
            self.board.hello()
        action()

    # ---- steps ----

    @initialize(seed=seeds)
    def begin(self, seed):
        self.line = Proxy(self.virtual.url, seed)
        self.allowed = set()
        self.black = np.zeros((self.virtual.display.panel.height_px, self.virtual.display.panel.width_px, 3), np.uint8)
        self.open()
        self.reset(NO_FAULTS)
        assert self.board.panel_crc() == zlib.crc32(self.black.tobytes())
        for path in self.virtual.folder.glob("frame-*"):
            path.unlink()

    def open(self):
        self.board = Board.open(self.line.url, patience_s=PATIENCE_S)
        self.scene = SceneBoard(self.board)

    def set_up(self):
        """Write the optics, as `board setup` does: the patterns and the rays need them."""
        build = self.board.optics_build()
        self.config = configuration(self.virtual.display, build, build.model)
        self.board.write_all([*optics_writes(self.config), write("control", apply=1)])

    @rule(faults=lines)
    def reset(self, faults):
        self.attempt(
            faults, self.board.reset, frame=self.black, drawn=False, stack=None, pattern=0, lens=(0, 0), brightness=255
        )
        self.set_up()

    @rule(faults=lines, seed=seeds, colours=st.integers(1, 255))
    def show_frame(self, faults, seed, colours):
        rng = np.random.default_rng([seed, 1])
        frame = self.frame.copy()
        rows, columns = (np.sort(rng.integers(0, side + 1, 2)) for side in frame.shape[:2])
        part = frame[slice(*rows), slice(*columns)]
        part[...] = rng.integers(0, colours + 1, part.shape)
        self.attempt(faults, lambda: send_frame(self.board, frame), frame=frame)

    @rule(seed=seeds, share=st.floats(0.0, 1.0))
    def unplug_within_a_frame(self, seed, share):
        frame = np.random.default_rng([seed, 2]).integers(0, 256, self.frame.shape, np.uint8)

        def progress(done, total):
            if done >= share * total:
                self.line.unplug()

        before, self.frame = self.frame, frame
        self.allowed.add(self.picture())
        with contextlib.suppress(DeviceError):
            send_frame(self.board, frame, progress)
        self.board.close()
        self.open()
        assert self.board.panel_crc() in {zlib.crc32(self.picture()), self.crc_with(before)}
        send_frame(self.board, frame)

    def crc_with(self, frame):
        shown, self.frame = self.frame, frame
        crc = zlib.crc32(self.picture())
        self.frame = shown
        return crc

    @rule(faults=lines, pattern=st.integers(0, len(ON_BOARD)), brightness=st.integers(0, 255))
    def look(self, faults, pattern, brightness):
        words = [pattern << 8 | brightness]
        self.attempt(faults, lambda: self.board.write(LOOK, words), pattern=pattern, brightness=brightness)

    @rule(faults=lines, i=steps_away, j=steps_away)
    def choose_a_lens(self, faults, i, j):
        words = [(j & 0xFFF) << 16 | i & 0xFFF]
        self.attempt(faults, lambda: self.board.write(LENS, words), lens=(i, j))

    @rule(faults=lines, seed=seeds)
    def show_scene(self, faults, seed):
        rng = np.random.default_rng([seed, 3])
        display, stack = self.virtual.display, random_stack(rng, self.virtual.display, BUILD)
        slots = rng.permutation(BUILD.slots_built)[: len(stack.layers)].tolist()
        self.attempt(faults, lambda: self.scene.draw(False), drawn=False)

        def load():
            self.scene.load({CURVE_SLOT: build_curve_table(display).tobytes()})
            self.scene.load({k: slot_bytes(one, BUILD).tobytes() for k, one in zip(slots, stack.layers, strict=True)})
            self.scene.prepare(display, stack, slots)

        self.attempt(faults, load, stack=stack, slots=slots)
        self.attempt(faults, lambda: self.scene.draw(True), drawn=True)

    @precondition(lambda self: self.stack is not None)
    @rule(faults=lines, seed=seeds)
    def move_the_scene(self, faults, seed):
        stack = moved(np.random.default_rng([seed, 4]), self.virtual.display, BUILD, self.stack)

        def move():
            self.scene.set_stack(self.virtual.display, stack, self.slots)
            self.scene.wait(self.drawn)

        self.attempt(faults, move, stack=stack)

    @precondition(lambda self: self.stack is not None)
    @rule(faults=lines, on=st.booleans())
    def switch_the_scene(self, faults, on):
        self.attempt(faults, lambda: self.scene.draw(on), drawn=on)

    @rule(seed=seeds, rays=st.integers(1, 60))
    def trace(self, seed, rays):
        rng, panel = np.random.default_rng([seed, 5]), self.virtual.display.panel
        u, v = rng.integers(-8 * panel.width_px, 8 * panel.width_px, rays), rng.integers(0, 8 * panel.height_px, rays)
        zero = np.zeros_like(u)
        if self.drawn:
            with pytest.raises(DeviceError, match="refuses TRACE while its optics draw a scene"):
                self.board.trace(u, v, zero, zero)
            return
        wanted = ray_pipeline(u, v, zero, zero, self.config, self.board.optics_build())
        for got, want in zip(self.board.trace(u, v, zero, zero), wanted, strict=True):
            np.testing.assert_array_equal(got, want)

    @precondition(lambda self: not self.drawn)
    @rule(seed=seeds, faults=lines)
    def sign(self, seed, faults):
        panel, build = self.virtual.display.panel, self.board.optics_build()
        first = np.random.default_rng([seed, 6]).integers(0, [panel.width_px - 8, panel.height_px - 8]).tolist()
        frame = Raster(
            panel.width_px, panel.height_px, *((at, at + 7) for at in first), samples=2, jitter="lfsr", seed=seed
        )
        words = raster(frame, np.zeros(64, np.int64), build.fraction_bits)
        zero = np.zeros_like(words.u)
        rays = ray_pipeline(words.u, words.v, zero, zero, self.config, build)
        crc = zlib.crc32(np.stack(rays, axis=1).astype("<i4").tobytes())
        self.attempt(faults, lambda: self.board.write_all(raster_writes(frame)))
        assert self.board.sign(frame.rays) == (frame.rays, crc)

    @rule(faults=lines)
    def abort(self, faults):
        self.attempt(faults, self.board.abort)

    @rule(seed=seeds)
    def ask_for_what_is_refused(self, seed):
        """Nothing changes."""
        rng = np.random.default_rng([seed, 7])
        with pytest.raises(InputError):
            send_frame(self.board, self.frame[:-1])
        with pytest.raises(InputError):
            self.scene.load({BUILD.slots_built: bytes(BUILD.slot_bytes)})
        with pytest.raises(InputError):
            self.scene.load({0: rng.bytes(BUILD.slot_bytes - 1)})
        with pytest.raises(InputError, match="refuses WRITE"):
            self.board.write(BOARD_REGISTERS["panel"].address, [1])
        with pytest.raises(DeviceError, match="close the other program"):
            Board.open(self.virtual.url, patience_s=0.5)
        if self.drawn:
            number = int(rng.integers(len(self.stack.layers)))
            if self.stack.layers[number].visible:
                texels = 255 - np.frombuffer(slot_bytes(self.stack.layers[number], BUILD).tobytes(), np.uint8)
                with pytest.raises(DeviceError, match="the slot is shown"):
                    self.scene.load({self.slots[number]: texels.tobytes()})

    @rule(seed=seeds)
    def by_command(self, seed):
        """Another process's turn: what the board is, and a picture of a file."""
        frame = np.random.default_rng([seed, 8]).integers(0, 256, self.frame.shape, np.uint8)
        path = self.virtual.folder.parent / "picture.png"
        assert cv2.imwrite(str(path), frame[..., ::-1])
        self.board.close()
        assert run(["board", "info", "--port", self.line.url, "--json"]) == 0
        wanted = 0 if self.pattern == 0 else 1
        if wanted == 0:
            self.frame = frame
            self.allowed.add(self.picture())
        assert run(["stream", str(path), "--port", self.line.url, "--force", "--json"]) == wanted
        self.open()

    @invariant()
    def panel_shows_the_picture(self):
        assert self.board.panel_crc() == zlib.crc32(self.picture())
        self.done["steps"] += 1

    def teardown(self):
        if not hasattr(self, "line"):
            return
        self.board.close()
        self.line.close()
        self.done["faults"] += sum(done.total() for done in self.line.done)
        frames = {path.read_bytes() for path in self.virtual.folder.glob("frame-*.rgb")}
        assert frames <= self.allowed | {self.black.tobytes()}, "a torn or wrong frame"


@pytest.mark.parametrize(
    "steps", [50, pytest.param(int(os.environ.get("LIPPMANN_STEPS", "1000")), id="long", marks=pytest.mark.full)]
)
def test_any_order_of_commands(tmp_path, monkeypatch, steps):
    print(f"seed {SEED}")
    folder = tmp_path / "frames"
    folder.mkdir()
    monkeypatch.setitem(video_timing.KNOWN_TIMINGS, SIZE, PAUSES)
    display = display_of("square", SIZE)
    with virtual_board.running(display, capture=folder, scene=BUILD) as running:
        running.display, running.folder = display, folder
        BoardMachine.virtual, BoardMachine.done = running, Counter()
        settings = hypothesis.settings(
            max_examples=max(1, steps // STEPS_A_RUN), stateful_step_count=STEPS_A_RUN, deadline=None, database=None,
            suppress_health_check=list(hypothesis.HealthCheck), print_blob=True,
        )  # fmt: skip
        run_state_machine_as_test(hypothesis.seed(SEED)(BoardMachine), settings=settings)
        print(dict(BoardMachine.done))
        assert BoardMachine.done["faults"] > 0

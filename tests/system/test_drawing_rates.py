"""What loading costs on the line, and that no pixel is late: counted on the virtual board, not timed.

And the measurement of the simulated drawing (`tools.bench rtl`): what it counts and compares. No rate is judged.
"""

import os
import zlib

import numpy as np
import pytest
from lippmann.board import retries
from lippmann.board.board import Board
from lippmann.board.drawn_scene import SceneBoard
from lippmann.board.port import BITS_A_BYTE
from lippmann.board.streaming import send_frame
from lippmann.board.virtual_loop import PATIENCE_S
from lippmann.fixed import drawn_frame
from lippmann.fixed.registers import BOARD_REGISTERS
from lippmann.fixed.scene_build import SceneBuild
from lippmann.layers.stack import LayerStack
from lippmann.simulation import harness, video_timing, virtual_board
from lippmann.simulation.harness import SceneHarness
from lippmann.simulation.toolchain import repository
from test_board_scene import HEIGHT, SEED, USUAL, WIDTH, captured, display_of, moved, random_layer, show, twin
from tools import ray_speed
from tools.measured_page import measured_page

#: Of the line in the figures that are promised, and the slowest clock for it: the fewest clocks of a bit.
BAUD = 3_000_000
SLOW_HZ = BAUD * virtual_board.CLOCKS_OF_A_BIT
#: The pixel clock of 1280 x 720 at 60 frames a second.
VIDEO_HZ = 74_250_000
HD = 1280, 720


def frames_of(board):
    return board.read(BOARD_REGISTERS["frames"].address)[0]


@pytest.mark.full
def test_four_layers_are_loaded_in_a_second(monkeypatch):
    """Of the usual size, by a UART of 3 Mbaud, bit by bit; the clock is the time, in frames of the panel."""
    for name in ("FIRST_S", "SHORTEST_S", "LONGEST_S"):  # nothing is sent again because this machine is slow
        monkeypatch.setattr(retries, name, PATIENCE_S)
    build, display = SceneBuild(), display_of("square")
    front, sync, back, above, lines, below, *_ = video_timing.REDUCED
    frame_s = (WIDTH + front + sync + back) * (HEIGHT + above + lines + below) / SLOW_HZ
    contents = {slot: np.random.default_rng([SEED, slot]).bytes(build.slot_bytes) for slot in range(4)}
    with (
        virtual_board.running(display, baud=BAUD, clock_hz=SLOW_HZ, scene=build) as running,
        Board.open(running.url, BAUD, PATIENCE_S) as board,
    ):
        scene = SceneBoard(board)
        before = frames_of(board)
        loaded = scene.load(contents)
        seconds = (frames_of(board) + 1 - before) * frame_s
    print(f"{loaded.wire_bytes} bytes, {seconds:.3f} s, the line's share {loaded.wire_bytes * 10 / BAUD / seconds:.3f}")
    assert loaded.sends == loaded.blocks == 4 * build.blocks
    assert seconds <= 1.0


#: Whole frames of 1280 x 720 on a saturated line; 1000 take more than half an hour.
WHOLE_FRAMES = int(os.environ.get("LIPPMANN_FRAMES", "20"))


#: Rows of the panel, and frames: the simulated clocks are alike. Each has the lines of 1280 x 720, 1650 clocks.
@pytest.mark.full
@pytest.mark.parametrize(("rows", "frames"), [(16, 1000), (144, 100), (720, WHOLE_FRAMES)])
def test_no_pixel_is_late_on_a_saturated_line(monkeypatch, rows, frames):
    """Blocks, updates and reads on a line that carries more than 3 Mbaud do, while each clock draws a pixel."""
    rng = np.random.default_rng([SEED, 23, rows])
    size, whole = (1280, rows), display_of("square", HD)
    monkeypatch.setitem(video_timing.KNOWN_TIMINGS, size, video_timing.KNOWN_TIMINGS[HD])
    build, display = SceneBuild(), display_of("square", size)
    stack = LayerStack(tuple(random_layer(rng, whole, build) for _ in range(4)))
    texture = rng.bytes(build.slot_bytes)
    with (
        virtual_board.running(display, clock_hz=VIDEO_HZ, scene=build) as running,
        Board.open(running.url, patience_s=PATIENCE_S) as board,
    ):
        scene = SceneBoard(board)
        show(scene, display, stack)
        first, written = scene.status().frames, board.line.written
        while (drawn := scene.status().frames - first) < frames:
            scene.load({4: texture}, window_bytes=6000)
            texture = bytes(255 - byte for byte in texture)
            stack = moved(rng, whole, build, stack)
            scene.set_stack(display, stack)
            board.read(0, 64)
        rate = (board.line.written - written) * BITS_A_BYTE * VIDEO_HZ / (drawn * 1650 * (rows + 30))
        print(f"{drawn} frames of {size}, the line at {rate / 1e6:.1f} Mbaud")
        assert rate >= BAUD
        scene.wait(True)
        assert board.panel_crc() == zlib.crc32(twin(display, stack, build).tobytes())
        assert scene.status().underflows == 0


@pytest.mark.full
def test_no_pixel_of_an_sdram_is_late_while_frames_are_streamed_copied_and_checked(tmp_path):
    rng = np.random.default_rng([SEED, 41])
    print(f"seed {SEED}")
    late, crc = (BOARD_REGISTERS[name].address for name in ("counters_late", "shown_crc"))
    image = rng.integers(0, 256, (*HD[::-1], 3), np.uint8)
    sent = []
    with (
        virtual_board.running(display_of("square", HD), memory="sdram", capture=tmp_path) as running,
        Board.open(running.url, patience_s=PATIENCE_S) as board,
    ):
        clock_hz = board.info.clock_hz
        first, written, copied = frames_of(board), board.line.written, 0
        while frames_of(board) - first < 40:
            # A band of new tiles; the others are copied on the board, or are there from two frames ago.
            top = int(rng.integers(0, HD[1] - 96))
            image = image.copy()
            image[top : top + 96] = rng.integers(0, 256, (96, HD[0], 3), np.uint8)
            result = send_frame(board, image)
            copied += result.copied
            sent.append(image.tobytes())
        shown = frames_of(board) - first
        rate = (board.line.written - written) * BITS_A_BYTE * clock_hz / (shown * (1650 * 750))
        print(f"{shown} frames, {len(sent)} sent, {copied} tiles copied, the line at {rate / 1e6:.1f} Mbaud")
        assert copied > 0
        assert rate >= BAUD
        assert board.read(late) == [0]
        until = frames_of(board) + 2
        while frames_of(board) < until:
            pass
        assert board.read(crc) == [zlib.crc32(sent[-1])]
        assert running.stop()["memory_violations"] == 0
    allowed = {*sent, bytes(image.nbytes)}
    frames = captured(tmp_path)
    assert len(frames) > 2
    assert set(frames) <= allowed


def stack_on(display):
    rng = np.random.default_rng([SEED, 40])
    return LayerStack(tuple(random_layer(rng, display, USUAL) for _ in range(3)), rng.random(3))


def test_a_board_counts_every_pixel():
    """The clocks, which the simulator counts apart, are those of so many frames and what is left of one."""
    display = display_of("square")
    row = ray_speed.board(display, stack_on(display), USUAL, 3)
    front, sync, back, above, lines, below, *_ = video_timing.REDUCED
    frames, rest = divmod(row["pixels"], WIDTH * HEIGHT)
    assert rest == 0
    assert frames >= 3
    assert frames <= row["clocks"] / ((WIDTH + front + sync + back) * (HEIGHT + above + lines + below)) < frames + 2
    assert row["pixels_differ"] == 0


def test_bands_on_threads_are_the_whole_picture(monkeypatch):
    """Three models draw bands of two rows; each loads the textures and the curve once; a wrong pixel is counted."""
    display, loads = display_of("square"), []
    load, drawn = SceneHarness.load, ray_speed.rtl_scene

    def noted(harness, slot, content):
        before = harness._loaded.get(slot)
        load(harness, slot, content)
        if harness._loaded[slot] is not before:
            loads.append((id(harness), slot))

    monkeypatch.setattr(harness, "_models", {})
    monkeypatch.setattr(drawn_frame, "_CHUNK_RAYS", 2 * WIDTH)
    monkeypatch.setattr(SceneHarness, "load", noted)
    row = ray_speed.rendered(display, stack_on(display), USUAL, 3)
    assert row["pixels"] == WIDTH * HEIGHT
    assert row["pixels_differ"] == 0
    assert 4 <= len(loads) <= 3 * 4
    assert len(set(loads)) == len(loads)

    def wrong(rays, *words):
        pixels = drawn(rays, *words)
        pixels[0, 0] ^= 1
        return pixels

    monkeypatch.setattr(ray_speed, "rtl_scene", wrong)
    assert ray_speed.rendered(display, stack_on(display), USUAL, 3)["pixels_differ"] == HEIGHT // 2


def test_the_rates_are_on_the_page_of_measured_figures():
    text = measured_page(repository() / "docs/generated").text()
    assert "| vga-square | drawing board | 1 |" in text
    assert "| paper-square | render --engine rtl | 1 |" in text

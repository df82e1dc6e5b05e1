"""The measurement of the simulated drawing (`tools.bench rtl`): what it counts and compares. No rate is judged."""

import numpy as np
from lippmann.fixed import drawn_frame
from lippmann.layers.stack import LayerStack
from lippmann.simulation import harness, virtual_board
from lippmann.simulation.harness import SceneHarness
from lippmann.simulation.toolchain import repository
from test_board_scene import HEIGHT, SEED, USUAL, WIDTH, display_of, random_layer
from tools import ray_speed
from tools.measured_page import measured_page


def stack_on(display):
    rng = np.random.default_rng([SEED, 40])
    return LayerStack(tuple(random_layer(rng, display, USUAL) for _ in range(3)), rng.random(3))


def test_a_board_counts_every_pixel():
    """The clocks, which the simulator counts apart, are those of so many frames and what is left of one."""
    display = display_of("square")
    row = ray_speed.board(display, stack_on(display), USUAL, 3)
    front, sync, back, above, lines, below, *_ = virtual_board.REDUCED
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

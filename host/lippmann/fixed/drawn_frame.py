"""Draws a stack of layers on a display in integers, from pixel to pixel: what an FPGA of two builds shows."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from lippmann.display.description import Display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.fixed.scene_build import SceneBuild
from lippmann.fixed.scene_configuration import build_curve_table, scene_words, slot_bytes
from lippmann.fixed.scene_pipeline import SceneWords, scene
from lippmann.fixed.words import Bytes, Ints
from lippmann.optics.rays import Model

if TYPE_CHECKING:
    from lippmann.layers.stack import LayerStack


#: Where a pixel's samples lie, from its centre: to the right and upward, words of pixels (4 fraction bits).
SAMPLE_OFFSETS: dict[int, tuple[tuple[int, int], ...]] = {
    1: ((0, 0),),
    2: ((-4, 4), (4, -4)),
    4: ((-4, 4), (4, 4), (-4, -4), (4, -4)),
}
#: Rays drawn at once.
_CHUNK_RAYS = 1 << 16


#: A run of a build of the drawing: from exit rays to pixels, as `lippmann.fixed.scene_pipeline.scene`.
Scene = Callable[[FixedRays, SceneWords, Mapping[int, Bytes], Bytes, SceneBuild, int], Bytes]


def draw(
    display: Display,
    build: Build,
    stack: LayerStack,
    scene_build: SceneBuild,
    model: Model | None = None,
    pipeline: Callable[[Ints, Ints, Ints, Ints, Configuration, Build], FixedRays] = ray_pipeline,
    shade: Scene = scene,
    threads: int = 1,
    rows: range | None = None,
) -> Bytes:
    """Return the pixels (height, width, 3) that a build of the optics and one of the drawing show of a stack.

    With `rows` only those of the panel's rows.

    `model` is the lens model, left out the build's. `pipeline` traces the rays and `shade` draws them: the twin, unless
    others are given; they are called by some threads at once. Raises InputError when the display or the stack do not
    fit the builds.
    """
    panel, f = display.panel, build.fraction_bits
    rows = range(panel.height_px) if rows is None else rows
    registers = configuration(display, build, build.model if model is None else model)
    words = scene_words(display, stack, scene_build)
    slots = {k: slot_bytes(layer, scene_build) for k, layer in enumerate(stack.layers)}
    table = build_curve_table(display)
    parts = enumerate(sample_words(panel.width_px, panel.height_px, scene_build.samples, rows))
    one_at_a_time, stopped = threading.Lock(), threading.Event()

    def some() -> dict[int, Bytes]:
        """Draw parts of the picture until none is left."""
        drawn = {}
        while not stopped.is_set():
            with one_at_a_time:
                part = next(parts, None)
            if part is None:
                break
            number, (u, v) = part
            rays = pipeline(u, v, np.zeros_like(u), np.zeros_like(u), registers, build)
            drawn[number] = shade(rays, words, slots, table, scene_build, f)
        return drawn

    with ThreadPoolExecutor(threads) as pool:
        try:
            shares = [one.result() for one in [pool.submit(some) for _ in range(threads)]]
        finally:
            stopped.set()  # after an error, or Ctrl-C, no other part is begun
    drawn = {number: part for share in shares for number, part in share.items()}
    return np.concatenate([drawn[number] for number in sorted(drawn)]).reshape(len(rows), panel.width_px, 3)


def sample_words(width: int, height: int, samples: int, drawn_rows: range | None = None) -> Iterator[tuple[Ints, Ints]]:
    """Yield the words (u, v) of a panel's samples, or of some of its rows, pixel by pixel in raster order."""
    drawn_rows = range(height) if drawn_rows is None else drawn_rows
    at_once = max(1, _CHUNK_RAYS // (width * samples))
    offsets = np.array(SAMPLE_OFFSETS[samples])
    for first in range(drawn_rows.start, drawn_rows.stop, at_once):
        rows, columns = np.mgrid[first : min(first + at_once, drawn_rows.stop), :width]
        u = 8 * (2 * columns + 1 - width)[..., None] + offsets[:, 0]
        v = 8 * (height - 2 * rows - 1)[..., None] + offsets[:, 1]
        yield u.ravel(), v.ravel()

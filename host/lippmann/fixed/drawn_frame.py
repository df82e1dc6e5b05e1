"""Draw a stack of layers on a display in integer arithmetic, as a board does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from lippmann.display.description import Display
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.ray_pipeline import FixedRays, Pipeline, ray_pipeline
from lippmann.fixed.scene_build import SceneBuild
from lippmann.fixed.scene_configuration import build_curve_table, scene_words, slot_bytes
from lippmann.fixed.scene_pipeline import SceneWords, scene
from lippmann.fixed.words import Bytes, Ints
from lippmann.optics.rays import Model

if TYPE_CHECKING:
    from lippmann.layers.stack import LayerStack


#: Offsets of samples from a pixel's centre, right and upward, in 1/16 pixel.
SAMPLE_OFFSETS: dict[int, tuple[tuple[int, int], ...]] = {
    1: ((0, 0),),
    2: ((-4, 4), (4, -4)),
    4: ((-4, 4), (4, 4), (-4, -4), (4, -4)),
}
#: Maximum rays drawn at once.
_CHUNK_RAYS = 1 << 16
#: A function that draws exit rays, with the parameters of `scene_pipeline.scene`.
Scene = Callable[[FixedRays, SceneWords, Mapping[int, Bytes], Bytes, SceneBuild, int], Bytes]


def draw(
    display: Display,
    build: Build,
    stack: LayerStack,
    scene_build: SceneBuild,
    model: Model | None = None,
    pipeline: Pipeline = ray_pipeline,
    shade: Scene = scene,
    threads: int = 1,
    rows: range | None = None,
) -> Bytes:
    """Draw a layer stack with an optics build and a scene build; return the pixels (rows, width, 3).

    `model` is the lens model, by default the build's. `rows` are the rows to draw, by
    default all. `threads` threads call `pipeline` to trace and `shade` to draw rays, by
    default the twin's. Raises InputError if display or stack does not fit a build.
    """
    panel, f = display.panel, build.fraction_bits
    rows = range(panel.height_px) if rows is None else rows
    registers = configuration(display, build, build.model if model is None else model)
    words = scene_words(display, stack, scene_build)
    slots = {k: slot_bytes(layer, scene_build) for k, layer in enumerate(stack.layers)}
    table = build_curve_table(display)
    at_once = max(1, _CHUNK_RAYS // (panel.width_px * scene_build.samples))

    def draw_rows(part: range) -> Bytes:
        u, v = sample_words(*panel.size_px, scene_build.samples, part)
        rays = pipeline(u, v, np.zeros_like(u), np.zeros_like(u), registers, build)
        return shade(rays, words, slots, table, scene_build, f)

    with ThreadPoolExecutor(threads) as pool:
        # After an error or Ctrl-C, `map` starts no further band.
        bands = (rows[first : first + at_once] for first in range(0, len(rows), at_once))
        parts = list(pool.map(draw_rows, bands))
    return np.concatenate(parts).reshape(len(rows), panel.width_px, 3)


def sample_words(width: int, height: int, samples: int, drawn_rows: range) -> tuple[Ints, Ints]:
    """Return the pixel words (u, v) of all samples in the given rows, in raster order."""
    offsets = np.array(SAMPLE_OFFSETS[samples])
    rows, columns = np.mgrid[drawn_rows.start : drawn_rows.stop, :width]
    u = 8 * (2 * columns + 1 - width)[..., None] + offsets[:, 0]
    v = 8 * (height - 2 * rows - 1)[..., None] + offsets[:, 1]
    return u.ravel(), v.ravel()

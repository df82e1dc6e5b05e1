"""Draws a scene from exit rays, in integers (rtl/scene/lipp_scene.sv)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from lippmann.fixed.composite import composite
from lippmann.fixed.curve_table import curve_table
from lippmann.fixed.exit_line import exit_line
from lippmann.fixed.layer_coordinate import layer_coordinate
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.sample_mean import sample_mean
from lippmann.fixed.scene_build import SceneBuild
from lippmann.fixed.scene_words import SceneWords
from lippmann.fixed.texel_blend import texel_blend
from lippmann.fixed.texel_fetch import texel_fetch
from lippmann.fixed.words import Ints

Bytes = npt.NDArray[np.uint8]


def scene(
    rays: FixedRays, words: SceneWords, slots: Mapping[int, Bytes], table: Bytes, build: SceneBuild, f: int
) -> Bytes:
    """Return the pixels (N, 3) of exit rays, `build.samples` of them for each.

    Parameters
    ----------
    rays
        Exit rays in the words of an optics build with F fraction bits, in the order of their pixels.
    words
        The registers; layers that the build does not have are not read.
    slots
        What the slots hold (`slot_bytes`), by number; those that are not given hold zeros.
    table
        The panel's curve, 8192 bytes.
    build, f
        The build of the drawing, and F.
    """
    return curve_table(sample_mean(scene_light(rays, words, slots, build, f), build.samples_bits), table)


def scene_light(rays: FixedRays, words: SceneWords, slots: Mapping[int, Bytes], build: SceneBuild, f: int) -> Ints:
    """Return the light (N, 3) of exit rays, before the samples of a pixel become one; parameters as of `scene`."""
    lines = exit_line(rays, words.lattice_xi, words.lattice_xj, words.lattice_yj, f)
    empty = np.zeros(build.slot_bytes, np.uint8)
    light, opacity = [], []
    layers = words.layers[: build.layers]
    for layer, slot in zip(layers, words.slots, strict=False):
        s, t, beyond = layer_coordinate(lines, layer, build.bilinear, f)
        held = None if slot is None or slot >= build.slots_built else slots.get(slot, empty)
        one_light, one_opacity = texel_blend(*texel_fetch(s, t, beyond, held, build))
        light.append(one_light)
        opacity.append(one_opacity)
    brightness = [layer.brightness for layer in layers]
    return composite(light, opacity, lines.draws, brightness, np.array(words.background, np.int64))

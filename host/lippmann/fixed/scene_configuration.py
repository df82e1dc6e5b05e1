"""Compute a layer stack's register values (`scene_config_t`) and texture slots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lippmann.base.tones import encoded_values
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.fixed.configuration import TOO_STEEP, nearest_word
from lippmann.fixed.scene_build import SceneBuild
from lippmann.fixed.scene_pipeline import (
    COEFFICIENT_FRACTION,
    DEPTH_FRACTION,
    FULL_BRIGHTNESS,
    LATTICE_FRACTION,
    TEXEL_FRACTION,
    WHITE,
    LayerWords,
    SceneWords,
    entry_light,
)
from lippmann.fixed.words import Bytes
from lippmann.optics.lattice import Lattice
from lippmann.optics.system import System

if TYPE_CHECKING:
    from lippmann.layers.stack import Floats, Layer, LayerStack


#: Maximum distance from the array's origin, in radii, of a ray at z = 0 and of a texture.
MAX_PLACE = 2048.0
#: Scale of a sky's slopes: the largest power of two that keeps slopes below 4 in range.
SKY_DEPTH = 512.0
#: Maximum distance along x or y from a pixel to its ray's exit point, in radii: 8
#: pitches of 2 radii, and 4 radii on the exit lenslet.
EXIT_RADII = 20.0


def scene_words(
    display: Display,
    stack: LayerStack,
    build: SceneBuild,
    slots: tuple[int, ...] | None = None,
    names: Sequence[str] | None = None,
) -> SceneWords:
    """Return the register values with which a scene build draws a layer stack on a display.

    `slots` are the slot numbers of the layers' textures; by default, slot k for layer
    k. `names` are the layers' names in messages, by default their numbers. Raises
    InputError if the build has too few layers or slots, or a value does not fit its
    register.
    """
    if len(stack.layers) > build.layers:
        raise InputError(
            f"{len(stack.layers)} layers do not fit this build, which has {build.layers}; leave layers out, or build "
            f"with layers = {len(stack.layers)}"
        )
    slots = tuple(range(len(stack.layers))) if slots is None else slots
    titles = [str(k) for k in range(len(slots))] if names is None else [f"'{name}'" for name in names]
    for title, slot in zip(titles, slots, strict=True):
        if not 0 <= slot < build.slots_built:
            raise InputError(
                f"layer {title}, register look: slot {slot} is outside its range, 0 to {build.slots_built - 1}"
            )
    if len(set(slots)) < len(slots):
        raise InputError(f"register look: slots {', '.join(map(str, slots))} repeat; give each layer its own slot")
    _check_place(display)
    layers = tuple(layer_words(display, *one) for one in zip(stack.layers, titles, slots, strict=True))
    radius = display.array.radius_mm
    lattice = Lattice.of(display.array)
    (xi, _), (xj, yj) = lattice.centre(1.0, 0.0), lattice.centre(0.0, 1.0)
    steps = {
        name: nearest_word(value / radius, 32, LATTICE_FRACTION, f"register {name}", TOO_STEEP)
        for name, value in (("lattice_xi", xi), ("lattice_xj", xj), ("lattice_yj", yj))
    }
    red, green, blue = (math.floor(light * WHITE + 0.5) for light in stack.background)
    return SceneWords(layers, **steps, background=(red, green, blue))


def layer_words(display: Display, layer: Layer, number: int | str, slot: int) -> LayerWords:
    """Return a layer's register values, with its texture in a slot; `number` names the layer in messages.

    A point (X, Y) of the array's frame, in lenslet radii R, is (x, y) = R turn (X, Y) +
    offset in the panel's frame; `turn` is the rotation matrix. In the layer's plane, the
    texture coordinate is s = s0 + a X + b Y, with (a, b) = R (m00, m01) turn, s0 = m02 +
    (m00, m01) offset and the layer's matrix m. For a sky, x and y are slopes without offset.
    """
    frame = System.of(display).frame
    radius, (ox, oy) = display.array.radius_mm, frame.offset_mm
    turn = np.array([[frame.cos, -frame.sin], [frame.sin, frame.cos]])
    linear, zero = layer.matrix[:, :2] @ turn, layer.matrix[:, 2]
    if layer.sky:
        depth, linear = SKY_DEPTH, linear / SKY_DEPTH
    else:
        depth, linear = layer.depth_mm / radius, linear * radius
        zero = zero + layer.matrix[:, :2] @ (ox, oy)

    name = f"layer {number}, register"
    nearer = "bring the layer nearer, or take a lenslet of larger array.radius_mm"
    # Messages use the layers file's units: mm, texels, texels per mm or per slope of 1.
    share, unit = (SKY_DEPTH, " texels a slope of 1") if layer.sky else (1.0 / radius, " texels/mm")
    words = {"depth": nearest_word(depth, 32, DEPTH_FRACTION, f"{name} depth", nearer, radius, " mm")}
    for register, value in zip("abcd", linear.ravel().tolist(), strict=True):
        finer = "the texture is too small, or sheared too far: give it fewer texels, or make it larger"
        words[register] = nearest_word(value, 32, COEFFICIENT_FRACTION, f"{name} {register}", finer, share, unit)
    for register, value in zip(("s0", "t0"), zero.tolist(), strict=True):
        centre = "the texture is too far from the display's centre for its size: bring it nearer"
        words[register] = nearest_word(value, 32, TEXEL_FRACTION, f"{name} {register}", centre, unit=" texels")
    if not layer.sky:
        _check_reach(layer, linear, zero, number, radius)
    bright = math.floor(layer.brightness * FULL_BRIGHTNESS + 0.5)
    return LayerWords(**words, visible=layer.visible, infinite=layer.sky, slot=slot, brightness=bright)


def slot_bytes(layer: Layer, build: SceneBuild) -> Bytes:
    """Return the content of a layer's slot: texels row by row, then the palette (r, g, b, a per entry).

    Raises InputError when the texture does not fit a slot of the build.
    """
    return np.concatenate([layer.padded(build.width, build.height).ravel(), layer.palette.ravel()])


def build_curve_table(display: Display) -> Bytes:
    """Return the table of a panel's transfer curve, 8192 bytes; values of fewer than 8 bits are scaled to 8."""
    panel = display.panel
    return encoded_values(entry_light(), panel.transfer, min(panel.bits, 8)).astype(np.uint8)


def _check_place(display: Display) -> None:
    farthest = float(np.abs(System.of(display).frame.corners).max())
    radii = farthest / display.array.radius_mm + EXIT_RADII
    if radii >= MAX_PLACE:
        raise InputError(
            f"registers lattice_xi, lattice_xj and lattice_yj place the panel's corner {radii:.6g} radii from "
            f"the array's origin, outside the range [0, {MAX_PLACE:g}); raise array.radius_mm, take a smaller panel, "
            "or bring array.offset_mm nearer to 0"
        )


def _check_reach(layer: Layer, linear: Floats, zero: Floats, number: int | str, radius: float) -> None:
    if np.linalg.det(linear) == 0.0:
        return  # a texture that is constant in one direction has no corners
    corners = np.array([(s, t) for s in (0.0, layer.width) for t in (0.0, layer.height)])
    places = np.linalg.solve(linear, (corners - zero).T)
    farthest = float(np.abs(places).max())
    if farthest >= MAX_PLACE:
        raise InputError(
            f"layer {number}, registers s0, t0 and a to d place a corner of the texture {farthest * radius:.6g} "
            f"mm from the array's origin, outside the range [0, {MAX_PLACE * radius:g}) mm; make the texture smaller, "
            "or make it a sky"
        )

"""Layers and stacks: colours by hand, shapes and ranges refused, slots filled, stacks moved."""

import math
from fractions import Fraction

import numpy as np
import pytest
from lippmann.errors import InputError
from lippmann.layers.stack import Layer, LayerStack, alpha_of, bytes_of, light_of, opacity_of
from random_stacks import random_layer
from scene_cases import focused_display, generator

SEED = 1611
PLAIN = {
    "texels": np.zeros((3, 4), np.uint8), "palette": np.zeros((256, 4), np.uint8), "depth_mm": 5.0,
    "matrix": np.eye(3)[:2],
}  # fmt: skip


def test_light_is_the_square_of_a_byte_and_comes_back():
    every = np.arange(256, dtype=np.uint8)
    # 65025 = 255^2 is white, so that a byte's light in the board's words is its square.
    assert (np.rint(65025 * light_of(every)) == every.astype(int) ** 2).all()
    assert (bytes_of(light_of(every)) == every).all()
    # The nearest byte to a light in the middle: 0.5 is 180.31^2 / 65025.
    assert bytes_of(np.array([0.5]))[0] == 180


def test_opacity_has_256_steps_without_one_half_lost():
    opacity = opacity_of(np.arange(256))
    assert [Fraction(x) for x in opacity[[0, 1, 127, 128, 255]]] == [
        0, Fraction(1, 256), Fraction(127, 256), Fraction(129, 256), 1,
    ]  # fmt: skip
    assert (alpha_of(opacity) == np.arange(256)).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"texels": np.zeros((3, 4), np.int64)}, "texels has type int64; give uint8"),
        ({"texels": np.zeros(4, np.uint8)}, r"texels has shape \(4,\); give \(height, width\)"),
        ({"texels": np.zeros((2, 1025), np.uint8)}, "the texture has 1025 x 2 texels; give at most 1024 x 1024"),
        ({"palette": np.zeros((256, 3), np.uint8)}, r"palette has shape \(256, 3\); give \(256, 4\)"),
        ({"depth_mm": math.nan}, "depth_mm nan is not a number"),
        ({"depth_mm": "5"}, "depth_mm '5' is not a number"),
        ({"depth_mm": -math.inf}, "depth_mm -inf is out of range; give -1e.06 to 1e.06, or inf for a sky"),
        ({"matrix": np.eye(3)}, r"matrix has shape \(3, 3\); give \(2, 3\)"),
        ({"matrix": np.full((2, 3), np.nan)}, "matrix contains a value that is not finite"),
        ({"matrix": "one"}, "matrix contains something that is not a number"),
        ({"brightness": 1.01}, "brightness 1.01 is out of range; give 0 to 1"),
        ({"visible": 1}, "visible must be True or False, not '1'"),
    ],
)
def test_a_wrong_layer_is_refused(change, message):
    Layer(**PLAIN)
    with pytest.raises(InputError, match=message):
        Layer(**{**PLAIN, **change})


def test_a_wrong_stack_is_refused():
    layer = Layer(**PLAIN)
    for layers, background, message in (
        ((), (0, 0, 0), "0 layers; give 1 to 8"),
        ((layer,) * 9, (0, 0, 0), "9 layers; give 1 to 8"),
        (("fish",), (0, 0, 0), "layer 0 is a str; give a Layer"),
        ((layer,), (0, 0), r"background has shape \(2,\); give \(3,\)"),
        ((layer,), (0, 0, 1.5), r"background \[0.0, 0.0, 1.5\] is out of range"),
    ):
        with pytest.raises(InputError, match=message):
            LayerStack(layers, np.array(background))


def test_arrays_are_copies_that_nobody_changes():
    texels = np.zeros((3, 4), np.uint8)
    layer = Layer(**{**PLAIN, "texels": texels})
    texels[:] = 7
    assert not layer.texels.any()
    with pytest.raises(ValueError, match="read-only"):
        layer.matrix[0, 0] = 2.0


def test_a_smaller_texture_fills_a_slot_with_a_transparent_colour():
    texels = np.arange(1, 13, dtype=np.uint8).reshape(3, 4)
    palette = np.full((256, 4), 255, np.uint8)
    palette[200, 3] = 0
    layer = Layer(texels, palette, 0.0, PLAIN["matrix"])
    slot = layer.padded(8, 5)
    assert (slot[:3, :4] == texels).all()
    assert (slot[3:] == 200).all()
    assert (slot[:, 4:] == 200).all()
    assert layer.padded(4, 3) is layer.texels
    opaque = Layer(texels, np.full((256, 4), 255, np.uint8), 0.0, PLAIN["matrix"])
    assert (opaque.padded(4, 3) == texels).all()
    with pytest.raises(InputError, match=r"4 x 3 texels leaves a part .* no transparent colour .* give 8 x 5 texels"):
        opaque.padded(8, 5)
    for size in ((3, 5), (8, 2)):
        with pytest.raises(InputError, match=f"4 x 3 texels is larger than a slot of {size[0]} x {size[1]}"):
            layer.padded(*size)


def test_a_moved_layer_shows_the_same_texel_at_the_moved_point():
    random = generator(SEED, "moved")
    display = focused_display("square", width_px=64, height_px=48)
    for _ in range(50):
        layer = random_layer(random, display)
        scale, offset = float(np.exp(random.uniform(-2, 2))), random.uniform(-20, 20, 3)
        after = LayerStack((layer,)).moved(scale, tuple(offset)).layers[0]
        if layer.sky:
            assert after is layer
            continue
        x, y = random.uniform(-30, 30, 2)
        point = scale * np.array([x, y, layer.depth_mm]) + offset
        assert after.depth_mm == pytest.approx(point[2], abs=1e-9)
        assert after.matrix @ [point[0], point[1], 1] == pytest.approx(layer.matrix @ [x, y, 1], abs=1e-6)
    with pytest.raises(InputError, match=r"scale 0\.0 is out of range"):
        LayerStack((layer,)).moved(0.0)

"""Layers, stacks and palettes: colours by hand, shapes and ranges refused, slots filled, stacks moved."""

import math
from fractions import Fraction

import numpy as np
import pytest
from layer_cases import free_layer
from lippmann.errors import InputError
from lippmann.layers.stack import (
    Layer,
    LayerStack,
    alpha_of,
    bytes_of,
    light_of,
    nearest,
    opacity_of,
    quantise,
    rgba_of,
)
from PIL import Image
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
        ({"matrix": "one"}, "matrix has an entry that is not a number; give"),
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
    with pytest.raises(InputError, match=r"4 x 3 texels is smaller .* no transparent colour.* give 8 x 5 texels"):
        opaque.padded(8, 5)
    for size in ((3, 5), (8, 2)):
        with pytest.raises(InputError, match=f"4 x 3 texels is larger than a slot of {size[0]} x {size[1]}"):
            layer.padded(*size)


def test_a_moved_layer_shows_the_same_texel_at_the_moved_point():
    random = generator(SEED, "moved")
    display = focused_display("square", width_px=64, height_px=48)
    for _ in range(50):
        layer = free_layer(random, display)
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


def premultiplied(rgba):
    share = rgba.astype(np.float64) / 255.0
    return share[..., :3] * share[..., 3:]


def measured_db(rgba, texels, palette):
    """The error, written out: mean square of what is seen, against a signal of 1."""
    return -10.0 * np.log10(((premultiplied(rgba) - premultiplied(palette[texels])) ** 2).mean())


@pytest.mark.parametrize("colours", [1, 2, 100, 255])
def test_a_picture_of_few_colours_keeps_them_all(colours):
    random = generator(SEED, colours)
    kept = np.unique(random.integers(1, 256, (colours, 4), np.uint8), axis=0)
    rgba = kept[random.integers(0, len(kept), (40, 50))]
    rgba[random.random((40, 50)) < 0.2, 3] = 0  # of any colour, but transparent
    texels, palette, error_db = quantise(rgba)
    clear = rgba[..., 3] == 0
    assert (palette[texels][~clear] == rgba[~clear]).all()
    assert (texels[clear] == 0).all()
    assert (palette[0] == 0).all()
    assert error_db == np.inf


@pytest.mark.parametrize("case", range(4))
def test_the_error_is_measured_and_smaller_than_pillow_s(case):
    random = generator(SEED, "error", case)
    v, u = np.mgrid[:96, :128] / 128.0
    waves = [np.sin(random.uniform(2, 12) * u + random.uniform(2, 12) * v + k) for k in range(4)]
    rgba = np.rint(127.5 + 127.5 * np.stack(waves, axis=-1)).astype(np.uint8)
    if case % 2:
        rgba[..., 3] = 255
    texels, palette, error_db = quantise(rgba)
    own = measured_db(rgba, texels, palette)
    assert error_db == pytest.approx(own, abs=1e-9)
    pillow = Image.fromarray(rgba, "RGBA").quantize(255, Image.Quantize.FASTOCTREE)
    theirs = measured_db(rgba, np.asarray(pillow), np.array(pillow.getpalette("RGBA"), np.uint8).reshape(-1, 4))
    assert own > theirs + 1.0


def test_opaque_texels_stay_opaque_among_many_that_nearly_are():
    random = generator(SEED, "opaque")
    rgba = random.integers(0, 256, (64, 64, 4), np.uint8)
    rgba[..., 3] = np.where(random.random((64, 64)) < 0.5, 255, random.integers(200, 255, (64, 64)))
    texels, palette, _ = quantise(rgba)
    assert (palette[texels][rgba[..., 3] == 255, 3] == 255).all()
    # Though another colour is nearer.
    palette = np.array([[10, 10, 10, 254], [60, 60, 60, 255]], np.uint8)
    assert nearest(np.array([[10, 10, 10, 255], [10, 10, 10, 253]], np.uint8), palette).tolist() == [1, 0]


def test_a_picture_s_bytes_are_square_roots_of_its_light():
    rgba = rgba_of(np.array([[[1.0, 0.25, 0.0]], [[0.49, 0.0, 0.0]]]), np.array([[1.0], [0.0]]))
    assert rgba.tolist() == [[[255, 128, 0, 255]], [[178, 0, 0, 0]]]

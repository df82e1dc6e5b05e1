"""Palettes of pictures: few colours are kept, the error is what it says, opaque stays opaque."""

import numpy as np
import pytest
from lippmann.layers.stack import nearest, quantise, rgba_of
from PIL import Image
from scene_cases import generator

SEED = 1614


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

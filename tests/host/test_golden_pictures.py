"""The shipped scenes still look as they did: small integral images against stored ones."""

import functools
import itertools
import math

import numpy as np
import pytest
from golden_pictures import BEFORE, SCENES, STANDS, SUBPIXELS, path_of, placement_of, render_golden
from lippmann.rendering import sampling as samples
from lippmann.scenes.scene import load_scene
from make_golden import old_places
from PIL import Image

#: dB, of sRGB values with 255 as the peak. Equal code on another processor differs by rounding: a ray on an outline
#: meets the other side, 1 of 16 samples of that pixel. All outline pixels doing so would still make 40 dB.
PSNR = 40.0
#: Levels of 255, of the mean over 4 x 4 pixels: one outline sample each in a row of four makes 4.
MAX_MEAN = 6.0


@pytest.fixture(scope="module")
def scene_of(mi):
    return functools.cache(lambda name: load_scene(SCENES / name / f"{name}.xml", placement_of(name)))


def blocks(picture):
    """Means over 4 x 4 pixels."""
    return picture.astype(float).reshape(24, 4, 24, 4, 3).mean(axis=(1, 3))


@pytest.mark.parametrize(("name", "grid"), list(itertools.product(STANDS, SUBPIXELS)))
def test_as_stored(mi, scene_of, name, grid):
    """Wanted changes: python tests/host/make_golden.py"""
    check(render_golden(scene_of(name), grid), path_of(name, grid))


@pytest.mark.full
@pytest.mark.parametrize(("name", "grid"), list(itertools.product(STANDS, SUBPIXELS)))
def test_as_version_0_1_but_for_the_places_of_samples(mi, scene_of, name, grid, monkeypatch):
    """By the places that it gave samples, each ray's own light makes its pictures."""
    monkeypatch.setattr(samples, "points_in_pixel", old_places)
    check(render_golden(scene_of(name), grid), BEFORE / f"{name}-{grid}.png")


def check(now, path):
    stored = np.asarray(Image.open(path))
    assert stored.shape == now.shape == (96, 96, 3)
    error = now.astype(float) - stored
    psnr = 10.0 * math.log10(255.0**2 / max((error**2).mean(), 1e-9))
    worst = np.abs(blocks(now) - blocks(stored)).max()
    print(f"{path.stem}: PSNR {psnr:.1f} dB, largest difference of 4 x 4 means {worst:.2f}")
    assert psnr >= PSNR
    assert worst <= MAX_MEAN

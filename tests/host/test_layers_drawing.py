"""Drawn layers: by hand through a pinhole display, and against another drawing of random stacks."""

import dataclasses
import itertools
from types import SimpleNamespace

import lippmann as lp
import numpy as np
import pytest
from layer_cases import float_light, float_lines, free_stack
from lippmann.base.tones import encoded_values
from lippmann.engines import trace
from lippmann.errors import InputError
from lippmann.layers.layer_drawing import BOARD_BITS, FILTERS, draw_golden, exit_lines, panel_bytes, scene_build_of
from lippmann.layers.stack import Layer, LayerStack
from lippmann.optics.rays import Status
from scene_cases import focused_display, generator

SEED = 1613
#: 8 x 8 pixels of 0.25 mm behind lenslets of 1 mm, D = 4 mm. Pixel 0 is 0.875 mm left of the middle, 0.125 mm right of
#: the centre of lenslet -1; its ray's slope is -0.125 / 4, so that it meets z = 16 mm at x = -1.5 mm. The others do
#: at -2.5, 1.5, 0.5, -0.5, -1.5, 2.5 and 1.5 mm.
HAND = focused_display("square", focal=4.0, width_px=8, height_px=8, pixel_pitch=0.25)
#: Texels of 1 mm, the first from x = -4 mm and from y = 4 mm; and the column of each pixel's.
MATRIX = np.array([[1.0, 0.0, 4.0], [0.0, -1.0, 4.0]])
COLUMNS = [2, 1, 5, 4, 3, 2, 6, 5]


def palette_of(*colours):
    palette = np.zeros((256, 4), np.uint8)
    palette[: len(colours)] = np.reshape(colours, (-1, 4))
    return palette


def numbered(depth_mm=16.0, matrix=MATRIX, palette=None, **others):
    """A layer of 8 x 8 texels, each of another colour: red is the column, green the row, as bytes 25 times so large."""
    number = np.arange(64)
    colours = np.stack([25 * (number % 8), 25 * (number // 8), 0 * number, 255 + 0 * number], axis=1)
    texels = number.reshape(8, 8).astype(np.uint8)
    return Layer(texels, palette_of(*colours) if palette is None else palette, depth_mm, matrix, **others)


def drawn(*layers, background=(0.0, 0.0, 0.0), display=HAND, **options):
    light = draw_golden(display, LayerStack(layers, np.array(background)), model="pinhole", **options)
    return SimpleNamespace(light=light, panel=panel_bytes(display, light))


@pytest.mark.parametrize("filter", FILTERS)
def test_every_pixel_of_a_pinhole_display_sees_its_texel(filter):
    """At texel centres both filters see one texel alone."""
    light = drawn(numbered(), filter=filter).light
    red, green = np.meshgrid(COLUMNS, COLUMNS)
    wanted = (25.0 * np.stack([red, green, 0 * red], axis=-1) / 255.0) ** 2
    assert abs(light - wanted).max() < 1e-12


def test_bilinear_by_hand():
    """A quarter of a texel to the right of texel 2's centre: 3/4 of its light and 1/4 of texel 3's."""
    shifted = MATRIX + np.array([[0, 0, 0.25], [0, 0, 0]])
    light = drawn(numbered(matrix=shifted), filter="bilinear").light
    assert light[0, 0, 0] == pytest.approx((0.75 * 50**2 + 0.25 * 75**2) / 65025, abs=1e-12)
    # Up by an eighth too, t = 2.375: 7/8 of row 2, 1/8 of row 1.
    light = drawn(numbered(matrix=shifted - [[0, 0, 0], [0, 0, 0.125]]), filter="bilinear").light
    assert light[0, 0, 1] == pytest.approx((0.875 * 50**2 + 0.125 * 25**2) / 65025, abs=1e-12)


def test_layers_are_composited_from_front_to_back():
    """Opacity 128 is 129/256; the layer behind shows through the rest, and the background through both."""
    front = Layer(np.zeros((9, 9), np.uint8), palette_of((255, 0, 0, 128)), 16.0, MATRIX)
    behind = Layer(np.zeros((9, 9), np.uint8), palette_of((0, 255, 0, 64)), -16.0, MATRIX)
    one, two = 129 / 256, 64 / 256
    light = drawn(front, behind, background=(0, 0, 1)).light
    assert light[3, 3] == pytest.approx([one, (1 - one) * two, (1 - one) * (1 - two)], abs=1e-15)
    # The order is the stack's, not that of the depths.
    assert drawn(behind, front, background=(0, 0, 1)).light[3, 3] == pytest.approx(
        [(1 - two) * one, two, (1 - one) * (1 - two)], abs=1e-15
    )


def test_the_panel_s_bytes_follow_iec_61966():
    """The curve, written out from the standard: 12.92 L below 0.0031308, else 1.055 L^(1/2.4) - 0.055."""
    values = [0, 5, 12, 13, 14, 60, 128, 180, 255]
    palette = palette_of(*[(v, v, v, 255) for v in values])
    for k, value in enumerate(values):
        layer = Layer(np.full((9, 9), k, np.uint8), palette, 16.0, MATRIX)
        light = (value / 255) ** 2
        encoded = 12.92 * light if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055
        assert set(drawn(layer).panel.ravel().tolist()) == {round(255 * encoded)}
    # A panel of 5 bits has 32 levels, spread over the bytes. One of 12 bits gets bytes, too.
    five, deep = (dataclasses.replace(HAND, panel=dataclasses.replace(HAND.panel, bits=bits)) for bits in (5, 12))
    layer = Layer(np.full((9, 9), 7, np.uint8), palette, 16.0, MATRIX)
    level = round(31 * (1.055 * (180 / 255) ** (2 / 2.4) - 0.055))
    assert set(drawn(layer, display=five).panel.ravel()) == {round(level * 255 / 31)}
    assert (drawn(layer, display=deep).panel == drawn(layer).panel).all()
    assert BOARD_BITS == 8


CASES = list(itertools.product(("square", "hex"), FILTERS, (1, 2, 4)))


@pytest.mark.parametrize(("grid", "filter", "samples"), CASES)
def test_random_stacks_against_a_drawing_from_back_to_front(grid, filter, samples):
    random = generator(SEED, grid, filter, samples)
    display = focused_display(
        grid, focal=3.3, width_px=48, height_px=36, pixel_pitch=0.1, rotation=float(random.uniform(0, 90)),
        offset=tuple(random.uniform(-1, 1, 2)),
    )  # fmt: skip
    offsets = {1: [(0, 0)], 2: [(-0.25, -0.25), (0.25, 0.25)], 4: list(itertools.product((-0.25, 0.25), repeat=2))}
    for _ in range(4):
        stack = free_stack(random, display)
        light = draw_golden(display, stack, filter, samples)
        places = random.integers((48, 36), size=(60, 2))
        rays = trace(display, (places[:, None] + 0.5 + offsets[samples]).reshape(-1, 2))
        draws = np.isin(rays.status, (Status.OK, Status.CROSSTALK))
        wanted = float_light(stack, float_lines(rays), draws, filter == "bilinear").reshape(60, samples, 3)
        # A ray within rounding of a texel's edge may see either side of it; none of these seeds has one.
        assert light[places[:, 1], places[:, 0]] == pytest.approx(wanted.mean(axis=1), abs=1e-9)


def test_rays_without_an_exit_are_black():
    """An array that ends on the panel: rays beyond it are blocked, and black before a white background."""
    whole = focused_display("square", focal=4.0, width_px=40, height_px=32, pixel_pitch=0.25)
    ended = dataclasses.replace(whole, array=dataclasses.replace(whole.array, extent_mm=(4.9, 2.9)))
    layer = Layer(np.zeros((1, 1), np.uint8), palette_of((0, 0, 0, 0)), 5.0, MATRIX)
    light = draw_golden(ended, LayerStack((layer,), np.ones(3)))
    u, v = np.meshgrid(np.arange(40) + 0.5, np.arange(32) + 0.5)
    status = trace(ended, np.stack([u, v], axis=-1).reshape(-1, 2)).status.reshape(32, 40)
    good = (status == Status.OK) | (status == Status.CROSSTALK)
    assert 0.05 < good.mean() < 0.5
    assert (light[good] == 1.0).all()
    assert (light[~good] == 0.0).all()


def test_slopes_beyond_four_do_not_draw():
    """Pixels far aside of lenslets very near to the panel: the pinhole's slope is their distance over D."""
    steep = focused_display("square", focal=20.0, width_px=40, height_px=40, pixel_pitch=0.1)
    steep = dataclasses.replace(steep, gap_mm=0.07)
    limit = 4.0 * steep.aperture_distance_mm
    lines = list(exit_lines(steep, model="pinhole"))
    assert len(lines) == 1
    x = (np.arange(40) + 0.5 - 20) * 0.1
    local = abs(x - np.rint(x))
    wanted = np.maximum(local[None], local[:, None]) <= limit
    assert (lines[0].draws.reshape(40, 40) == wanted).all()
    assert 0.2 < wanted.mean() < 0.8


def test_a_tall_picture_is_drawn_in_parts(monkeypatch):
    import lippmann.layers.layer_drawing as module

    stack = free_stack(generator(SEED, "parts"), HAND)
    whole = draw_golden(HAND, stack, "bilinear", 4)
    monkeypatch.setattr(module, "CHUNK_RAYS", 70)
    assert len(list(exit_lines(HAND, 4))) == 4
    parts = draw_golden(HAND, stack, "bilinear", 4)
    assert (whole == parts).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"filter": "cubic"}, "unknown filter 'cubic'; choose from nearest, bilinear"),
        ({"samples": 3}, "drawn with 1, 2, 4 samples a pixel, not 3"),
        ({"samples": True}, "drawn with 1, 2, 4 samples a pixel, not True"),
        ({"samples": 2.0}, "samples a pixel, not 2.0; give one of these integers"),
        ({"samples": "2"}, "samples a pixel, not '2'; give one of these integers"),
        ({"engine": "twin", "fraction_bits": "16"}, '"16" is not valid; give a whole number from 14 to 23'),
        ({"engine": "twin", "fraction_bits": 16.0}, "fraction_bits: 16.0 is not valid; give a whole number from 14"),
        ({"engine": "twin", "fraction_bits": 24}, "fraction_bits: 24 is not valid; give a whole number from 14 to 23"),
        ({"engine": "golden", "fraction_bits": 16}, "belongs to the engines twin and rtl; leave it out with golden"),
        ({"engine": "fast"}, "unknown engine 'fast'; choose from golden, twin, rtl"),
        ({"model": "thick"}, "unknown model 'thick'"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        lp.draw(LayerStack((numbered(),)), HAND, **options)


def test_a_texture_that_no_board_holds_is_named():
    """260 blocks of 1024 texels; a slot has 255 at most. Golden has no slots."""
    small, big = (Layer(np.zeros(size, np.uint8), palette_of(), 1.0, np.eye(3)[:2]) for size in ((4, 4), (259, 1000)))
    stack = LayerStack((small, big))
    says = r"layers: layer\[1\]: 1000 x 259 texels need slots of 1024 x 260, .* at most 261120 texels"
    with pytest.raises(InputError, match=says):
        lp.draw(stack, focused_display("square"), engine="twin")
    assert lp.draw(stack, focused_display("square")).radiance.shape[2] == 3


@pytest.mark.parametrize("filter", FILTERS)
def test_the_twin_draws_what_golden_draws(filter):
    """Layers of a texel of 4 mm or more, so that few pixels lie within the twin's rounding of a texel's edge."""
    random = generator(SEED, "twin", filter)
    display = focused_display("hex", focal=3.3, width_px=96, height_px=64, pixel_pitch=0.1, rotation=7.0)
    texels = random.integers(0, 8, (6, 8), np.uint8)
    palette = palette_of(*random.integers(0, 256, (7, 4)))  # and a transparent colour
    matrix = np.array([[0.25, 0.05, 3.1], [0.02, -0.25, 2.9]])
    layers = (Layer(texels, palette, 12.0, matrix), Layer(texels[::-1], palette, -30.0, matrix))
    stack = LayerStack(layers, random.random(3))
    golden, twin = (lp.draw(stack, display, filter=filter, samples=4, engine=e) for e in ("golden", "twin"))
    values = [encoded_values(image.radiance, "srgb", 8).astype(int) for image in (golden, twin)]
    differ = abs(values[0] - values[1])
    assert (differ <= 1).mean() > 0.995
    assert twin.metadata["engine"] == "twin"


@pytest.mark.parametrize(
    ("sizes", "wanted"),
    [([(256, 192)], (256, 192)), ([(1, 1)], (32, 32)), ([(33, 5), (20, 17)], (64, 32)), ([(1000, 7)], (1024, 8))],
)
def test_the_least_build_holds_all_textures(sizes, wanted):
    layers = tuple(Layer(np.zeros((h, w), np.uint8), palette_of(), 0.0, MATRIX) for w, h in sizes)
    for filter, samples in itertools.product(FILTERS, (1, 2, 4)):
        build = scene_build_of(LayerStack(layers), filter, samples)
        assert (build.width, build.height, build.layers) == (*wanted, len(sizes))
        assert (build.bilinear, build.samples) == (filter == "bilinear", samples)

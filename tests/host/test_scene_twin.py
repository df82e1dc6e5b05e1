"""The twin of the drawing against float64: lines, coordinates and colours from the definitions, on random displays."""

import dataclasses
import math
import os

import numpy as np
import pytest
from layer_cases import float_coordinates, float_light, float_lines, random_stack
from lippmann import load_layers
from lippmann.base.tones import encoded_values
from lippmann.display.description import load_display
from lippmann.errors import InputError
from lippmann.fixed.build import Build
from lippmann.fixed.conversion import pixels_of_words, rays_of_words
from lippmann.fixed.drawn_frame import draw, sample_words
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.scene_build import SceneBuild
from lippmann.fixed.scene_configuration import build_curve_table, scene_words, slot_bytes
from lippmann.fixed.scene_pipeline import (
    LayerWords,
    SceneWords,
    coefficient_bits,
    composite,
    curve_table,
    entry_light,
    exit_line,
    layer_coordinate,
    sample_mean,
    scene_light,
    texel_blend,
    texel_fetch,
)
from lippmann.layers.layer_drawing import draw_golden, exit_lines, panel_bytes
from lippmann.layers.scene_cutting import reach_of
from lippmann.layers.stack import Layer, LayerStack
from lippmann.optics.rays import gets_through
from lippmann.optics.system import System
from lippmann.simulation.toolchain import repository
from lippmann.simulation.virtual_board import board_build
from random_cases import configured_display
from scene_cases import focused_display

DISPLAYS = repository() / "scenes" / "displays"


@pytest.fixture
def rng():
    seed = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))
    print(f"seed: LIPPMANN_SEED={seed}")
    return np.random.default_rng(seed)


def cases(rng, build, count, rays=1500):
    """Random displays, the twin's exit rays of some of their pixels, and these rays in the display's frame."""
    for _ in range(count):
        display, config = configured_display(rng, build, build.model)
        panel = display.panel
        columns, rows = rng.integers(0, panel.width_px, rays), rng.integers(0, panel.height_px, rays)
        u, v = 8 * (2 * columns + 1 - panel.width_px), 8 * (panel.height_px - 2 * rows - 1)
        exits = ray_pipeline(u, v, np.zeros_like(u), np.zeros_like(u), config, build)
        there = np.asarray(gets_through(exits.status))
        if there.any():
            exits = type(exits)(*(word[there] for word in exits))
            pixels = pixels_of_words(display, u[there], v[there])
            yield display, exits, rays_of_words(display, pixels, exits, build.fraction_bits)


BUILDS = [
    Build(16, "square"),
    Build(16, "hex", converge=True),
    Build(23, "square", viewer=True, max_cell_steps=2),
    Build(23, "hex", shear=True),
]


@pytest.mark.parametrize("build", BUILDS, ids=lambda b: f"{b.grid}-{b.fraction_bits}")
def test_lines_and_coordinates_are_within_their_bounds(rng, build):
    f = build.fraction_bits
    scene_build = SceneBuild(8, bilinear=bool(rng.random() < 0.5))
    layers = 0
    for display, exits, rays in cases(rng, build, 12):
        stack = random_stack(rng, display, scene_build)
        words = scene_words(display, stack, scene_build)
        lines = exit_line(exits, words.lattice_xi, words.lattice_xj, words.lattice_yj, f)
        x, y, slope_x, slope_y = float_lines(rays)
        frame, radius = System.of(display).frame, display.array.radius_mm
        slopes = np.stack(frame.turn_back(slope_x, slope_y))
        # dz below a quarter does not draw; the host keeps places in range.
        assert (lines.draws == (rays.direction[:, 2] >= 0.25)).all()
        kept = lines.draws

        steep = 0.8 + 1.25 * np.abs(slopes)
        error = np.abs(np.stack([lines.slope_x, lines.slope_y]) - np.ldexp(slopes, f + 1))
        assert (error <= steep)[:, kept].all()
        places = np.stack(frame.array_from_panel(x, y)) / radius
        lattice = np.ldexp(np.abs(exits.i) + np.abs(exits.j), f - 3 - 31)
        along = np.abs(np.ldexp(exits.z, -f - 1)) * steep / 16
        error = np.abs(np.stack([lines.x, lines.y]) - np.ldexp(places, f - 3))
        assert (error <= 1.5 + lattice + along)[:, kept].all()

        for layer, registers in zip(stack.layers, words.layers, strict=True):
            s, t, beyond = layer_coordinate(lines, registers, False, f)
            exact = float_coordinates(layer, x, y, slope_x, slope_y)
            near = kept & (np.abs(exact) < 2000).all(axis=0)
            if layer.sky:
                depth, reach = 512.0, 512.0 * np.abs(slopes)
            else:
                depth = layer.depth_mm / radius
                reach = np.abs(places + depth * slopes)
            near &= (reach < 2047).all(axis=0)
            assert not beyond[near].any()
            factors = np.ldexp(np.abs([[registers.a, registers.b], [registers.c, registers.d]]), -24)
            # X' and Y': the place, the slope times the depth, the depth's own word, and roundings.
            plane = (0.0 if layer.sky else error * 2.0 ** (3 - f)) + 3.5 * 2.0 ** (2 - f) * 0.5
            plane = plane + abs(depth) * 2.0 ** -(f + 1) * steep + np.abs(slopes) * 2.0 ** (3 - f)
            bound = factors @ plane + 2.0 ** -coefficient_bits(f) * reach.sum(axis=0) + 2.0**-14
            for k, word in enumerate((s, t)):
                below = exact[k] - word / 256
                # The coordinate is cut: up to a unit below.
                assert (below >= -bound[k])[near].all()
                assert (below <= 1 / 256 + bound[k])[near].all()
            layers += 1
    assert layers > 10


@pytest.mark.parametrize("bilinear", [False, True], ids=["nearest", "bilinear"])
@pytest.mark.parametrize("build", BUILDS, ids=lambda b: f"{b.grid}-{b.fraction_bits}")
def test_light_is_that_of_the_definitions(rng, build, bilinear):
    """From the twin's own exit rays: light within the roundings, away from the texels' edges where these are seen."""
    f = build.fraction_bits
    scene_build = SceneBuild(8, bilinear=bilinear)
    compared = 0
    for display, exits, rays in cases(rng, build, 10):
        stack = random_stack(rng, display, scene_build, smooth=bilinear)
        words = scene_words(display, stack, scene_build)
        slots = {k: slot_bytes(layer, scene_build) for k, layer in enumerate(stack.layers)}
        got = scene_light(exits, words, slots, scene_build, f) / 65025
        lines = float_lines(rays)
        draws = rays.direction[:, 2] >= 0.25
        wanted = float_light(stack, lines, draws, bilinear)
        clear = np.ones(len(draws), bool)
        spread = 0.0
        for layer, registers in zip(stack.layers, words.layers, strict=True):
            exact = float_coordinates(layer, *lines)
            size = np.abs([registers.a, registers.b, registers.c, registers.d]).max() / 2**24
            depth = abs(registers.depth) / 2**20
            off = 2 * size * (2.0 ** (5 - f) + depth * 2.0 ** (1 - f)) + 2.0**-9
            edge = np.abs(exact - np.rint(exact))
            clear &= bilinear | (edge > off).all(axis=0)
            # A step of a coordinate, 2^-9 after rounding and its error, turns into light by the texels' contrast: 1.
            spread += 2 * (2.0**-8 + off) if bilinear else 0.0
        bound = spread + len(stack.layers) * 3 / 65025 + 4 / 65025 + len(stack.layers) / 512
        # Brightness is rounded to 1/256: half a unit of 1/256.
        assert (np.abs(got - wanted) <= bound)[clear].all()
        compared += int(clear.sum())
        if bilinear:
            # Smooth pictures are far nearer than the bound.
            assert np.abs(got - wanted)[draws].mean() < 0.004
    assert compared > 5000


@pytest.fixture(scope="module", params=["vga-square", "vga-hex"])
def traced(request):
    """A display, and golden's exit rays of its pixels."""
    display = load_display(DISPLAYS / f"{request.param}.toml")
    return display, list(exit_lines(display))


def kept(traced, stack, build, scene_build):
    """The share of the twin's values within 1/255 of golden's, and the PSNR, dB, of a whole frame."""
    display, lines = traced
    light = draw_golden(display, stack, "bilinear" if scene_build.bilinear else "nearest", lines=lines)
    golden = panel_bytes(display, light)
    apart = draw(display, build, stack, scene_build).astype(np.int64) - golden
    within, decibels = (abs(apart) <= 1).mean(), 20 * np.log10(255 / np.sqrt((apart**2).mean()))
    print(f"{within:.4%} within 1/255, {decibels:.1f} dB")
    return within, decibels


@pytest.mark.parametrize("bilinear", [False, True], ids=["nearest", "bilinear"])
@pytest.mark.parametrize("name", ["fish", "chart"])
def test_shipped_layers_on_a_board_as_it_starts(traced, name, bilinear):
    """With the word length of `board start --layers 4` and one sample: 99.9 % of values within 1/255, 48 dB."""
    scene_build = SceneBuild(4, bilinear=bilinear)
    stack = load_layers(repository() / "scenes" / "layers" / name)
    within, decibels = kept(traced, stack, board_build(traced[0], scene_build), scene_build)
    assert within >= 0.999
    assert decibels >= 48


@pytest.mark.full
@pytest.mark.parametrize("layers", [4, 8])
def test_noise_needs_twenty_fraction_bits(rng, traced, layers):
    """Nearest texels of noise, 256 x 192 of them over all that rays reach: the same bounds at F = 20, not at 18."""
    display, scene_build, reach = traced[0], SceneBuild(layers), reach_of(traced[0])
    textures = []
    for depth in np.linspace(15.0, -40.0, layers):
        texels, palette = rng.integers(0, 256, (192, 256), np.uint8), rng.integers(0, 256, (256, 4), np.uint8)
        textures.append(Layer(texels, palette, float(depth), reach.area(float(depth)).matrix(256, 192)))
    stack = LayerStack(tuple(textures), rng.random(3))
    within, decibels = kept(traced, stack, Build.of(display, "exact", 20, aims=False), scene_build)
    assert within >= 0.999
    assert decibels >= 48
    assert kept(traced, stack, Build.of(display, "exact", 18, aims=False), scene_build)[0] < 0.999


def test_whole_frames_are_drawn_in_raster_order():
    """A layer that covers the display's left upper quarter, seen in that quarter; the rest is the background."""
    plain = load_display(DISPLAYS / "vga-square.toml")
    display = dataclasses.replace(plain, panel=dataclasses.replace(plain.panel, width_px=120, height_px=80))
    palette = np.zeros((256, 4), np.uint8)
    palette[:, 0], palette[:, 3] = 255, 255
    pitch = display.panel.coarsest_mm
    # 64 texels over 64 + 60 columns and 64 over 64 + 40 rows, up to the panel's middle, in the array's plane.
    matrix = np.array([[64 / (124 * pitch), 0, 64.0], [0, -64 / (104 * pitch), 64.0]])
    layer = Layer(np.zeros((64, 64), np.uint8), palette, 1e-3, matrix)
    stack = LayerStack((layer,), np.array([0.0, 0.0, 1.0]))
    for samples in (1, 2, 4):
        build = SceneBuild(1, width=64, height=64, samples=samples)
        picture = draw(display, Build(16, "square"), stack, build)
        assert picture.shape == (80, 120, 3)
        # An exit lies within a lenslet's pitch of its pixel.
        edge = int(np.ceil(display.array.finest_mm / pitch))
        assert (picture[: 40 - edge, : 60 - edge] == (255, 0, 0)).all()
        assert (picture[40 + edge :] == (0, 0, 255)).all()
        assert (picture[:, 60 + edge :] == (0, 0, 255)).all()
    u, v = sample_words(120, 80, 2, range(80))
    assert (u[:2].tolist(), v[:2].tolist()) == ([-956, -948], [636, 628])


def test_a_single_texel_by_hand():
    build = SceneBuild(1, width=32, height=32)
    slot = np.zeros(build.slot_bytes, np.uint8)
    slot[33] = 7  # row 1, column 1
    slot[1024 + 28 : 1024 + 32] = 10, 20, 255, 128
    s, t = np.array([256, 511, 512]), np.array([256, 511, 300])
    colours, weights = texel_fetch(s, t, np.zeros(3, bool), slot, build)
    assert colours[:2, 0].tolist() == [[10, 20, 255, 128]] * 2
    assert weights[:, 0].tolist() == [65536] * 3
    light, opacity = texel_blend(colours, weights)
    # Opacity 129/256: of 100, 400 and 65025.
    assert opacity.tolist() == [33024, 33024, 0]
    assert light[0].tolist() == [(129 * 100 + 128) // 256, (129 * 400 + 128) // 256, (129 * 65025 + 128) // 256]
    assert texel_fetch(s, t, np.ones(3, bool), slot, build)[1].tolist() == [[0]] * 3
    assert texel_fetch(s - 512, t, np.zeros(3, bool), slot, build)[1].tolist() == [[0], [0], [65536]]


def test_bilinear_weights_by_hand():
    build = SceneBuild(1, width=32, height=32, bilinear=True)
    slot = np.arange(build.slot_bytes, dtype=np.int64).astype(np.uint8)
    # Column 3.25 and row 4.5: an odd column first, an even row first.
    colours, weights = texel_fetch(np.array([3 * 256 + 64]), np.array([4 * 256 + 128]), np.zeros(1, bool), slot, build)
    # Taps: even row even column (4, 4), even row odd column (3, 4), odd row even column (4, 5), odd row odd column.
    assert weights[0].tolist() == [64 * 128, 192 * 128, 64 * 128, 192 * 128]
    index = [4 * 32 + 4, 4 * 32 + 3, 5 * 32 + 4, 5 * 32 + 3]
    assert colours[0, :, 0].tolist() == [slot[1024 + 4 * (k % 256)] for k in index]
    # Half a texel left of the texture: what is outside weighs nothing.
    outside = texel_fetch(np.array([-128]), np.array([0]), np.zeros(1, bool), slot, build)[1]
    assert outside[0].tolist() == [128 * 256, 0, 0, 0]


def test_two_layers_by_hand():
    half = np.full((1, 3), 20000), np.array([32768])
    full = np.full((1, 3), 65025), np.array([65536])
    draws = np.ones(1, bool)
    background = np.array([65025, 0, 30000])
    both = composite([half[0], full[0]], [half[1], full[1]], draws, [256, 128], background)
    # Half of the second layer at half its brightness: 20000 + 65025 / 4.
    assert both.tolist() == [[20000 + (65025 * 16384 + 32768) // 65536] * 3]
    alone = composite([half[0]], [half[1]], draws, [256], background)
    assert alone.tolist() == [[20000 + 32513, 20000, 35000]]
    assert composite([half[0]], [half[1]], ~draws, [256], background).tolist() == [[0, 0, 0]]


def test_mean_and_curve_by_hand():
    light = np.array([[1, 2, 65025], [2, 2, 65025], [7, 0, 65025], [8, 1, 65025]])
    assert sample_mean(light, 1).tolist() == [[2, 2, 65025], [8, 1, 65025]]
    assert sample_mean(light, 2).tolist() == [[5, 1, 65025]]
    table = (np.arange(8192) % 251).astype(np.uint8)
    lights = np.array([[0, 4095, 4096], [4111, 4112, 65535]])
    index = [[0, 4095, 4096 + 256], [4096 + 256, 4096 + 257, 4096 + 4095]]
    assert curve_table(lights, table).tolist() == [[k % 251 for k in row] for row in index]


def test_curve_of_a_panel():
    """An entry's byte is that of each of its words: within half a level where it stands for one, else within one."""
    display = load_display(DISPLAYS / "vga-square.toml")
    table = build_curve_table(display).astype(int)
    assert (table[0], table[4096 + 4064]) == (0, 255)
    words = np.arange(65026)
    exact = encoded_values(words[None, :, None] / 65025, display.panel.transfer, 8)[0, :, 0].astype(int)
    got = curve_table(words, build_curve_table(display)).astype(int)
    assert (got[:4096] == exact[:4096]).all()
    assert np.abs(got - exact).max() <= 1
    assert len(entry_light()) == 8192


def layer(depth=20.0, scale=5.0, zero=(50.0, 50.0), **rest):
    matrix = np.array([[scale, 0.0, zero[0]], [0.0, -scale, zero[1]]])
    return Layer(np.zeros((192, 256), np.uint8), np.zeros((256, 4), np.uint8), depth, matrix, **rest)


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        ([layer()] * 5, "5 layers do not fit this build, which has 4; leave layers out, or build with layers = 5"),
        ([layer(), layer(9000.0)], r"1, register depth: 9000 mm is outside its range \[-3379.2, 3379.2\) mm; bring"),
        ([layer(scale=90.0)], r"layer 0, register a: 90 texels/mm is outside its range \[-77.5758, 77.5758\) tex"),
        ([layer(zero=(0.0, 4e4))], r"register t0: 40000 texels is outside its range \[-32768, 32768\) texels; the"),
        ([layer(scale=0.01)], r"layer 0, registers s0, t0 and a to d place a corner of the texture 20600 mm fr"),
        (
            [layer(math.inf, 7e4)],
            r"layer 0, register a: 70000 texels a slope of 1 is outside its range \[-65536, 65536\) texels a slope",
        ),
    ],
)
def test_layers_out_of_range_are_refused(layers, message):
    display = load_display(DISPLAYS / "vga-square.toml")
    with pytest.raises(InputError, match=message):
        scene_words(display, LayerStack(tuple(layers)), SceneBuild(4))


@pytest.mark.parametrize(("side", "other"), [("height_px", "width_px"), ("width_px", "height_px")])
def test_a_panel_is_as_large_as_places_reach(side, other):
    """Words of places hold 2048 radii, 20 of them beside the panel: half of it may have 2028, in either direction."""

    def words(pixels):
        # Radius and pixels of 1 mm.
        display = focused_display("square", focal=2.0, pixel_pitch=1.0, **{side: pixels, other: 4})
        return scene_words(display, LayerStack((layer(),)), SceneBuild(4))

    assert words(4054).layers
    with pytest.raises(InputError, match="place the panel's corner 2049 radii"):
        words(4058)


def test_names_and_slots_of_layers_that_are_refused():
    display, stack = load_display(DISPLAYS / "vga-square.toml"), LayerStack((layer(), layer(9000.0)))
    with pytest.raises(InputError, match="layer 'weed', register depth: "):
        scene_words(display, stack, SceneBuild(4), names=("fish", "weed"))
    for slots, message in (((0, 5), "layer 1, register look: slot 5 is outside its range, 0 to 4"),
                           ((2, 2), "register look: slots 2, 2 repeat; give each layer its own slot")):  # fmt: skip
        with pytest.raises(InputError, match=message):
            scene_words(display, LayerStack((layer(), layer())), SceneBuild(4), slots)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"layers": 0}, "layers: 0 is not valid; give a whole number from 1 to 8"),
        ({"layers": 9}, "layers: 9 is not valid; give a whole number from 1 to 8"),
        ({"layers": 4, "slots": 3}, "slots = 3 cannot be built; choose 4 to 15"),
        ({"slots": 16}, "slots = 16 cannot be built; choose 4 to 15"),
        ({"width": 200}, "width = 200 cannot be built; choose 32, 64, 128, 256, 512 or 1024 texels"),
        ({"width": 16}, "width = 16 cannot be built"),
        ({"width": 512, "height": 1025}, "height: 1025 is not valid; give a whole number from 2 to 1024"),
        ({"height": 1}, "height: 1 is not valid; give a whole number from 2 to 1024"),
        (
            {"height": 191},
            "slots of 256 x 191 texels cannot be built; choose a multiple of 1024 texels, at most 261120",
        ),
        ({"width": 1024, "height": 256}, "slots of 1024 x 256 texels cannot be built"),
        ({"width": 1024, "height": 3, "bilinear": True}, "height = 3 cannot be built with bilinear; choose an even"),
        ({"samples": 3}, "samples = 3 cannot be built; choose 1, 2 or 4 rays for each pixel"),
    ],
)
def test_builds_that_cannot_be_made_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        SceneBuild(**values)


def test_words_of_a_build_and_of_a_layer(rng):
    for _ in range(50):
        layers = int(rng.integers(1, 9))
        build = SceneBuild(
            layers, int(rng.integers(layers, 16)), int(rng.choice([256, 512])), 4 * int(rng.integers(1, 120)),
            bool(rng.integers(2)), int(rng.choice([1, 2, 4])),
        )  # fmt: skip
        assert SceneBuild.of_word(build.word) == build
    # layers 4, slots 5, width 2^8, height 192, bilinear, 2^1 samples: by hand from the struct's order.
    assert SceneBuild(4, bilinear=True, samples=2).word == 4 | 5 << 4 | 8 << 8 | 192 << 12 | 1 << 23 | 1 << 24
    with pytest.raises(InputError, match="unknown bits"):
        SceneBuild.of_word(1 << 26)
    made = LayerWords(-1, 2, 3, 4, 5, 6, 7, visible=True, infinite=True, slot=9, brightness=200)
    assert made.words == (0xFFFFFFFF, 2, 3, 4, 5, 6, 7, 1 | 2 | 9 << 4 | 200 << 8)


def test_a_slot_belongs_to_the_first_visible_layer():
    def shown(*looks):
        layers = tuple(LayerWords(visible=visible, slot=slot) for visible, slot in looks)
        return SceneWords(layers, 0, 0, 0, (0, 0, 0)).slots

    assert shown((True, 1), (True, 1), (False, 2), (True, 2)) == (1, None, None, 2)

"""Panels as they are: pixels that are not square, measured curves, levels of black and white, sub-pixels."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lippmann.base.images import read_picture
from lippmann.base.tones import decode, encode, encoded_values
from lippmann.board.panel_frames import Target, image_frame, load_frame
from lippmann.capturing.elemental_rotation import rotation_map
from lippmann.cli import run
from lippmann.conformance.fifty_digits import true_rays
from lippmann.conformance.ray_sets import PanelRays
from lippmann.display.description import display_text, parse_display
from lippmann.display.subpixels import COLOURS, LAYOUTS, layout_of
from lippmann.engines import trace
from lippmann.errors import InputError
from lippmann.eye.observer import Eye, observe
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.display_properties import beats_in_lenslets, display_properties
from lippmann.optics.rays import Status
from lippmann.optics.trace import trace_to_panel
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_integral
from lippmann.rendering.sampling import Window
from lippmann.scenes.scene import load_scene
from optics_cases import GRIDS, random_display
from scene_cases import focused_display, generator, rgb, write_scene

SEED = 5514
PANEL = "width_px = 2\nheight_px = 1\npixel_pitch_mm = 1.0\n"
ARRAY = '[array]\ngrid = "square"\npitch_mm = 2.0\nradius_mm = 2.0\nindex = 1.5\n'


def two_pixels(keys: str = "", panel: str = PANEL):
    return parse_display(f"gap_mm = 3.0\n[panel]\n{panel}{keys}\n{ARRAY}", "two.toml")


def refusal(keys: str, panel: str = PANEL) -> str:
    with pytest.raises(InputError) as refused:
        two_pixels(keys, panel)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def tall(display, times: int):
    """The display with rows so many times as high, so many times fewer: the same window."""
    panel = display.panel
    assert panel.height_px % times == 0
    pitches = panel.pixel_pitch_mm, times * panel.pixel_pitch_mm
    return replace(display, panel=replace(panel, height_px=panel.height_px // times, pixel_pitch_mm=pitches))


def even(rng, *key):
    """A random display with an even number of rows, whose pitch is a float that doubles exactly."""
    display = random_display(rng, *key)
    return replace(display, panel=replace(display.panel, height_px=4 * max(1, display.panel.height_px // 4)))


@pytest.mark.parametrize(
    ("grid", "side", "times"),
    [("square", "panel", 2), ("square", "viewer", 4), ("hex", "panel", 4), ("hex", "viewer", 2)],
)
def test_the_same_points_of_a_window_have_the_same_rays(grid, side, times):
    """The rows of one display are `times` those of the other: its pixel coordinates v are v / times. All is exact."""
    rng = generator(SEED, grid, side, times)
    for number in range(4):
        square = even(rng, grid, side)
        other = tall(square, times)
        size = square.panel.width_px, square.panel.height_px
        pixels = rng.uniform(0.0, 1.0, (200, 2)) * size
        pixels[:, 1] = np.round(pixels[:, 1] * 1024) / 1024
        # The fast engine compiles a program for each display: one will do.
        for engine, model in (("golden", "exact"), ("golden", "thin"), ("fast", "exact"))[: 3 if number == 0 else 2]:
            first = trace(square, pixels, model=model, engine=engine)
            second = trace(other, pixels / (1, times), model=model, engine=engine)
            for name in ("origin_mm", "direction", "status", "lenslet"):
                np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
        rays = trace(square, pixels)
        back = rays.origin_mm + 100.0 * rays.direction, -rays.direction
        hits, others = (trace_to_panel(display, *back) for display in (square, other))
        np.testing.assert_array_equal(hits.status, others.status)
        np.testing.assert_allclose(hits.pixel / (1, times), others.pixel, rtol=0, atol=0)
        assert (hits.status == Status.OK).mean() > 0.1


@pytest.mark.parametrize("grid", GRIDS)
def test_fifty_digits_agree_on_two_pitches(grid):
    rng = generator(SEED, "digits", grid)
    display = random_display(rng, grid, "panel")
    panel = replace(display.panel, pixel_pitch_mm=(display.panel.pixel_pitch_mm, 0.7 * display.panel.pixel_pitch_mm))
    display = replace(display, panel=panel)
    pixels = rng.uniform(0.0, 1.0, (40, 2)) * (panel.width_px, panel.height_px)
    rays, true = trace(display, pixels), true_rays(PanelRays("two", display, pixels, None))
    np.testing.assert_array_equal(rays.status, true.status)
    good = rays.status == Status.OK
    assert good.any()
    away = np.abs(np.asarray(true.origin_mm[good] - rays.origin_mm[good], np.float64))
    assert away.max() < 1e-11


@pytest.mark.parametrize("grid", GRIDS)
def test_registers_of_two_pitches(grid):
    """One row of the tall display is two of the other: its coefficients of v are twice theirs, to a unit."""
    square = focused_display(grid, width_px=120, height_px=80, pixel_pitch=0.05, rotation=11.0, offset=(0.1, -0.2))
    build = Build.of(square, "exact", 22, aims=False)
    first, second = (configuration(display, build, "exact") for display in (square, tall(square, 2)))
    for name in ("x_from_v", "y_from_v"):
        assert abs(getattr(second, name) - 2 * getattr(first, name)) <= 1
    for name in ("x_from_u", "y_from_u", "x_offset", "y_offset", "slope_x", "depth"):
        assert getattr(second, name) == getattr(first, name)
    pixels = generator(SEED, grid).integers(0, 40, (300, 2)).astype(float)
    one = trace(square, pixels * (1, 2), engine="twin", fraction_bits=22)
    two = trace(tall(square, 2), pixels, engine="twin", fraction_bits=22)
    np.testing.assert_array_equal(one.lenslet, two.lenslet)
    np.testing.assert_allclose(one.direction, two.direction, atol=4e-6)


def test_numbers_of_two_pitches():
    """The coarser pitch limits depth, resolution and elemental images; columns and rows beat each with its own."""
    display = focused_display("square", width_px=200, height_px=200, pixel_pitch=0.07)
    other = replace(display, panel=replace(display.panel, pixel_pitch_mm=(0.07, 0.09)))
    coarse = replace(display, panel=replace(display.panel, pixel_pitch_mm=0.09))
    found, wanted = display_properties(other), display_properties(coarse)
    for name in ("elemental_image_px", "depth_range_mm", "angular_resolution_deg", "views"):
        assert getattr(found, name) == getattr(wanted, name)
    assert beats_in_lenslets(other) == (beats_in_lenslets(display)[0], beats_in_lenslets(coarse)[1])
    assert found.lenslets[:2] == (14, 18)


@pytest.mark.parametrize("grid", GRIDS)
def test_rotation_of_elemental_images_of_tall_pixels(grid):
    """Each pixel changes places with the one opposite to its cell's centre; twice is no change."""
    display = tall(focused_display(grid, width_px=88, height_px=88, pixel_pitch=0.0625, rotation=7.0), 2)
    partner = rotation_map(display)
    np.testing.assert_array_equal(partner[partner], np.arange(len(partner)))
    moved = partner != np.arange(len(partner))
    assert moved.mean() > 0.75
    row, column = np.divmod(np.stack([np.arange(len(partner)), partner]), display.panel.width_px)
    centre = np.stack([column.sum(axis=0) + 1, row.sum(axis=0) + 1], axis=1) / 2.0
    lenslet = trace(display, np.stack([column[0], row[0]], axis=1) + 0.5, model="pinhole").lenslet
    i, j = lenslet.T[:, :] * np.ones(2)[:, None]
    p = display.array.pitch_mm
    x, y = (i * p, j * p) if grid == "square" else ((i + j / 2) * p, j * p * math.sqrt(0.75))
    turn = math.radians(7.0)
    x, y = x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn)
    u, v = x / 0.0625 + 44.0, 22.0 - y / 0.125
    assert np.abs(centre - np.stack([u, v], axis=1))[moved].max() <= 0.5 + 1e-9


def rising(steps):
    """Numbers from 0 to 1 with such steps between them."""
    total = np.concatenate([[0.0], np.cumsum(steps)])
    return total / total[-1]


@given(st.lists(st.tuples(st.floats(1e-3, 1.0), st.floats(1e-3, 1.0)), min_size=1, max_size=40), st.integers(0, 2**32))
def test_decode_is_the_inverse_of_encode_for_any_curve(steps, seed):
    values, light = (rising(column) for column in np.array(steps).T)
    curve = tuple(zip(values.tolist(), light.tolist(), strict=True))
    tried = np.random.default_rng(seed).random(100)
    there = encode(tried, curve)
    # float32 values; a piece of slope m brings a rounding of 2^-24 back as m of them, and a light is rounded once.
    steepest = (np.diff(light) / np.diff(values)).max()
    np.testing.assert_allclose(decode(there, curve), tried.astype(np.float32), atol=2.0**-23 * (1.0 + steepest))
    np.testing.assert_allclose(decode(values, curve), light, atol=2.0**-23 * (1.0 + steepest))
    np.testing.assert_array_equal(encode(np.array([-1.0, 0.0, 1.0, 7.0]), curve), [0.0, 0.0, 1.0, 1.0])


def test_a_curve_by_hand():
    """Between (0.5, 0.2) and (1, 1) light 0.6 is half-way: the value 0.75. Its level of 8 bits is 191."""
    curve = ((0.0, 0.0), (0.5, 0.2), (1.0, 1.0))
    assert float(encode(np.array(0.6), curve)) == 0.75
    assert float(decode(np.array(0.25), curve)) == pytest.approx(0.1, rel=1e-7)
    display = two_pixels(f"transfer = {json.dumps(curve)}")
    light = np.array([[[0.6, 0.1, 2.0], [0.0, 0.2, 1.0]]], np.float32)
    image = IntegralImage(light, display)
    target = Target(int(display.identity, 16), 2, 1)
    frame = image_frame(image, target)
    assert frame.tolist() == [[[191, 64, 255], [0, 128, 255]]]
    assert display.identity == two_pixels().identity


@pytest.mark.parametrize("suffix", [".png", ".tif", ".exr"])
def test_a_curve_travels_in_a_file_as_numbers(tmp_path, suffix):
    rng = generator(SEED, suffix)
    values, light = rising(rng.uniform(0.1, 1.0, 60)), rising(rng.uniform(0.1, 1.0, 60))
    curve = tuple(zip(values.tolist(), light.tolist(), strict=True))
    display = focused_display("square", width_px=40, height_px=30)
    panel = replace(display.panel, transfer=curve, bits=8)
    display = replace(display, panel=panel)
    picture = rng.random((30, 40, 3), np.float32)
    path = tmp_path / f"picture{suffix}"
    IntegralImage(picture, display).save(path)
    assert [tuple(pair) for pair in json.loads(read_picture(path).metadata["transfer"])] == list(curve)
    back = IntegralImage.load(path, display).radiance
    slope = (np.diff(light) / np.diff(values)).max()
    assert np.abs(back - picture).max() <= {".png": 0.5 / 255 * slope + 1e-6, ".tif": 0.0, ".exr": 2.0**-11}[suffix]
    target = Target(int(display.identity, 16), 40, 30)
    np.testing.assert_array_equal(load_frame(path, target, panel=panel), load_frame(path, target))
    if suffix == ".png":
        np.testing.assert_array_equal(load_frame(path, target), encoded_values(picture, curve, 8))
        # The panel's own values: any other curve would change them.
        says = r"transfer a curve of 61 points \([0-9a-f]{8}\), 'test' has transfer srgb"
        with pytest.raises(InputError, match=says):
            IntegralImage.load(path, replace(display, panel=replace(panel, transfer="srgb"), name="test"))
    for other in ("linear", (*curve[:-2], curve[-1])):
        with pytest.raises(InputError, match=r"is a curve of 61 points .* in the file, (linear|a curve of 60)"):
            load_frame(path, target, panel=replace(panel, transfer=other))


@pytest.mark.parametrize(
    "text", ["[", "[[0, 0], [1, 2]]", "[1]", '[["a", "b"], [1, 1]]', "[" * 9999, "[[0,0],[1,NaN]]"]
)
def test_a_broken_curve_in_a_file_is_refused(text):
    with pytest.raises(InputError, match="list of pairs" if text[-1] == "[" else "curve") as refused:
        decode(np.zeros(3), text)
    assert len(str(refused.value)) < 200


def under_one_lenslet(keys: str = ""):
    """Two pixels of 1 mm under a lenslet of 2 mm, the panel in its focus, 4 mm away: far eyes see one point each."""
    array = ARRAY + "thickness_mm = 0.75\n"
    return parse_display(f"gap_mm = {4.0 - 0.75 / 1.5}\n[panel]\n{PANEL}{keys}\n{array}", "two.toml")


def seen_at(mi, display, image, x, y=0.0):
    """The light of the panel's point (x, y), mm, for an eye so far away that a lenslet's rays are parallel."""
    far = 1e7
    eye = Eye((-x * far / 4.0, -y * far / 4.0, far))
    # The smallest window on the lenslet's axis: one ray, by the ideal lens.
    view = observe(np.array(image, np.float32), display, eye, Window(1e-9, 1e-9, 1, 1), samples=1, model="thin")
    return view.radiance[0, 0]


def test_a_black_pixel_shines_by_the_contrast(mi):
    """Of 400 cd/m2 white and 2 cd/m2 black: 1 / 200, and the light between is between."""
    display = under_one_lenslet("white_cd_m2 = 400\nblack_cd_m2 = 2")
    image = [[[0.0, 0.0, 0.0], [1.0, 0.5, 2.0]]]
    np.testing.assert_allclose(seen_at(mi, display, image, -0.5), [0.005] * 3, rtol=1e-6)
    np.testing.assert_allclose(seen_at(mi, display, image, 0.5), [1.0, 0.5025, 1.995], rtol=1e-6)
    # Beside the panel is nothing.
    np.testing.assert_array_equal(seen_at(mi, display, image, 0.5, 0.7), [0.0] * 3)


def test_levels_affect_no_ray_and_are_told(capsys, tmp_path):
    plain, path = under_one_lenslet(), tmp_path / "two.toml"
    assert "cd_m2" not in display_text(plain)
    for black, told in ((0.5, "black 0.5 cd/m2: contrast 800 : 1"), (0.0, "black 0 cd/m2")):
        display = under_one_lenslet(f"white_cd_m2 = 400\nblack_cd_m2 = {black}")
        assert display.identity == plain.identity
        assert parse_display(display_text(display), "two.toml") == replace(display, name="two")
        path.write_text(display_text(display))
        assert run(["inspect", str(path)]) == 0
        assert re.search(rf"^white +400 cd/m2, {told}$", capsys.readouterr().out, re.M)
    path.write_text(display_text(plain))
    assert run(["inspect", "--json", str(path)]) == 0
    assert "cd_m2" not in str(json.loads(capsys.readouterr().out)["panel"])


@pytest.mark.parametrize("keys", ["black_cd_m2 = 0", "white_cd_m2 = 400\nblack_cd_m2 = 0.0", "white_cd_m2 = 400"])
def test_black_may_be_without_light(mi, keys):
    """OLED panels: 0 is what holds without the key, too."""
    image = [[[0.0, 0.0, 0.0], [1.0, 0.5, 2.0]]]
    np.testing.assert_array_equal(seen_at(mi, under_one_lenslet(keys), image, -0.5), [0.0] * 3)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("black_cd_m2 = 0.3", "panel.black_cd_m2: needs white_cd_m2; give both"),
        ("white_cd_m2 = 100\nblack_cd_m2 = 100", "panel.black_cd_m2: 100 is not below white_cd_m2, 100; give both"),
        ("white_cd_m2 = 0", "panel.white_cd_m2: 0 is not valid; give a finite number, more than 0"),
        ("white_cd_m2 = 100\nblack_cd_m2 = -1", "panel.black_cd_m2: -1 is not valid"),
    ],
)
def test_bad_levels_are_one_line(keys, said):
    assert said in refusal(keys)


QUAD = [
    ["red", -0.25, 0.25, 0.5, 0.5], ["green", 0.25, 0.25, 0.5, 0.5],
    ["blue", -0.25, -0.25, 0.5, 0.5], ["white", 0.25, -0.25, 0.5, 0.5],
]  # fmt: skip
#: Two pixels that share blue: red above green, then blue above green, with dark borders.
SHARED = [
    ["red", 0.0, 0.25, 0.8, 0.4], ["green", 0.0, -0.25, 0.8, 0.4],
    ["blue", 1.0, 0.25, 0.8, 0.4], ["green", 1.0, -0.25, 0.8, 0.4],
]  # fmt: skip


def test_where_two_pixels_emit_by_hand(mi):
    """A quad's sub-pixels cover a quarter each: four times as bright. White takes the least of the three colours."""
    display = under_one_lenslet(f"subpixels = {json.dumps(QUAD)}")
    image = [[[0.9, 0.5, 0.3], [0.25, 0.25, 0.25]]]
    for x, y, wanted in (
        (-0.75, 0.25, [4 * 0.6, 0, 0]), (-0.25, 0.25, [0, 4 * 0.2, 0]), (-0.75, -0.25, [0, 0, 0]),
        (-0.25, -0.25, [1.2] * 3), (0.25, 0.25, [0, 0, 0]), (0.75, -0.25, [1.0] * 3),
    ):  # fmt: skip
        np.testing.assert_allclose(seen_at(mi, display, image, x, y), wanted, rtol=1e-6, atol=1e-6)
    # One red and one blue of 0.8 x 0.4 on two pixels: 2 / 0.32 as bright; two green ones: half as much.
    display = under_one_lenslet(f"subpixels = {json.dumps(SHARED)}")
    image = [[[0.9, 0.5, 0.3], [0.2, 0.4, 0.6]]]
    for x, y, wanted in (
        (-0.5, 0.25, [6.25 * 0.9, 0, 0]), (-0.5, -0.25, [0, 3.125 * 0.5, 0]),
        (0.5, 0.25, [0, 0, 6.25 * 0.6]),
        (0.5, -0.25, [0, 3.125 * 0.4, 0]), (-0.5, 0.0, [0] * 3), (0.05, 0.25, [0] * 3),
    ):  # fmt: skip
        np.testing.assert_allclose(seen_at(mi, display, image, x, y), wanted, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("layout", [*LAYOUTS, QUAD, SHARED], ids=str)
def test_a_layout_keeps_the_mean(layout):
    """Over the layout's own area, what the sub-pixels emit is the pixel's light: by a grid of points."""
    made = layout_of(layout if isinstance(layout, str) else tuple(map(tuple, layout)))
    n = 240
    u, v = np.meshgrid((np.arange(n * made.columns) + 0.5) / n, (np.arange(n * made.rows) + 0.5) / n)
    light = [np.float64(0.9), np.float64(0.5), np.float64(0.3)]
    parts, total = made.split_light(light, min(light)), np.zeros(3)
    for k, gain, inside in made.emitters(NumpyBackend(), u, v):
        total[[k] if k < 3 else [0, 1, 2]] += gain * parts[k] * inside.mean()
    np.testing.assert_allclose(total, light, rtol=1e-9)


def test_pentile_borrows_from_the_nearest():
    """Red green, blue green / blue green, red green: the left stripe to the right is 3/4 pixel away, of the pixel
    one above or below sqrt(17)/4 = 1.03, of the one to the left 5/4.
    """
    layout = layout_of("pentile")
    places = {colour: [box[:2] for box in layout.boxes(colour)] for colour in COLOURS[:3]}
    assert places["red"] == [(-0.25, 0.0), (-0.25, 1.0), (0.75, 0.0), (-0.25, 0.0)]
    assert places["blue"] == [(0.75, 0.0), (-0.25, 0.0), (-0.25, 0.0), (-0.25, -1.0)]
    assert places["green"] == [(0.25, 0.0)] * 4
    assert layout.borrows


@pytest.mark.parametrize(("samples", "axis"), [(1, 0), (1, 1), (64, 1)])
def test_each_colour_is_rendered_where_its_sub_pixel_is(mi, tmp_path, samples, axis):
    """A wall of strips across x or y behind the display; each channel against golden's ray of its sub-pixel.

    The second pixel of each pair lacks red and the first lacks blue: they take the neighbour's, a pixel away.
    """
    size = ('x="0.05" y="100"', 'x="100" y="0.05"')[axis]
    ramp = "".join(
        f'<shape type="rectangle"><transform name="to_world"><scale {size}/><translate {"xy"[axis]}="{x:.2f}" z="-5"/>'
        f'</transform><emitter type="area">{rgb("radiance", [0.05 * (k % 19)] * 3)}</emitter></shape>'
        for k, x in enumerate(np.arange(-6.0, 6.0, 0.1))
    )
    scene = load_scene(write_scene(tmp_path / "wall.xml", ramp, placement="near_mm = 10.0\nfar_mm = -10.0"))
    display = focused_display("square", width_px=40, height_px=24, pixel_pitch=0.1, subpixels="none")
    table = tuple(map(tuple, SHARED))
    display = replace(display, panel=replace(display.panel, subpixels=table))
    seen = render_integral(scene, display, "exact", Settings(samples, integrator="path", max_depth=1)).radiance
    row, column = np.mgrid[0:24, 0:40]
    places = {
        "red": (np.where(column % 2 == 0, 0.0, -1.0), -0.25), "green": (0.0, 0.25),
        "blue": (np.where(column % 2 == 0, 1.0, 0.0), -0.25),
    }  # fmt: skip
    steps = [0.0] if samples == 1 else (np.arange(8) + 0.5) / 8 - 0.5
    for k, (dx, dy) in enumerate(places.values()):
        total, sure = np.zeros((24, 40)), np.ones((24, 40), bool)
        for across in steps:
            for down in steps:
                at = np.stack([column + 0.5 + dx + 0.8 * across, row + 0.5 + dy + 0.4 * down], axis=2).reshape(-1, 2)
                rays = trace(display, at)
                x = (rays.origin_mm + (-5 - rays.origin_mm[:, 2:]) / rays.direction[:, 2:] * rays.direction)[:, axis]
                strip = (x + 6.05) / 0.1
                total += (0.05 * (np.floor(strip) % 19)).reshape(24, 40) / len(steps) ** 2
                sure &= (np.abs(strip - np.round(strip)) > 1e-3).reshape(24, 40) & (np.abs(x) < 5.9).reshape(24, 40)
        if samples == 1:
            assert sure.mean() > 0.8
            np.testing.assert_allclose(seen[sure, k], total[sure], atol=1e-6)
        else:
            assert np.abs(seen[..., k].mean() - total.mean()) < 0.01


BAD_CURVES = [
    ([[0, 0], [0.6, 0.4], [0.5, 0.5], [1, 1]], "is not monotonic: [0.5, 0.5] follows [0.6, 0.4]"),
    ([[0, 0], [0.5, 0.5], [0.6, 0.5], [1, 1]], "is not monotonic: [0.6, 0.5] follows [0.5, 0.5]"),
    ([[0, 0], [0.5, 0.5], [0.5, 0.6], [1, 1]], "is not monotonic"),
    ([[0, 0.01], [1, 1]], "starts at [0.0, 0.01], not at [0, 0]; subtract 0.01, the light of black, and give"),
    ([[0.1, 0], [1, 1]], "starts at [0.1, 0.0], not at [0, 0]; begin with the panel value 0, not 0.1, and give"),
    ([[0, 0], [255, 1]], "ends at [255.0, 1.0], not at [1, 1]; divide the panel values by 255 and the light by 1, "),
    ([[0, 0], [1, 300]], "ends at [1.0, 300.0], not at [1, 1]; divide the panel values by 1 and the light by 300"),
    ([[0, 0]], "give a list of [panel value, light]"),
    ([], 'choose from "gamma2.2", "linear", "srgb" or give a list of [panel value, light]'),
    ([[0, 0], [1]], "transfer[1]: [1] is not valid; give [panel value, light]"),
    ([0, 1], "give a list of [panel value, light]"),
    ([[0, "dark"], [1, 1]], 'transfer[0][1]: "dark" is not valid; give a finite number'),
]
BAD_LAYOUTS = [
    ([QUAD[0], QUAD[2], QUAD[3]], "the layout has no green; add a sub-pixel of that colour"),
    ([*QUAD, QUAD[1]], "the green sub-pixel at [0.25, 0.25] shares its pixel with another green sub-pixel"),
    ([*QUAD[:3], ["white", 0.25, -0.25, 0.6, 0.5]], "white sub-pixel at [0.25, -0.25], 0.6 x 0.5 pixels, is not"),
    ([*QUAD[:3], ["white", 0.25, -0.25, 0.0, 0.5]], "not inside its pixel"),
    ([*QUAD[:3], ["white", -0.75, 0.0, 0.1, 0.1]], "16 x 16 pixels right of and below the first"),
    ([*QUAD[:3], ["pink", 0.25, -0.25, 0.5, 0.5]], '[3][0]: "pink" is not valid; choose from "blue"'),
    ([*QUAD[:3], ["white", 0.25]], '[3]: ["white", 0.25] is not valid; give [colour, x, y, width, height]'),
    ([*QUAD[:3], ["white", 0.25, "up", 0.5, 0.5]], '[3][2]: "up" is not valid; give a finite number'),
    (
        [*QUAD[:3], ["white", 0.15, -0.25, 0.5, 0.5]],
        "the blue sub-pixel at [-0.25, -0.25] overlaps the white sub-pixel at [0.15, -0.25]; shrink or move one",
    ),
    ([], 'choose from "bgr", "none", "pentile", "rgb", "rgbw" or give a list of [colour, x, y, width, height]'),
]  # fmt: skip


@pytest.mark.parametrize(
    ("key", "table", "said"),
    [*(("transfer", *row) for row in BAD_CURVES), *(("subpixels", *row) for row in BAD_LAYOUTS)],
)
def test_a_bad_list_is_one_line(key, table, said):
    line = refusal(f"{key} = {json.dumps(table)}")
    assert re.match(rf"two\.toml: panel\.{key}(\[\d\])*: ", line)
    assert said in line

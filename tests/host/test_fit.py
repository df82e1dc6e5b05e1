"""`fit`: model, samples and build within a tolerance, against brute force; layers of scenes whose depths are known."""

import dataclasses
import json
import math
import re
from functools import cache

import numpy as np
import pytest
from lippmann.base.variant import mitsuba
from lippmann.cli import run
from lippmann.cli.fit import _layers
from lippmann.conformance.fit import INSIDE, TRIED_SAMPLES, away_from_borders, choose_build, choose_samples, fit, gap
from lippmann.display.description import load_display
from lippmann.engines import trace, trace_fixed
from lippmann.errors import InputError
from lippmann.layers.layer_costs import LayerChoice, choose_layers
from lippmann.optics.model_choice import choose_model
from lippmann.optics.rays import MODELS
from lippmann.optics.sample_points import points_in_pixel
from lippmann.rendering.options import Settings
from lippmann.scenes.scene import load_scene
from lippmann.simulation.toolchain import repository
from optics_cases import GRIDS, SIDES, random_display
from scene_cases import display_toml, focused_display, generator, glowing_card, write_scene
from scipy.spatial import KDTree

SEED = 6607


def lines(rays, some):
    """Where some of the rays cross the plane z = 0, panel frame, and their slopes."""
    origin, direction = rays.origin_mm[some], rays.direction[some]
    slope = direction[:, :2] / direction[:, 2:]
    return origin[:, :2] - origin[:, 2:] * slope, slope


def view_pixel(display, z):
    """A reconstructed pixel: the lenslet, or what a panel's pixel spreads to."""
    spread = abs(z) * display.panel.pixel_pitch_mm / display.aperture_distance_mm
    return max(display.array.pitch_mm, spread)


def apart(display, truth, rays, depths):
    """The largest distance of rays, in reconstructed pixels; infinite where only one has them or lenslets differ."""
    there = np.isin(truth.status, (0, 4))
    if (there != np.isin(rays.status, (0, 4))).any() or (truth.lenslet != rays.lenslet)[there].any():
        return math.inf
    place, slope = np.subtract(lines(truth, there), lines(rays, there))
    return max(np.linalg.norm(place + z * slope, axis=1).max() / view_pixel(display, z) for z in depths)


def random_case(rng):
    """A random display and a range of depths within some reach of it."""
    while True:
        display = random_display(rng, rng.choice(GRIDS), rng.choice(SIDES), steepest=1.2, widest_mm=60.0)
        if display.gap_mm == 0.0 and display.aperture_distance_mm < 0.05 * display.array.pitch_mm:
            continue
        reach = display.array.pitch_mm * display.aperture_distance_mm / display.panel.pixel_pitch_mm
        far, near = sorted(rng.uniform(-2.0, 2.0, 2) * reach)
        return display, (float(far), float(near)), float(rng.choice([0.02, 0.1, 0.25, 1.0]))


def sides_of(display):
    """Directions from a cell's centre to the middles of its sides, panel frame."""
    sides = 6 if display.array.grid == "hex" else 4
    return np.radians(display.array.rotation_deg) + 2 * np.pi / sides * np.arange(sides)


def from_centre(display, pixels):
    """How far pixels lie from their cell's centre towards its nearest side, mm: half a pitch on it."""
    panel, angles = display.panel, sides_of(display)
    x, y = (pixels - 0.5 * np.array([panel.width_px, panel.height_px])).T * panel.pixel_pitch_mm
    cx, cy = trace(display, pixels, None, "pinhole").centre_mm.T
    return (np.outer(x - cx, np.cos(angles)) + np.outer(-y - cy, np.sin(angles))).max(axis=1)


def dense(rng, display, count, inside=1.0):
    """Points all over the panel, and as many towards the corners of cells, as far from their borders as `inside`."""
    panel, array = display.panel, display.array
    size = np.array([panel.width_px, panel.height_px])
    pixels = rng.uniform(0.0, 1.0, (count, 2)) * size
    centre = trace(display, pixels, None, "pinhole").centre_mm
    angles = sides_of(display)
    sides = len(angles)
    flip = np.array([1.0, -1.0]) / panel.pixel_pitch_mm  # y is up, rows go down
    good = from_centre(display, pixels) <= inside * 0.5 * array.pitch_mm
    turn = rng.choice(angles, count) + np.pi / sides
    radius = rng.choice([0.9, 0.97, 0.9999], count) * inside * 0.5 * array.pitch_mm / np.cos(np.pi / sides)
    corners = (centre + radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)) * flip + 0.5 * size
    on_panel = ((corners > 0.0) & (corners < size)).all(axis=1)
    return np.concatenate([pixels[good], corners[on_panel]])


@pytest.mark.parametrize("number", range(200))
def test_auto_is_within_tolerance_and_no_dearer_than_brute_force(number):
    rng = generator(SEED, number)
    display, depths, tolerance = random_case(rng)
    choice = choose_model(display, depths, tolerance=tolerance)
    pixels = dense(rng, display, 4000)
    truth = trace(display, pixels)
    between = np.linspace(*depths, 9)
    true = {model: apart(display, truth, trace(display, pixels, None, model), between) for model in MODELS}
    assert true["exact"] == 0.0
    if choice.model != "exact":
        assert true[choice.model] <= tolerance
    # What brute force takes is what auto takes: 1.00 times its cost.
    assert choice.model == next(model for model in MODELS if true[model] <= tolerance or model == "exact")


@pytest.mark.parametrize("number", [*range(5), *(pytest.param(k, marks=pytest.mark.full) for k in range(5, 200))])
def test_the_build_is_within_tolerance_and_no_dearer_than_brute_force(number):
    rng = generator(SEED, "build", number)
    display, depths, tolerance = random_case(rng)
    tolerance *= 0.1
    build, _ = choose_build(display, depths, tolerance)
    chosen = None if build is None else (build.model, build.fraction_bits)
    few, many = (trace(display, as_words(display, dense(rng, display, count, 0.97))) for count in (3000, 150_000))
    # Where a pixel begins to spread beyond the lenslet the error may be larger than at the ends.
    kink = display.array.pitch_mm * display.aperture_distance_mm / display.panel.pixel_pitch_mm
    between = [*np.linspace(*depths, 9), *(z for z in (-kink, kink) if depths[0] < z < depths[1])]
    lossy = not np.isin(many.status, (0, 4)).all()
    for model in ("pinhole", "paraxial", "exact"):
        for bits in range(14, 24):
            if (model, bits) == chosen:
                assert build_error(display, many, model, bits, between) <= tolerance
                return
            error = build_error(display, few, model, bits, between)
            if error <= tolerance:
                # All these rays pass only where others would not, or the margin for rounding decides: by little then.
                # Where rays are lost, the few at the onset decide.
                error = math.inf if lossy else build_error(display, many, model, bits, between)
            assert error > 0.93 * tolerance, (model, bits)
    assert chosen is None


def as_words(display, pixels):
    """Those of the pixels that stay as far from the borders when words round them to 1/16."""
    pixels = np.floor(16.0 * pixels + 0.5) / 16.0
    pixels = pixels[(pixels <= [display.panel.width_px, display.panel.height_px]).all(axis=1)]
    return pixels[from_centre(display, pixels) <= 0.97 * 0.5 * display.array.pitch_mm]


def build_error(display, truth, model, bits, depths):
    """Of a build's rays, reconstructed pixels; infinite where its registers do not hold the display."""
    try:
        rays = trace_fixed(display, truth.pixel, None, model, bits)
    except InputError:
        return math.inf
    np.testing.assert_array_equal(rays.pixel, truth.pixel)
    return apart(display, truth, rays, depths)


NET = 120


@cache
def farthest(samples, sides):
    """The largest distance of a net of places to the renderer's nearest sample, over pixels turned in all ways."""
    mi = mitsuba()
    import drjit as dr

    index = dr.arange(mi.UInt32, 60 * samples)
    found = points_in_pixel(index // samples, index % samples, samples, SEED)
    points = np.stack([np.broadcast_to(np.array(c), 60 * samples) for c in found], axis=-1).astype(float)
    net = np.stack(np.meshgrid(*(np.linspace(0.0, side, NET) for side in sides)), axis=-1).reshape(-1, 2)
    ways = np.unique(points.reshape(60, samples, 2).round(6), axis=0)
    return max(KDTree(way * sides).query(net)[0].max() for way in ways)


@pytest.mark.parametrize("sides", [(1.0, 1.0), (0.247, 0.988), (1.0, 0.3)])
@pytest.mark.parametrize("samples", [1, 2, 3, 4, 7, 16, 49, 200])
def test_no_light_passes_farther_than_the_gap(mi, samples, sides):
    """A place beside the net's is nearer to one of them than half of its diagonal."""
    assert farthest(samples, sides) <= gap(samples, sides) + 2e-6
    assert gap(samples, sides) <= farthest(samples, sides) + 0.5 * math.hypot(*sides) / (NET - 1) + 2e-6


def test_samples_follow_from_the_spread():
    """At 80 mm a pixel of 0.05 mm behind D = 2 mm spreads to 2 lenslets, at 10 mm to a quarter of one."""
    display = focused_display("square", focal=2.0, width_px=200, height_px=160, pixel_pitch=0.05)
    assert fit(display, (-10.0, 0.0), 0.25).samples == 1  # sqrt(1/2) / 4 < 0.25
    far = fit(display, (-80.0, 0.0), 0.25)
    square = (1.0, 1.0)
    assert far.sample_error_px == gap(far.samples, square) <= 0.25
    assert all(gap(samples, square) > 0.25 for samples in range(1, far.samples))
    none = fit(display, (-80.0, 0.0), 1e-3)
    assert none.samples is None
    assert none.sample_error_px == gap(1024, square)  # a pixel spreads to one of the view's
    assert none.choice.error_px[none.choice.model] <= 1e-3


@pytest.mark.parametrize("pitch", [(0.05, 0.2), (0.2, 0.05), (0.05, 0.051)])
@pytest.mark.parametrize("depth", [4.0, 15.0, 60.0])
def test_samples_of_pixels_that_are_not_square(pitch, depth):
    """The light of a pixel is a rectangle of |z| q / D; each side is measured in pixels of the view along it."""
    display = focused_display("square", focal=3.0, width_px=200, height_px=120, pixel_pitch=0.1)
    display = dataclasses.replace(display, panel=dataclasses.replace(display.panel, pixel_pitch_mm=pitch))
    found = fit(display, (-depth, 0.5 * depth))
    light = [depth * side / 3.0 for side in pitch]
    x, y = (side / max(1.0, side) for side in light)
    if math.hypot(x, y) / 2.0 <= 0.25:
        assert (found.samples, found.sample_error_px) == (1, pytest.approx(math.hypot(x, y) / 2.0))
        return
    assert found.sample_error_px == pytest.approx(farthest(found.samples, (x, y)), abs=0.006)
    assert found.sample_error_px <= 0.25
    assert all(farthest(samples, (x, y)) > 0.244 for samples in range(2, found.samples))


@pytest.mark.parametrize("spread", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("tolerance", [0.1, 0.2, 0.25, 0.5, 1.0])
def test_no_fewer_samples_would_do(mi, spread, tolerance):
    chosen = choose_samples((spread, spread), tolerance)
    step = 0.71 * spread / (NET - 1)
    assert farthest(chosen, (spread, spread)) <= tolerance + 1e-6
    assert all(farthest(samples, (spread, spread)) > tolerance - step for samples in TRIED_SAMPLES if samples < chosen)


def test_each_of_the_three_is_said_by_itself_and_what_is_advised_suffices(capfd):
    arguments = ["fit", "scenes/displays/paper-square.toml", "--depths", "-400,30"]
    assert run([*arguments, "--tolerance", "0.01"]) == 0
    out = capfd.readouterr().out
    assert "model pinhole: the cheapest" in out
    assert "RTL " in out
    assert "samples: the maximum, 1024 per pixel, is not enough" in out
    advised = out.split("it is enough for --tolerance ")[1].split()[0]
    assert run([*arguments, "--tolerance", advised, "--json"]) == 0
    assert 1 <= json.loads(capfd.readouterr().out)["samples"] <= 1024
    assert run([*arguments, "--tolerance", "0.01", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["samples"] is None


def test_no_build_is_no_infinite_error(tmp_path, capfd):
    """Lenslets of index 2.4 are outside the registers' range."""
    text = (repository() / "scenes/displays/paper-square.toml").read_text()
    glass = re.search(r"^(glass|index) = .*$", text, re.MULTILINE).group(0)
    (tmp_path / "dense.toml").write_text(text.replace(glass, "index = 2.4"))
    assert run(["fit", str(tmp_path / "dense.toml"), "--depths", "-4,3", "--tolerance", "1e-7"]) == 0
    out = capfd.readouterr().out
    assert "RTL" in out
    assert "inf" not in out


def test_a_display_for_a_near_eye_gets_a_build_that_converges():
    """Its pixels lie up to a pitch and a half from their lenslets: those near borders alone are left out."""
    display = load_display("scenes/displays/uhd-4k.toml")
    near = dataclasses.replace(display, viewing_distance_mm=600.0)
    rng = np.random.default_rng(SEED)
    pixels = rng.uniform(0.0, (display.panel.width_px, display.panel.height_px), (20_000, 2))
    for shown in (display, near):
        kept = len(away_from_borders(shown, pixels)) / len(pixels)
        assert kept == pytest.approx(INSIDE**2, abs=4.0 * math.sqrt(0.06 / len(pixels)))
    build, error = choose_build(near, (-4.0, 3.0), 0.1)
    assert (build.converge, build.model, build.max_cell_steps) == (True, "exact", 0)
    assert 0.0 < error <= 0.1


@pytest.mark.parametrize("tolerance", ["inf", "nan", "-inf", "0"])
def test_tolerances_that_are_no_numbers_are_refused(tolerance, refusal_of):
    assert "finite" in refusal_of("fit", "scenes/displays/paper-square.toml", "--tolerance", tolerance)
    with pytest.raises(InputError, match="positive and finite"):
        fit(load_display("scenes/displays/paper-square.toml"), (-4.0, 3.0), float(tolerance))


def test_the_command_says_what_and_why(capfd, refusal_of):
    path = "scenes/displays/paper-square.toml"
    assert run(["fit", path, "--depths", "-40,30", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    chosen = fit(load_display(path), (-40.0, 30.0))
    assert (told["model"], told["samples"]) == (chosen.choice.model, chosen.samples)
    assert told["build"]["fraction_bits"] == chosen.build.fraction_bits
    # Version 0.1 named it so.
    assert told["build"]["walk"] == told["build"]["max_cell_steps"] == chosen.build.max_cell_steps
    assert run(["fit", path, "--depths", "-40,30"]) == 0
    out = capfd.readouterr().out
    assert f"samples {chosen.samples} per pixel:" in out
    assert f"F {chosen.build.fraction_bits}:" in out
    assert "nearer" in refusal_of("fit", path, "--depths", "1,-1")


PANEL = focused_display("square", focal=4.0, width_px=160, height_px=120, pixel_pitch=0.2)
SMALL = ((64, 48), (128, 96))
FAST = Settings(samples=4, integrator="direct")


WALL, FRONT = glowing_card("wall", -15.0, (0.1, 0.5, 0.2)), glowing_card("front", 10.0, (0.6, 0.1, 0.1), 5.0)


@pytest.fixture
def cards(mi, tmp_path, monkeypatch):
    """Write and load a scene of cards in front of each other, in a folder with the display."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(display_toml(PANEL))

    def load(*parts):
        path = write_scene(tmp_path / "cards.xml", *parts, placement="near_mm = 30.0\nfar_mm = -80.0")
        return load_scene(path)

    return load


def test_a_plane_is_one_layer_and_two_planes_are_two(cards):
    """One plain wall: any layer shows it, so the cheapest of all is chosen: one layer, nearest, the smallest slot.

    A card in front moves by 47 x (10 / 590 + 15 / 615) = 1.9 mm against the wall for the outermost eye. One layer
    leaves a part of it: half a millimetre along two edges of 10 mm, of 768 mm2, is about 28 dB for these colours. Two
    layers leave the edges' texels alone.
    """
    one = choose_layers(cards(WALL), PANEL, 25.0, SMALL, settings=FAST)
    assert (one.cheapest["layers"], one.cheapest["filter"], one.cheapest["slot"]) == (1, "nearest", [64, 48])
    # Two slots of 3072 texels, in block RAMs of 2048 bytes, and their palettes; three curves of four.
    assert (one.cheapest["block_rams"], one.cheapest["load_bytes"]) == (2 * (2 + 1) + 12, 3072 + 1024)
    assert one.candidates == [one.cheapest]
    two = choose_layers(cards(FRONT, WALL), PANEL, 40.0, SMALL, settings=FAST)
    assert two.cheapest["layers"] == 2
    assert two.cheapest["worst_db"] >= 40.0
    # All that are cheaper were tried, and none is good enough.
    costs = [(row["block_rams"], row["load_bytes"], row["multipliers"]) for row in two.candidates]
    assert costs == sorted(costs)
    assert all(row["worst_db"] < 40.0 for row in two.candidates[:-1])
    assert two.candidates[-1] == two.cheapest


def test_what_no_layers_reach_has_its_reason(cards):
    scene, fine = cards(FRONT, WALL), dataclasses.replace(FAST, samples=16)
    beyond = choose_layers(scene, PANEL, 90.0, SMALL[:1], settings=fine)
    assert beyond.cheapest is None
    assert beyond.limit == "render"
    # There are two depths, so that three and more layers are not drawn.
    assert sorted({(row["layers"], row["filter"]) for row in beyond.candidates}) == [
        (1, "bilinear"), (1, "nearest"), (2, "bilinear"), (2, "nearest"),
    ]  # fmt: skip
    assert beyond.best["layers"] == 2
    tolerance = 0.5 * (beyond.best["worst_db"] + beyond.render_db)
    assert choose_layers(scene, PANEL, tolerance, SMALL[:1], settings=fine).limit == "depths"
    # One layer of 64 x 48 takes 18 block RAMs and 22 multipliers, two take 21 and 35.
    for most in ((20, 200), (200, 34)):
        few = choose_layers(scene, PANEL, tolerance, SMALL[:1], *most, fine)
        assert few.limit == "hardware"
        assert {row["layers"] for row in few.candidates} == {1}


def test_decibels_that_miss_a_tolerance_show_less_than_it():
    row = {"filter": "nearest", "slot": [64, 48], "layers": 1, "load_bytes": 1, "block_rams": 1, "multipliers": 1}
    tried = [{**row, "worst_db": 22.9999, "view_db": 24.006}]
    lines = list(_layers(LayerChoice(None, tried, "render", 22.998), 23.0))
    assert "differ as much (22.99 dB)" in lines[0]
    assert ": 22.99 dB (mean 24.00) best" in lines[1]


@pytest.mark.parametrize(
    ("tolerance", "slots", "block_rams", "message"),
    [
        (0.0, SMALL, 161, "not positive and finite"),
        (math.inf, SMALL, 161, "not positive and finite"),
        (25.0, ((60, 48),), 161, "choose 32, 64, 128"),
        (25.0, SMALL, 17, "no layer fits 17 block RAMs and 99 multipliers; give 18 block RAMs and 22 multipliers"),
    ],
)
def test_what_no_layers_can_meet_is_refused(cards, tolerance, slots, block_rams, message):
    with pytest.raises(InputError, match=message):
        choose_layers(cards(WALL), PANEL, tolerance, slots, block_rams, settings=FAST)


def test_the_command_chooses_layers_and_says_what_was_tried(cards, capfd, refusal_of):
    cards(FRONT, WALL)
    words = ["fit", "tiny.toml", "--scene", "cards.xml", "--slot", "64x48", "--tolerance", "1"]
    assert run([*words, "--tolerance-db", "40", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["layers"] == told["tried"][-1]
    assert told["layers"]["layers"] == 2
    assert told["limit"] is None
    assert run([*words, "--tolerance-db", "40"]) == 0
    out = capfd.readouterr().out
    assert "layers 2: the cheapest within 40 dB" in out
    assert out.splitlines()[-1].endswith("chosen")
    assert run([*words, "--tolerance-db", "40", "--block-rams", "20"]) == 0  # as when no other build suffices
    out = capfd.readouterr().out
    assert "none of those tried is within 40 dB; limit: larger builds, not tried, need more than --block-rams" in out
    assert sum(line.endswith("best") for line in out.splitlines()) == 1
    assert "finite" in refusal_of(*words, "--tolerance-db", "-1")
    assert "--scale places a scene; give --scene too" in refusal_of("fit", "tiny.toml", "--scale", "2")

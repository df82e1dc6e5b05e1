"""Scenes cut into layers: depths, colours and slabs, what they hide, no hole for a moving eye, and `bench layers`."""

import csv
import dataclasses
import itertools
import json
import math
import re
import zlib

import lippmann as lp
import numpy as np
import pytest
from cobs import cobs
from lippmann import load_layers
from lippmann.base.images import read_picture
from lippmann.base.tones import encoded_values
from lippmann.cli import run
from lippmann.conformance.figures import read_csv
from lippmann.errors import InputError
from lippmann.eye.observer import observe, whole_window
from lippmann.fixed.scene_build import SceneBuild
from lippmann.layers.layer_costs import cost_of, eyes_of
from lippmann.layers.layer_drawing import exit_lines, texel_coordinates
from lippmann.layers.layers_and_pictures import load_named_layers, save_layers
from lippmann.layers.scene_cutting import SLOT as BUILD_SLOT
from lippmann.layers.scene_cutting import (
    Area,
    check_slot,
    cut_scene,
    depth_of,
    disparity,
    partition,
    reach_of,
    seen_depths,
    slabs_of,
    texels_for,
)
from lippmann.layers.stack import Layer, LayerStack, light_of
from lippmann.rendering.options import Settings
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Part, load_scene
from lippmann.simulation.toolchain import repository
from PIL import Image
from scene_cases import display_toml, focused_display, generator, on_screen, rgb, write_scene
from scene_cases import glowing_card as card
from scipy import ndimage
from tools import layers_likeness

SEED = 1616
#: 32 x 24 mm; p D / pixel = 20 mm of depth.
DISPLAY = focused_display("square", focal=4.0, width_px=160, height_px=120, pixel_pitch=0.2)
SLOT = (64, 64)
FAST = Settings(samples=4, integrator="direct")
RED, GREEN, BLUE = (0.64, 0.09, 0.04), (0.09, 0.64, 0.04), (0.04, 0.09, 0.64)


def sky(colour):
    return f'<emitter type="constant">{rgb("radiance", colour)}</emitter>'


@pytest.fixture
def scene(mi, tmp_path):

    def load(*parts, part=None):
        path = write_scene(tmp_path / "cards.xml", *parts)
        return load_scene(path, Placement(near_mm=30.0, far_mm=-80.0), part=part)

    return load


def test_cards_become_layers_of_their_depths_and_colours(scene):
    cut = cut_scene(scene(card("front", 12.0, RED, 5.0, x=-2.0), card("back", -40.0, GREEN)), DISPLAY, 2, SLOT, FAST)
    front, back = cut.stack.layers
    assert (front.depth_mm, back.depth_mm) == (pytest.approx(12.0, abs=0.01), pytest.approx(-40.0, abs=0.01))
    # The front card covers x = -7 to 3, y = -5 to 5, seen from the eye as in its own plane.
    for x, y, inside in ((-6.3, 4.3, True), (2.3, -4.3, True), (3.7, 0.0, False), (0.0, 5.7, False), (-7.7, 0, False)):
        column, row = np.floor(front.matrix @ [x, y, 1.0]).astype(int)
        there = 0 <= column < front.width and 0 <= row < front.height
        colour = front.palette[front.texels[row, column]] if there else np.zeros(4)
        if inside:
            assert colour[3] == 255
            assert light_of(colour[:3]) == pytest.approx(RED, abs=0.004)
        else:
            assert colour[3] == 0
    # The back card is whole, behind the front one as well.
    assert (back.palette[back.texels][..., 3] == 255).all()
    assert np.ptp(back.palette[back.texels][..., :3], axis=(0, 1)).max() <= 1
    # It reaches as far as the display's rays.
    lines = next(exit_lines(DISPLAY))
    s, t = texel_coordinates(back, lines)
    assert 0.5 < s.min() < s.max() < back.width - 0.5
    assert 0.5 < t.min() < t.max() < back.height - 0.5
    assert cut.stack.background == pytest.approx(GREEN, abs=0.004)


def test_surroundings_become_a_sky(scene):
    cut = cut_scene(scene(card("front", 5.0, RED, 6.0), sky(BLUE)), DISPLAY, 4, SLOT, FAST)
    assert [layer.depth_mm for layer in cut.stack.layers] == [pytest.approx(5.0, abs=0.01), math.inf]
    last = cut.stack.layers[1]
    assert light_of(last.palette[last.texels][..., :3]).reshape(-1, 3) == pytest.approx(
        np.tile(BLUE, (last.texels.size, 1)), abs=0.004
    )
    slopes = np.array([[-0.099, 0.099], [0.099, -0.099]])  # pixels up to 0.4 mm from a lenslet 4 mm away
    for x, y in slopes:
        column, row = last.matrix @ [x, y, 1.0]
        assert 0 <= column < last.width
        assert 0 <= row < last.height


@pytest.mark.parametrize(("axis", "steep"), [("x", 40.0), ("y", 60.0)])
def test_a_slanted_card_has_no_hole_for_a_moving_eye(scene, axis, steep):
    """A card through four slabs: from every eye it covers the panel, though its layers move apart."""
    slant = card("slant", -20.0, (0.5, 0.5, 0.5), 200.0, turn=f'<rotate {axis}="1" angle="{steep}"/>')
    stack = cut_scene(scene(slant), DISPLAY, 4, (128, 96), FAST).stack
    assert len(stack.layers) == 4
    stack = dataclasses.replace(stack, background=np.zeros(3))
    drawn = lp.draw(stack, DISPLAY, filter="bilinear").radiance
    reach = reach_of(DISPLAY)
    upright = [dataclasses.replace(e, position_mm=(0.0, e.position_mm[0], 600.0)) for e in eyes_of(reach)]
    for eye in (*eyes_of(reach), *upright):
        seen = observe(drawn, DISPLAY, eye, whole_window(DISPLAY, 96), 16).radiance[4:-4, 4:-4]
        # Between slabs nothing of the black background shows.
        assert seen.min() > 0.49, eye.position_mm


def test_what_moves_becomes_a_layer_of_its_own(scene):
    parts = (card("fish-body", 8.0, RED, 4.0), card("fish-tail", 6.0, BLUE, 2.0, x=5.0), card("back", -30.0, GREEN))
    rest, own = (scene(*parts, part=Part("fish-*", kept)) for kept in (False, True))
    cut = cut_scene(rest, DISPLAY, 3, SLOT, FAST, own)
    assert cut.apart == 0
    assert len(cut.stack.layers) == 2  # the rest has one depth
    fish, back = cut.stack.layers
    assert 6.0 < fish.depth_mm < 8.0
    seen = {tuple(c) for c in fish.palette[np.unique(fish.texels)][:, :3].tolist() if any(c)}
    assert len(seen) > 1
    # Where the fish was, the back goes on.
    assert (back.palette[back.texels][..., 1] > back.palette[back.texels][..., 0]).all()
    for pattern, message in (("bird-*", "no shape's id matches 'bird-.'.*fish-body, fish-tail"), ("*", "every shape")):
        with pytest.raises(InputError, match=message):
            scene(*parts, part=Part(pattern))


def test_detail_at_an_edge_is_that_of_the_nearer_surface(scene):
    """Both cards are plain, so that only the front card's edge shows anything."""
    placed = scene(card("front", 12.0, RED, 5.0), card("back", -40.0, GREEN))
    area = Area(0.0, -16.0, -12.0, 16.0, 12.0)
    depths, detail = seen_depths(placed, area, (0.0, 0.0, 600.0), (64, 48), FAST)
    front = abs(depths - 12.0) < 0.01
    assert (front | (abs(depths + 40.0) < 0.01)).all()
    # Colours are square roots: where a texel's samples all fall on one side, the step is this much.
    step = ((np.sqrt(RED) - np.sqrt(GREEN)) ** 2).sum()
    assert detail[front].max() > 0.9 * step
    # Texels around the front that it covers in part show its edge too. Of such a texel and one farther out, both the
    # back's, the nearer by a rounding error has the detail: so their number is any, but they are in these two rings.
    rings = ndimage.binary_dilation(front.reshape(48, 64), np.ones((3, 3)), iterations=2).ravel()
    assert not detail[~rings].any()
    assert detail[front].sum() > 3.0 * detail[~front].sum()


def test_wrong_counts_slots_and_scenes_are_refused(scene):
    placed = scene(card("front", 12.0, RED, 5.0))
    for count in (0, 9, 1.5):
        with pytest.raises(InputError, match="count"):
            cut_scene(placed, DISPLAY, count, SLOT, FAST)
    # Its refusals are those of a build, in test_scene_twin.
    with pytest.raises(InputError, match="slot 2048x2: width = 2048 cannot be built"):
        check_slot((2048, 2))
    for slot in ((256, 192), (64, 64), (1024, 255), (32, 32)):
        check_slot(slot)
    with pytest.raises(InputError, match=r"no eye sees any surface of the scene; place the scene with --fit"):
        cut_scene(scene(card("aside", 12.0, RED, 5.0, x=500.0)), DISPLAY, 2, SLOT, FAST)


def test_texels_are_no_finer_than_what_a_pixel_sees():
    """At 20 mm rays of neighbouring pixels, 0.2 mm apart, are 20 x 0.2 / 4 = 1 mm apart."""
    area = Area(20.0, -10.0, -10.0, 10.0, 14.0)
    assert texels_for(area, DISPLAY, (256, 192)) == (20, 24)
    assert texels_for(dataclasses.replace(area, depth_mm=0.0), DISPLAY, (256, 192)) == (100, 120)
    assert texels_for(area, DISPLAY, (16, 16)) == (16, 16)
    assert texels_for(Area(math.inf, -0.1, -0.1, 0.1, 0.1), DISPLAY, (256, 192)) == (4, 4)


def test_costs_by_hand():
    """256 x 192 bytes in block RAMs of 2048 bytes are 24; three curves of 8192 bytes 12; a slot more than layers."""
    nearest, bilinear = (cost_of(4, (256, 192), filter) for filter in ("nearest", "bilinear"))
    assert nearest.load_bytes == bilinear.load_bytes == 4 * (256 * 192 + 1024)
    assert nearest.block_rams == 5 * (24 + 1) + 12
    assert bilinear.block_rams == 5 * (24 + 4) + 12
    assert (nearest.multipliers, bilinear.multipliers) == (13 + 4 * 9 + 3 * 4, 13 + 4 * 18 + 3 * 4)
    page = " ".join((repository() / "docs/reference/rtl.md").read_text().split())
    words = "9 multipliers and 13 more for each layer (22 with `bilinear`): 61 for four layers (97 with `bilinear`)."
    assert words in page
    assert cost_of(1, (256, 192), "nearest").multipliers == 9 + 13
    assert cost_of(8, (256, 192), "bilinear").multipliers == 9 + 8 * 22


CUT_BOOK = ["layers", "book", "--display", "tiny.toml", "-o", "out", "--slot", "64x64"]
DRAW = ["render", "out", "--display", "tiny.toml", "-o", "a.png"]


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(display_toml(DISPLAY))
    write_scene(tmp_path / "cards.xml", card("fish", 10.0, RED, 5.0), card("back", -40.0, GREEN),
                placement="near_mm = 30.0\nfar_mm = -80.0")  # fmt: skip
    (tmp_path / "book").mkdir()
    random = generator(SEED, "pictures")
    front = np.zeros((16, 20, 4), np.uint8)
    front[4:12, 5:15] = (200, 100, 50, 255)
    Image.fromarray(front, "RGBA").save("book/front.png")
    Image.fromarray(random.integers(0, 256, (30, 40, 3), np.uint8), "RGB").save("book/hill.png")
    (tmp_path / "book/pictures.toml").write_text(
        'background = [0, 0, 1]\n[[picture]]\nfile = "hill.png"\ndepth_mm = -20\n'
        '[[picture]]\nfile = "front.png"\ndepth_mm = 5\ncentre_mm = [1, 2]\nwidth_mm = 10\n'
    )
    return tmp_path


def test_the_command_cuts_and_the_next_one_draws(place, capfd):
    words = ["layers", "cards.xml", "--display", "tiny.toml", "-o", "out", "--count", "2", "--slot", "64x64"]
    assert run([*words, "--integrator", "direct", "--costs", "costs.csv", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert [layer["depth_mm"] for layer in told["layers"]] == pytest.approx([10.0, -40.0], abs=0.01)
    with open("costs.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["layers"] for row in rows] == ["1", "2"]
    assert float(rows[1]["view_db"]) > float(rows[0]["view_db"]) + 3.0
    assert float(rows[1]["worst_db"]) <= float(rows[1]["view_db"])
    assert rows[1]["load_bytes"] == str(2 * (64 * 64 + 1024))
    stack = load_layers("out")
    assert run([*DRAW, "--samples", "2", "--filter", "bilinear"]) == 0
    wanted = lp.draw(stack, DISPLAY, samples=2, filter="bilinear")
    with Image.open("a.png") as picture:
        assert (np.asarray(picture) == encoded_values(wanted.radiance, "srgb", 8)).all()
    assert read_picture("a.png").metadata["identity"] == DISPLAY.identity
    moved = ["render", "out/layers.toml", "--display", "tiny.toml", "--scale", "0.5", "--offset", "1,2,3"]
    assert run([*moved, "--samples", "1", "--engine", "golden", "-o", "b.exr"]) == 0
    image = lp.IntegralImage.load("b.exr", DISPLAY)
    wanted = lp.draw(stack.moved(0.5, (1.0, 2.0, 3.0)), DISPLAY)
    assert image.radiance == pytest.approx(wanted.radiance, abs=2e-3)  # half floats
    assert image.metadata["engine"] == "golden"


def test_the_command_names_what_is_apart(place, capfd):
    words = ["layers", "cards.xml", "--display", "tiny.toml", "-o", "out", "--apart", "fish", "--slot", "64x64"]
    assert run(words) == 0
    out, err = capfd.readouterr()
    assert load_named_layers("out")[1] == ("apart", "layer_1")
    assert out.splitlines()[0] == "out/layers.toml: 2 layers, front to back"
    beyond = "note: fine detail is lost in 'layer_1' (-40 mm): the display's depth range is z = -20 to 20 mm"
    assert beyond in err
    # The command that draws them says so, too; a move may mend it.
    drawn = [*DRAW, "--samples", "1"]
    assert run(drawn) == 0
    assert beyond in capfd.readouterr().err
    assert run([*drawn, "--scale", "0.4"]) == 0
    assert "note" not in capfd.readouterr().err


def test_layers_that_no_board_can_draw_are_told(place, capfd):
    """Depths of a board end at 2048 times the lenslets' radius; golden draws farther ones."""
    pictures = (place / "book/pictures.toml").read_text()
    (place / "book/pictures.toml").write_text(pictures.replace("depth_mm = -20", "depth_mm = -900000"))
    assert run(CUT_BOOK) == 0
    err = capfd.readouterr().err
    assert "note: no board can draw these layers: layer 'hill', register depth: -900000" in err.replace(
        "-9e+05", "-900000"
    )
    assert run([*DRAW, "--samples", "1", "--engine", "twin"]) == 2
    assert "lippmann: out: layer 1, register depth" in capfd.readouterr().err


def test_a_picture_that_shows_nothing_is_told_and_one_without_loss_is_exact(place, capfd):
    Image.new("RGBA", (20, 16)).save("book/front.png")
    assert run(CUT_BOOK) == 0
    out, err = capfd.readouterr()
    assert "note: layer 'front' is completely transparent: it shows nothing" in err
    assert re.search(r"^front .* palette exact$", out, re.M)
    assert "hill' is transparent" not in err


def test_a_folder_of_pictures_becomes_layers(place, capfd):
    assert run(CUT_BOOK) == 0
    stack, names = load_named_layers("out")
    assert names == ("front", "hill")
    front, hill = stack.layers
    assert (front.depth_mm, hill.depth_mm) == (5.0, -20.0)
    # 10 mm wide about (1, 2): its left edge is at x = -4, its top edge, 8 mm high, at y = 6.
    assert front.matrix @ [-4.0, 6.0, 1.0] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert front.matrix @ [6.0, -2.0, 1.0] == pytest.approx([20.0, 16.0], abs=1e-9)
    colours = front.palette[front.texels]
    assert (colours[..., 3] == np.pad(np.full((8, 10), 255), ((4, 4), (5, 5)))).all()
    # sRGB 200, 100, 50 as light, by the standard, and its square root.
    light = [((v / 255 + 0.055) / 1.055) ** 2.4 for v in (200, 100, 50)]
    assert colours[8, 10, :3].tolist() == [round(255 * math.sqrt(x)) for x in light]
    # The hill covers all that rays reach.
    s, t = texel_coordinates(hill, next(exit_lines(DISPLAY)))
    assert min(s.min(), t.min()) > -1e-6
    assert s.max() < hill.width + 1e-6
    assert t.max() < hill.height + 1e-6
    assert stack.background.tolist() == [0.0, 0.0, 1.0]


def test_names_are_made_different(place):
    """Of pictures in several folders, one of which has the name that another would get."""
    keys = ""
    for name in ("a.png", "x/a.png", "a_1.png", "A_0.png"):
        (place / "book" / name).parent.mkdir(exist_ok=True)
        Image.new("RGB", (8, 8), (200, 9, 9)).save(place / "book" / name)
        keys += f'[[picture]]\nfile = "{name}"\ndepth_mm = 0\n'
    (place / "book/pictures.toml").write_text(keys)
    assert run(CUT_BOOK) == 0
    names = load_named_layers("out")[1]
    assert names[2:] == ("a_1", "A_0")
    assert len({name.casefold() for name in names}) == 4


def test_grey_of_16_bits_keeps_its_levels(place):
    ramp = np.repeat(np.linspace(0, 65535, 16).astype(np.uint16)[None], 16, axis=0)
    Image.fromarray(ramp).save(place / "book/ramp.png")
    (place / "book/pictures.toml").write_text('[[picture]]\nfile = "ramp.png"\ndepth_mm = 0\nwidth_mm = 4\n')
    assert run(CUT_BOOK) == 0
    (layer,) = load_layers("out").layers
    row = layer.palette[layer.texels[layer.height // 2], 0].astype(int)
    # The palette's bytes follow the square root of light.
    light = (ramp[0] / 65535.0 + 0.055) / 1.055
    wanted = np.where(ramp[0] / 65535.0 <= 0.04045, ramp[0] / 65535.0 / 12.92, light**2.4) ** 0.5 * 255
    assert abs(row - wanted).max() <= 1.0


def test_a_picture_of_which_little_is_reached_is_remarked_upon(place, capfd):
    file = place / "book/pictures.toml"
    file.write_text(file.read_text().replace("depth_mm = -20\n", "depth_mm = -20\nwidth_mm = 1e5\n"))
    assert run(CUT_BOOK) == 0
    hill = load_layers("out").layers[1]
    wanted = f"note: layer 'hill' has only {hill.width} x {hill.height} texels: check the size and position"
    notes = [line for line in capfd.readouterr().err.splitlines() if "has only" in line]
    assert len(notes) == 1
    assert notes[0].startswith(wanted)


@pytest.mark.parametrize(
    ("find", "put", "message"),
    [
        ("-20", "700", "picture[0].depth_mm"),
        ("-20", '"sky"\nwidth_mm = 3', "a sky has neither a width nor a place"),
        ("[1, 2]", "[100, 2]", "no ray reaches the picture"),
        ("hill.png", "hills.png", "did you mean book/hill.png?"),
        ("depth_mm = 5", "depth = 5", "did you mean depth_mm?"),
        ("width_mm = 10", "width_mm = 0", "picture[1].width_mm"),
    ],
)
def test_bad_pictures_are_one_line(place, refusal_of, find, put, message):
    file = place / "book/pictures.toml"
    file.write_text(file.read_text().replace(find, put))
    assert message in refusal_of("layers", "book", "--display", "tiny.toml", "-o", "out")
    assert not (place / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("layers book --scale 2", "has fixed layers"),
        ("layers cards.xml --slot 64", "'64' is not WIDTHxHEIGHT"),
        ("layers cards.xml --slot 60x64", "choose 32, 64, 128"),
        ("layers book --count 3", "its 2 pictures make 2 layers, not 3; "),
        ("layers cards.xml --count 9", "--count"),
        ("layers cards.xml --apart bird", "there are fish, back"),
        ("layers cards.xml --apart fish --count 1", "count"),
        ("render out --samples 3", "1, 2, 4 samples a pixel, not 3"),
        ("render out --fit", "--fit is for scenes"),
        ("render out --aperture full", "--aperture is for scenes"),
        ("render out --offset 0,0,900", "900 mm is not in front"),
        ("render out --scale 0", "scale 0.0 is out"),
        ("render out --engine fast", "engine 'fast'; choose from golden, twin, rtl"),
        *(
            (f"render out {option}", f"{option.partition('=')[0]} is for scenes; leave it out with layers")
            for option in ("--memory-mb=9", "--device=llvm", "--tolerance=1", "--max-depth=3", "--depth=2")
        ),
        ("render out --shading=each", "--shading is for scenes; leave it out with layers"),
        ("render cards.xml --filter bilinear", "--filter is for layers; leave it out with a scene"),
    ],
)
def test_bad_commands_are_one_line(place, refusal_of, words, message):
    plain = Layer(np.zeros((2, 2), np.uint8), np.zeros((256, 4), np.uint8), 0.0, np.eye(3)[:2])
    save_layers("out", LayerStack((plain,)))
    output = "o.png" if words.startswith("render") else "o"
    assert message in refusal_of(*words.split(), "--display", "tiny.toml", "-o", output)
    assert not (place / output).exists()


def test_the_disparity_is_how_far_a_point_moves_across_the_display():
    """Where the line from an eye to the point crosses z = 0, for two eyes 1 mm apart."""
    for z in (-300.0, -5.0, 0.0, 40.0, 250.0):
        before, after = (on_screen((3.0, 2.0, z), (x, 0.0, 600.0))[0] for x in (7.0, 8.0))
        assert -(after - before) == pytest.approx(float(disparity(z, 600.0)), abs=1e-12)
        assert depth_of(float(disparity(z, 600.0)), 600.0) == pytest.approx(z)
    assert float(disparity(-math.inf, 600.0)) == -1.0
    assert depth_of(-1.0, 600.0) == -math.inf


def spread(values, weights, ends):
    """Weighted squares about the means of the runs that end there."""
    total = 0.0
    for first, end in zip([0, *ends[:-1]], ends, strict=True):
        mean = np.average(values[first:end], weights=weights[first:end])
        total += float(weights[first:end] @ (values[first:end] - mean) ** 2)
    return total


@pytest.mark.parametrize("case", range(8))
def test_a_partition_is_the_best_of_all(case):
    random = generator(SEED, "partition", case)
    n = int(random.integers(3, 11))
    values, weights = np.sort(random.normal(size=n))[::-1], random.uniform(0.1, 5.0, n)
    for count in range(1, n + 1):
        found = partition(values, weights, count)
        assert len(found) == count
        assert found[-1] == n
        assert sorted(set(found)) == found
        best = min(spread(values, weights, [*cut, n]) for cut in itertools.combinations(range(1, n), count - 1))
        assert spread(values, weights, found) == pytest.approx(best, abs=1e-9)


def test_planes_at_three_depths_and_the_sky_are_found():
    random = generator(SEED, "planes")
    z = random.permutation(np.repeat([30.0, -10.0, -80.0, -np.inf], [50, 400, 200, 100]))
    slabs = slabs_of(z, np.ones(len(z)), 4, 600.0, 90.0)
    assert [slab.depth_mm for slab in slabs] == pytest.approx([30.0, -10.0, -80.0, -math.inf], abs=1e-9)
    assert [slab.front_mm for slab in slabs[1:]] == [slab.back_mm for slab in slabs[:-1]]
    assert (slabs[0].front_mm, slabs[-1].back_mm) == (90.0, -math.inf)
    # Halfway in disparity: the plane there is as far off from both depths.
    assert disparity(slabs[0].back_mm, 600.0) == pytest.approx((30 / 570 - 10 / 610) / 2)
    # More layers than depths give no more.
    assert len(slabs_of(z, np.ones(len(z)), 8, 600.0, 90.0)) == 4
    # With three layers, the nearest depths in disparity share one: 30 and -10 differ by 0.069, -10 and -80 by 0.101,
    # the sky by 0.88 from -80. By weight 50 x 400 / 450 against 400 x 200 / 600 they are nearer still.
    assert [round(slab.depth_mm, 1) for slab in slabs_of(z, np.ones(len(z)), 3, 600.0, 90.0)][1:] == [-80.0, -math.inf]


def test_detail_decides_where_layers_go():
    """Two planes nearby with detail, and two far apart with little of it."""
    z = np.repeat([20.0, 0.0, -60.0, -120.0], 100)
    slabs = slabs_of(z, np.repeat([0.0, 0.0, 1.0, 1.0], 100), 3, 600.0, 90.0)
    assert [round(s.depth_mm, 6) for s in slabs[1:]] == [-60.0, -120.0]
    slabs = slabs_of(z, np.repeat([1.0, 1.0, 0.0, 0.0], 100), 3, 600.0, 90.0)
    assert [round(s.depth_mm, 6) for s in slabs[:2]] == [20.0, 0.0]


REPORTS = repository() / "docs/generated/reports"


def test_two_plain_cards_are_two_layers_without_a_hole(scene):
    cards = scene(card("front", 10.0, (0.6, 0.1, 0.1), 5.0), card("wall", -15.0, (0.1, 0.5, 0.2)))
    streamed, *rows = layers_likeness.measure_scene(cards, DISPLAY, 0, slot=SLOT, settings=FAST)
    # There are two depths, and no third layer.
    assert [(row["layers"], row["drawn"]) for row in rows] == [
        (1, "nearest"), (1, "bilinear"), (2, "nearest"), (2, "bilinear"),
    ]  # fmt: skip
    assert all(row["worst_db"] <= row["view_db"] for row in (streamed, *rows))
    assert rows[2]["view_db"] > rows[0]["view_db"] + 3.0
    # Its 8 bits are all that it loses: half a level of 255, uniform, 20 log10(255 sqrt(12)) = 59 dB.
    assert streamed["view_db"] == pytest.approx(59.0, abs=3.0)
    assert {row["holes_percent"] for row in rows} == {0.0}
    # A packet of 1024 bytes: 9 around them, before the stuffing of 1 byte in 254 at most, and its end.
    assert rows[2]["load_bytes"] == 2 * 5 * 1024
    assert 10 * (1024 + 9 + 2) <= rows[2]["line_bytes"] <= 10 * (1024 + 9 + 6)
    assert {row["frame_bytes"] for row in rows} == {39}  # docs/reference/protocol.md
    assert streamed["frame_bytes"] == streamed["line_bytes"] < 160 * 120 * 3
    assert list(streamed) == list(rows[0])


def test_a_hole_is_found_where_a_layer_was_pierced(scene):
    """A slanted card in three layers; then the one in the middle gets a square hole of an eighth of its sides."""
    slant = scene(card("slant", -10.0, (0.5, 0.5, 0.5), 200.0, turn='<rotate y="1" angle="40"/>'))
    cut = cut_scene(slant, DISPLAY, 3, (128, 96), FAST)
    lines = list(exit_lines(DISPLAY))
    pierced = list(cut.stack.layers)
    layer, (rows, columns) = pierced[1], pierced[1].texels.shape
    assert light_of(layer.palette[:, :3]).max() == pytest.approx(0.5, abs=0.01)
    texels = layer.texels.copy()
    texels[rows * 7 // 16 : rows * 9 // 16, columns * 7 // 16 : columns * 9 // 16] = 0  # the transparent colour
    pierced[1] = dataclasses.replace(layer, texels=texels)
    broken = dataclasses.replace(cut, stack=dataclasses.replace(cut.stack, layers=tuple(pierced)))
    for drawn in ("nearest", "bilinear"):
        assert layers_likeness.hole_percent(slant, cut, DISPLAY, lines, drawn, FAST) == 0.0
        assert layers_likeness.hole_percent(slant, broken, DISPLAY, lines, drawn, FAST) > 0.2
    # Seen against nothing at all: the last layer away.
    last = dataclasses.replace(pierced[2], palette=np.zeros((256, 4), np.uint8))
    gone = dataclasses.replace(cut, stack=dataclasses.replace(cut.stack, layers=(*cut.stack.layers[:2], last)))
    assert layers_likeness.hole_percent(slant, gone, DISPLAY, lines, "nearest", FAST) > 10.0


def test_a_streamed_frame_is_its_packets():
    """A plain frame of 2 x 1 tiles: one colour, 3 bytes, each; the packets are made again from the protocol's page."""
    frame = np.full((32, 64, 3), (1, 2, 3), np.uint8)
    wanted = 0
    for tile in (0, 1):
        # Type 5, sequence 0; epoch 0, tile, coding 1.
        data = bytes([layers_likeness.Kind.TILE, 0, 0, 0, 0, tile, 0, 1, 1, 2, 3])
        wanted += len(cobs.encode(data + zlib.crc32(data).to_bytes(4, "little"))) + 1
    assert layers_likeness.tile_bytes(frame) == wanted
    assert layers_likeness.line_seconds(300_000) == pytest.approx(1.0)  # 8 bits, start and stop at 3 Mbaud


def test_the_builds_of_the_page_are_those_that_make_synth_places():
    from tools.synthesis import SCENES

    for drawn in ("nearest", "bilinear"):
        for design in (design for design in SCENES if f"-{drawn}-" in design.name):
            scene = design.scene
            assert (scene.layers, scene.width, scene.height) == (SceneBuild().layers, *BUILD_SLOT) == (4, 256, 192)
            assert scene.bilinear == (drawn == "bilinear")


def test_figures_of_the_how_to_are_those_of_the_kept_report():
    _, rows = read_csv(REPORTS / "layers.csv")
    page = (repository() / "docs/how-to/layers.md").read_text()
    text = " ".join(page.split("## How many layers?")[1].split("\n## ")[0].split())

    drawn_db = {(*(row[key] for key in ("display", "scene", "layers", "drawn")),): row["view_db"] for row in rows}
    cases = list(itertools.product(layers_likeness.DISPLAYS, ("chart", "fish"), (4, 8)))
    nearest = [drawn_db[*case, "nearest"] for case in cases]
    gains = [drawn_db[*case, "bilinear"] - one for case, one in zip(cases, nearest, strict=True)]
    assert f"PSNR of {min(nearest):.0f} to {max(nearest):.0f} dB" in text
    assert f"adds up to {max(gains):.0f} dB" in text
    assert min(gains) >= 0.0
    streamed, drawn = ([row for row in rows if (row["drawn"] == "streamed") == kind] for kind in (True, False))
    best = {(row["display"], row["scene"]): row["view_db"] for row in streamed}
    assert all(row["view_db"] < best[row["display"], row["scene"]] for row in drawn)
    assert all(row["holes_percent"] == 0.0 and row["worst_db"] <= row["view_db"] for row in drawn)
    assert f"PSNR of {min(row['view_db'] for row in streamed):.1f} dB or more" in text
    assert f"up to {max(layers_likeness.line_seconds(row['line_bytes']) for row in streamed):.1f} s" in text
    seconds = {layers_likeness.line_seconds(row["line_bytes"]) for row in rows if row["layers"] == 4}
    assert all(f"takes {one:.1f} s once" in text for one in seconds)
    assert "then a moving layer takes 39" in text
    assert {row["frame_bytes"] for row in drawn} == {39}

"""Films of layers: where each texel of a moving layer lies, what shows and in which order, and what is refused."""

import math
import os

import numpy as np
import pytest
from lippmann.errors import InputError
from lippmann.layers.layers_and_pictures import save_layers
from lippmann.layers.stack import Layer, LayerStack
from lippmann.motion.layer_film import check_keys, load_layer_film
from optics_cases import display_of

SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))
PALETTE = np.arange(1024, dtype=np.uint32).astype(np.uint8).reshape(256, 4)

DISPLAY = display_of("square", "panel")


def layer(depth, matrix, brightness=1.0):
    return Layer(np.zeros((4, 6), np.uint8), PALETTE, depth, np.array(matrix), brightness)


@pytest.fixture
def place(tmp_path):
    print(f"seed {SEED}")
    rng = np.random.default_rng(SEED)
    stack = LayerStack(
        (
            layer(3.0, rng.uniform(-2, 2, (2, 3)), 0.5),
            layer(-7.0, rng.uniform(-2, 2, (2, 3))),
            layer(math.inf, [[5.0, 0.0, 3.0], [0.0, -5.0, 2.0]]),
        )
    )
    save_layers(tmp_path / "cut", stack, ("fish", "reed", "water"))
    return tmp_path


def film_of(place, text, head="frames = 9\n"):
    path = place / "film.toml"
    path.write_text(f'layers = "cut"\n{head}{text}')
    return load_layer_film(path)


def test_a_folder_is_a_film_of_one_frame(place):
    film = load_layer_film(place / "cut")
    stack, numbers = film.at(0)
    assert (film.frames, numbers, film.names) == (1, (0, 1, 2), ("fish", "reed", "water"))
    assert [one.depth_mm for one in stack.layers] == [3.0, -7.0, math.inf]


@pytest.mark.parametrize("motion", ["linear", "smooth"])
def test_a_texel_goes_where_its_key_says(place, motion):
    """A point of the layer at rest: sheared, scaled and turned about the pivot, shifted; its texel goes with it."""
    film = film_of(
        place,
        f'motion = "{motion}"\n[[layer]]\nname = "fish"\npivot_mm = [2, -1]\nkeys = [\n'
        "{ frame = 0 },\n"
        "{ frame = 8, offset_mm = [4, -6, 10], rotation_deg = 90, scale = 2, shear = 0.5, brightness = 0.5 },\n]\n",
    )
    rest = film.stack.layers[0]
    rng = np.random.default_rng([SEED, 1])
    # By symmetry both interpolations are halfway at the middle of two keys.
    for frame, share in ((0, 0.0), (4, 0.5), (8, 1.0)):
        now = film.at(frame)[0].layers[0]
        scale, turn, shear = 1.0 + share, math.radians(90.0 * share), 0.5 * share
        assert now.depth_mm == pytest.approx(3.0 + 10.0 * share, abs=1e-12)
        assert now.brightness == pytest.approx(0.5 * (1.0 - 0.5 * share), abs=1e-12)
        for x, y in rng.uniform(-20, 20, (20, 2)):
            dx, dy = x - 2.0, y + 1.0
            dx += shear * dy
            dx, dy = scale * dx, scale * dy
            dx, dy = dx * math.cos(turn) - dy * math.sin(turn), dx * math.sin(turn) + dy * math.cos(turn)
            moved = (2.0 + dx + 4.0 * share, -1.0 + dy - 6.0 * share, 1.0)
            np.testing.assert_allclose(now.matrix @ moved, rest.matrix @ (x, y, 1.0), atol=1e-9)
    # The others stand still.
    for other in (1, 2):
        np.testing.assert_array_equal(film.at(5)[0].layers[other].matrix, film.stack.layers[other].matrix)


def test_order_and_visibility_change_at_their_keys(place):
    film = film_of(
        place,
        '[[layer]]\nname = "reed"\nkeys = [{ frame = 2, order = -1 }, { frame = 5, visible = false, order = 1 }]\n'
        '[[layer]]\nname = "water"\nkeys = [{ frame = 0, scale = 2, shear = 1 }, { frame = 6, order = 0 }]\n',
    )
    numbers = [film.at(frame)[1] for frame in range(9)]
    assert numbers == [(0, 1, 2)] * 2 + [(1, 0, 2)] * 3 + [(0, 1, 2)] + [(0, 2, 1)] * 3
    shown = [[one.visible for one in film.at(frame)[0].layers] for frame in (0, 4, 5, 6)]
    assert shown == [[True] * 3, [True] * 3, [True, False, True], [True, True, False]]
    # A sky's directions: twice the size, sheared to the right.
    sky = film.at(0)[0].layers[2]
    np.testing.assert_allclose(sky.matrix @ (0.2 + 0.4, 0.4, 1.0), [5 * 0.1 + 3, -5 * 0.2 + 2], atol=1e-12)


def keys_of(*keys, name="fish"):
    return f'[[layer]]\nname = "{name}"\nkeys = [{", ".join(f"{{ {key} }}" for key in keys)}]\n'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (keys_of("frame = 0", name="fisch"), r"layer\[0\].name: cut has no layer 'fisch'; .*fish"),
        (keys_of("frame = 9"), r"keys\[0\].frame: 9 is beyond .*at most 8"),
        (keys_of("frame = 3", "frame = 3"), r"keys\[1\].frame: 3 does not come after 3"),
        (keys_of(), r"film.toml: layer\[0\].keys: is empty; give at least 1"),
        (keys_of("frame = 0, brightness = 1.5"), "brightness"),
        (keys_of("frame = 0, scale = 0"), "scale"),
        (keys_of("frame = 0, offset_mm = [0, 0, 1]", name="water"), "'water' is a sky"),
        (keys_of("frame = 0") * 2, r"layer\[1\].name: 'fish' moves already"),
        ("", r"film.toml: layers: .*cut: is not a folder of layers; give a folder with layers.toml"),
    ],
)
def test_bad_films_are_refused(place, text, says):
    if not text:
        (place / "cut" / "layers.toml").unlink()
    with pytest.raises(InputError, match=says):
        film_of(place, text)


@pytest.mark.parametrize(
    ("shift", "says"),
    [
        (-4e6, r"film.toml: frame \d: layer: depth_mm .* is out of range"),
        # The eyes are at 600 mm, and the fish gets there in the film, not at rest.
        (900, r"film.toml: frame \d: layer 'fish': depth: .* in front of the eyes .* 600 mm"),
    ],
)
def test_a_frame_that_cannot_be_made_is_named(place, shift, says):
    film = film_of(place, keys_of("frame = 0", f"frame = 8, offset_mm = [0, 0, {shift}]"))
    with pytest.raises(InputError, match=says):
        check_keys(film, DISPLAY, "film.toml")

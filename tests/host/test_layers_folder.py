"""Folders of layers: what is saved is loaded again to the bit; bad files are one line that names file and remedy."""

import math
import re
import struct
import zlib

import numpy as np
import pytest
from layer_cases import free_stack
from lippmann import load_layers
from lippmann.errors import InputError
from lippmann.layers.layers_and_pictures import is_layers, load_named_layers, save_layers
from lippmann.layers.stack import Layer, LayerStack
from PIL import Image
from scene_cases import focused_display, generator
from test_raw_images import chunk, chunks, png

SEED = 1612
DISPLAY = focused_display("square", width_px=64, height_px=48, pixel_pitch=0.1)


def same(one, other):
    return (one.background == other.background).all() and len(one.layers) == len(other.layers) and all(
        (a.texels == b.texels).all() and a.texels.shape == b.texels.shape and (a.palette == b.palette).all()
        and a.depth_mm == b.depth_mm and (a.matrix == b.matrix).all() and a.brightness == b.brightness
        and a.visible == b.visible
        for a, b in zip(one.layers, other.layers, strict=True)
    )  # fmt: skip


@pytest.mark.parametrize("case", range(12))
def test_a_saved_stack_is_loaded_again_to_the_bit(tmp_path, case):
    random = generator(SEED, case)
    stack = free_stack(random, DISPLAY, most=300)
    file = save_layers(tmp_path / "scene", stack)
    assert same(load_layers(tmp_path / "scene"), stack)
    assert same(load_layers(file), stack)
    assert is_layers(tmp_path / "scene")
    assert not is_layers(tmp_path)
    names = tuple(f"part-{k}" for k in range(len(stack.layers)))
    save_layers(tmp_path / "scene", stack, names)
    assert load_named_layers(file)[1] == names
    assert not list((tmp_path / "scene").glob(".*"))  # no partial file is left


def test_saving_again_removes_the_former_pictures_and_nothing_else(folder):
    """`one.png` is the user's: it was not written by `save_layers`."""
    stack = LayerStack((load_layers(folder).layers[0],) * 3)
    save_layers(folder, stack)
    (folder / "layer_9.png").write_bytes((folder / "layer_1.png").read_bytes())
    save_layers(folder, LayerStack(stack.layers[:1]))
    assert sorted(path.name for path in folder.iterdir()) == ["layer_0.png", "layer_9.png", "layers.toml", "one.png"]
    # Names may differ in case alone, which some systems do not tell apart.
    save_layers(folder, LayerStack(stack.layers[:1]), ["Layer_0"])
    assert len(load_layers(folder).layers) == 1


def test_a_picture_that_is_not_ours_is_never_replaced(folder):
    stack = LayerStack((load_layers(folder).layers[0],) * 2)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InputError, match=r"one\.png: exists, and is not a layer of an earlier run; choose another"):
        save_layers(folder, stack, ["other", "one"])
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("alpha", [[255] * 256, [0] * 256, [255] * 5 + [0] + [255] * 250, [0] + [255] * 255])
def test_palettes_that_png_writes_in_a_short_form(tmp_path, alpha):
    palette = np.zeros((256, 4), np.uint8)
    palette[:, 3] = alpha
    stack = LayerStack((Layer(np.arange(256, dtype=np.uint8)[None], palette, 0.0, np.eye(3)[:2]),))
    save_layers(tmp_path, stack)
    assert same(load_layers(tmp_path), stack)


def test_the_png_holds_the_boards_bytes_and_says_how_light_follows(tmp_path):
    """Read chunk by chunk, as the PNG standard has them, without a library of pictures."""
    palette = generator(SEED, "chunks").integers(0, 256, (256, 4), np.uint8)
    save_layers(tmp_path, LayerStack((Layer(np.full((2, 3), 9, np.uint8), palette, 0.0, np.eye(3)[:2]),)), ["only"])
    found = chunks(tmp_path / "only.png")
    assert struct.unpack(">IIBB", found[b"IHDR"][:10]) == (3, 2, 8, 3)  # 8 bits, palette
    assert found[b"PLTE"] == palette[:, :3].tobytes()
    assert found[b"tRNS"] == palette[:, 3].tobytes()
    assert struct.unpack(">I", found[b"gAMA"]) == (50000,)
    assert zlib.decompress(found[b"IDAT"])[1:4] == bytes([9, 9, 9])


GOOD = """background = [0, 0.5, 1]
[[layer]]
picture = "one.png"
depth_mm = 12.5
s = [1, 0, 2]
t = [0, -1, 3]
"""


@pytest.fixture
def folder(tmp_path):
    picture = Image.fromarray(np.array([[0, 1, 2, 3], [3, 2, 1, 0]], np.uint8), "P")
    picture.putpalette(bytes(range(12)))
    picture.save(tmp_path / "one.png", transparency=bytes([0, 128]))
    (tmp_path / "layers.toml").write_text(GOOD)
    return tmp_path


def test_a_folder_written_by_hand(folder):
    stack = load_layers(folder)
    (layer,) = stack.layers
    assert stack.background.tolist() == [0.0, 0.5, 1.0]
    assert layer.texels.tolist() == [[0, 1, 2, 3], [3, 2, 1, 0]]
    assert layer.palette[:5].tolist() == [[0, 1, 2, 0], [3, 4, 5, 128], [6, 7, 8, 255], [9, 10, 11, 255], [0, 0, 0, 0]]
    assert (layer.depth_mm, layer.matrix.tolist()) == (12.5, [[1, 0, 2], [0, -1, 3]])
    assert (layer.brightness, layer.visible) == (1.0, True)
    (folder / "layers.toml").write_text(GOOD.replace("12.5", '"sky"'))
    assert math.isinf(load_layers(folder).layers[0].depth_mm)


@pytest.mark.parametrize(
    ("find", "put", "where", "remedy"),
    [
        ("depth_mm = 12.5", "", "layer[0].depth_mm", "add it"),
        ("12.5", "inf", "layer[0].depth_mm", "give a finite number, from -1e+06 to 1e+06"),
        ("12.5", "2e6", "layer[0].depth_mm", "from -1e+06 to 1e+06"),
        ("12.5", '"skye"', "layer[0].depth_mm", '"sky"'),
        ("depth_mm", "depth", "layer[0].depth", "did you mean depth_mm?"),
        ("[1, 0, 2]", "[1, 0]", "layer[0].s", "give [a, b, c], finite numbers"),
        ("[1, 0, 2]", "[1, nan, 2]", "layer[0].s", "give [a, b, c], finite numbers"),
        ("0.5", "1.5", "background[1]", "from 0 to 1"),
        ("[0, 0.5, 1]", "[0, 0.5]", "background", "give [red, green, blue], 0 to 1"),
        ("t =", "brightness = 2\nt =", "layer[0].brightness", "from 0 to 1"),
        ("one.png", "two.png", "two.png", "mend its name"),
        ("one.png", "ones.png", "ones.png", "/one.png?"),
        ("one.png", "../one.png", "layer[0].picture", "give the name of a .png in the same folder"),
        ("one.png", "one.gif", "layer[0].picture", "give the name of a .png in the same folder"),
        (r"\[\[layer(.|\n)*", "layer = []", "layer", "is empty; give at least 1: write each of them as [[layer]]"),
        (r"\Z", GOOD.partition("\n")[2], "layer[1].picture", "copy it under another name"),
        (r"\Z", GOOD.partition("\n")[2] * 8, "layers.toml: layer: 9 layers; ", "give at most 8"),
    ],
)
def test_a_bad_file_is_named(folder, find, put, where, remedy):
    (folder / "layers.toml").write_text(re.sub(find if find[0] in "\\" else re.escape(find), put, GOOD))
    with pytest.raises(InputError) as caught:
        load_layers(folder)
    line = str(caught.value)
    assert where in line
    assert remedy in line
    assert str(folder) in line
    assert "\n" not in line


def beyond_palette():
    """A PNG with an index beyond its palette, which decoders may leave to the reader."""
    rows = 2 * bytes([0, 0, 1, 2, 200])
    parts = chunk(b"PLTE", bytes(9)), chunk(b"IDAT", zlib.compress(rows)), chunk(b"IEND")
    return png(4, 2, *parts, colour_type=3)


#: What is put in a picture's place, and what its error says.
WRONG = {
    "colours": (lambda path: Image.new("RGB", (4, 2)).save(path), "is a RGB picture without a palette; convert"),
    "grey": (lambda path: Image.new("L", (4, 2)).save(path), "is a grey picture without a palette"),
    "large": (lambda path: Image.new("P", (1025, 2)).save(path), "has 1025 x 2 texels, more than a slot"),
    "cut": (lambda path: path.write_bytes(path.read_bytes()[:-30]), "is not a complete PNG picture"),
    "text": (lambda path: path.write_text("no picture"), "is not a complete PNG picture"),
    "gif": (lambda path: Image.new("P", (4, 2)).save(path, "GIF"), "is not a complete PNG picture"),
    "index": (lambda path: path.write_bytes(beyond_palette()), "uses colour 200, but its palette ends at 2"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_picture_is_named(folder, kind):
    put, wanted = WRONG[kind]
    put(folder / "one.png")
    with pytest.raises(InputError, match=re.escape(wanted)) as caught:
        load_layers(folder)
    assert str(caught.value).startswith(str(folder / "one.png"))


def test_a_folder_without_layers_and_names_that_no_file_has(tmp_path):
    with pytest.raises(InputError, match=r"is not a folder of layers; give a folder with layers.toml"):
        load_layers(tmp_path)
    with pytest.raises(InputError, match=r"not a folder of layers"):
        load_layers(tmp_path / "nowhere")
    stack = LayerStack((Layer(np.zeros((2, 2), np.uint8), np.zeros((256, 4), np.uint8), 0.0, np.eye(3)[:2]),) * 2)
    for names in (("a",), ("a", "A"), ("a", "b/c"), ("a", "")):
        with pytest.raises(InputError, match="name"):
            save_layers(tmp_path / "scene", stack, names)
    assert not (tmp_path / "scene").exists()
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match="cannot be made"):
        save_layers(tmp_path / "taken", stack)

"""A folder of layers: `layers.toml`, and beside it a PNG with a palette for each layer.

The PNG holds the bytes that a board stores, so that what is saved and loaded again is the same to the bit. Its gamma
chunk says that light is the square of a palette's colour: any viewer shows the right colours.

Layers are made from a folder of pictures with opacity, too: `pictures.toml` tells depth, place and width of each.
"""

from __future__ import annotations

import contextlib
import math
import re
import struct
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import numpy.typing as npt

from lippmann.base import toml
from lippmann.base.files import make_folder, replacing
from lippmann.base.images import check_output
from lippmann.base.toml import documented, key, toml_text
from lippmann.base.tones import decode
from lippmann.display.description import Display, Pair
from lippmann.errors import InputError, LippmannWarning, input_error, likely_file, not_there, path_of, reason
from lippmann.layers.scene_cutting import SLOT, Area, Cut, Reach, Slab, check_slot, layer_of, reach_of, texels_for
from lippmann.layers.stack import COLOURS, MAX_DEPTH_MM, MAX_LAYERS, MAX_SIDE, Bytes, Floats, Layer, LayerStack, Picture
from lippmann.optics.display_properties import depth_reach_mm
from lippmann.optics.zones import viewing_distance
from lippmann.scenes.mitsuba_xml import unique

if TYPE_CHECKING:
    import PIL.Image

#: The file that makes a folder one of layers.
FILE = "layers.toml"
#: Names of layers that are files' names on every system.
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,63}")
#: Exponent between a palette's colour and light, as PNG's gamma chunk has it: 1/2 in steps of 10^-5.
GAMMA = 50_000

Row = Annotated[tuple[float, float, float], key("", shape="[a, b, c], finite numbers")]
Sky = Literal["sky"]
Depth = Annotated[float, key("", low=-MAX_DEPTH_MM, high=MAX_DEPTH_MM)]
Light = Annotated[float, key("", low=0.0, high=1.0)]
Background = Annotated[tuple[Light, Light, Light], key("", shape="[red, green, blue], 0 to 1")]


@documented
@dataclass(frozen=True, kw_only=True)
class LayerKeys:
    """A layer of a folder."""

    picture: Annotated[Path, key("a PNG with a palette, beside this file; the name without `.png` is the layer's")]
    depth_mm: Annotated[Depth | Sky, key('z of the layer\'s plane; `"sky"`: infinitely far')]
    s: Annotated[Row, key("texel column s = a x + b y + c, to the right")]
    t: Annotated[Row, key("texel row t = a x + b y + c, downwards")]
    brightness: Annotated[Light, key("factor on the light")] = 1.0
    visible: Annotated[bool, key("whether the layer is drawn")] = True


@dataclass(frozen=True, kw_only=True)
class LayersFile:
    """The keys of `layers.toml`."""

    background: Annotated[Background, key("linear light behind all layers")] = (0.0, 0.0, 0.0)
    layer: Annotated[tuple[LayerKeys, ...], key("", lengths=(1, MAX_LAYERS))]


def is_layers(path: str | Path) -> bool:
    """Tell whether a path is a folder of layers, or its `layers.toml`."""
    return _is_of(Path(path), FILE)


def load_named_layers(path: str | Path) -> tuple[LayerStack, tuple[str, ...]]:
    """Read a folder of layers, or its `layers.toml`; return the stack, and the names of its layers.

    Raises InputError, with file, key and remedy, for bad keys and for pictures that are not 8-bit PNGs with a palette.
    """
    folder = path_of(path, "a folder of layers")
    file = folder / FILE if folder.is_dir() else folder
    if not file.exists():
        raise input_error(path, "is no folder of layers", f"give a folder with {FILE}; lippmann layers makes one")
    keys = toml.read(LayersFile, toml.load(file, "layers"), str(file))
    layers, names = [], []
    for place, one in enumerate(keys.layer):
        where = f"{file}: layer[{place}]"
        name = one.picture.stem
        if one.picture.suffix != ".png" or not NAME.fullmatch(name) or one.picture.name != str(one.picture):
            remedy = "give the name of a .png in the same folder: letters, digits, _ and - only"
            raise input_error(f"{where}.picture", f"'{one.picture}' is not a layer's picture", remedy)
        if name in names:
            raise input_error(f"{where}.picture", f"{one.picture} is a layer already", "copy it under another name")
        texels, palette = _read_png(file.parent / one.picture)
        depth = math.inf if one.depth_mm == "sky" else float(one.depth_mm)
        try:
            layers.append(Layer(texels, palette, depth, np.array([one.s, one.t]), one.brightness, one.visible))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        names.append(name)
    return LayerStack(tuple(layers), np.array(keys.background)), tuple(names)


def save_layers(path: str | Path, stack: LayerStack, names: Sequence[str] = ()) -> Path:
    """Write a stack as a folder, which is made when it is not there; return the path of its `layers.toml`.

    `names` are those of the layers; without them they are called layer_0, layer_1, ... from front to back. Pictures of
    the folder's former layers are removed, when this function had written them; no other file is replaced.

    Raises InputError for names that are not files' names, before anything is written for a picture of that name that
    this function has not written, and when a file cannot be written.
    """
    names = tuple(names) or tuple(f"layer_{place}" for place in range(len(stack.layers)))
    if len(names) != len(stack.layers) or len({name.casefold() for name in names}) != len(names):
        what = f"{len(stack.layers)} layers are called {', '.join(names)}"
        raise input_error(path, what, "give each a name of its own")
    for name in names:
        if not NAME.fullmatch(name):
            raise input_error(path, f"'{name}' is not a layer's name", "take letters, digits, _ and - only")
    folder = Path(path)
    make_folder(folder)
    file = check_output(folder / FILE, (".toml",))
    pictures = [folder / f"{name}.png" for name in names]
    for picture in pictures:
        if picture.exists() and not _is_written(picture):
            raise input_error(picture, "is there, and is no layer of an earlier run", "choose another folder")
    former = _written_pictures(file)
    for picture, layer in zip(pictures, stack.layers, strict=True):
        _write_png(picture, layer)
    with replacing(file) as partial:  # last: it names pictures that are whole
        partial.write_text(layers_text(stack, names), encoding="utf-8")
    for picture in former:
        if picture.stem.casefold() not in {name.casefold() for name in names}:
            picture.unlink(missing_ok=True)
    return file


def _written_pictures(file: Path) -> list[Path]:
    """Return the pictures that a `layers.toml` names and `save_layers` has written."""
    named: Sequence[LayerKeys] = ()
    with contextlib.suppress(InputError):  # no folder of layers: nothing in it is ours
        named = toml.read(LayersFile, toml.load(file, "layers"), str(file)).layer
    pictures = [file.parent / one.picture for one in named if one.picture.name == str(one.picture)]
    return [picture for picture in pictures if _is_written(picture)]


def _is_written(path: Path) -> bool:
    """Tell whether `save_layers` has written a picture: its gamma chunk tells."""
    with contextlib.suppress(InputError), opened_png(path, "", "") as picture:
        return bool(picture.info.get("gamma") == GAMMA / 1e5)
    return False


def layers_text(stack: LayerStack, names: Sequence[str]) -> str:
    """Return the text of `layers.toml`; numbers are written so that they are read back exactly."""
    tables = []
    for name, layer in zip(names, stack.layers, strict=True):
        depth = "sky" if layer.sky else layer.depth_mm
        values = {"picture": f"{name}.png", "depth_mm": depth, "s": layer.matrix[0].tolist()}
        values |= {"t": layer.matrix[1].tolist(), "brightness": layer.brightness, "visible": layer.visible}
        tables.append(values)
    comment = "# Layers from front to back; lengths are mm in the display's frame.\n"
    return comment + toml_text({"background": stack.background.tolist(), "layer": tables})


def check_for_display(stack: LayerStack, display: Display, where: str = "layers") -> None:
    """Refuse layers at or behind the eyes of a display; `where` goes before the layer in errors."""
    for place, layer in enumerate(stack.layers):
        check_depth(layer.depth_mm, display, f"{where}: layer[{place}].depth_mm")


def check_depth(depth_mm: float, display: Display, where: str) -> None:
    """Refuse a depth at or behind the eyes of a display; infinity is a sky's."""
    eye = viewing_distance(display)
    if eye <= depth_mm < math.inf:
        what = f"{depth_mm:g} mm is not in front of the eyes of '{display.name}', at {eye:g} mm"
        raise input_error(where, what, f"give less than {eye:g}")


@contextlib.contextmanager
def opened_png(path: Path, if_missing: str, if_broken: str) -> Iterator[PIL.Image.Image]:
    """Open a PNG for a block; InputError, with these remedies, when it is missing or cannot be read."""
    from PIL import Image, UnidentifiedImageError

    if not path.is_file():
        raise input_error(path, not_there(path, "picture"), likely_file(path, (".png",)) or if_missing)
    try:
        with Image.open(path, formats=("PNG",)) as picture:
            yield picture
    except UnidentifiedImageError:
        raise input_error(path, "is not a whole PNG picture", if_broken) from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise input_error(path, f"cannot be read ({reason(error)})", "write it again") from None


def _read_png(path: Path) -> tuple[Bytes, Bytes]:
    """Return the indices (height, width) and the palette (256, 4) of a PNG with a palette."""
    with opened_png(path, "mend its name in layers.toml", "write it again") as picture:
        if max(picture.size) > MAX_SIDE:
            what = f"has {picture.width} x {picture.height} texels, more across or down than a board's slot can have"
            raise input_error(path, what, f"make each side at most {MAX_SIDE}")
        if picture.mode != "P" or picture.palette is None:
            kind = {"L": "grey", "1": "black and white"}.get(picture.mode, picture.mode)
            what = f"is a {kind} picture without a palette"
            raise input_error(path, what, "cut it into a layer with lippmann layers, which gives it one")
        clear = picture.info.get("transparency", b"")
        texels = np.asarray(picture, np.uint8)
        colours = np.array(picture.getpalette("RGB"), np.uint8).reshape(-1, 3)
    palette = np.zeros((COLOURS, 4), np.uint8)
    palette[: len(colours), :3], palette[: len(colours), 3] = colours, 255
    if isinstance(clear, int):  # Pillow's form of a palette with one transparent colour
        palette[clear, 3] = 0
    else:
        palette[: len(clear), 3] = np.frombuffer(clear, np.uint8)[:COLOURS]
    if len(texels) and int(texels.max()) >= len(colours):
        what = f"uses colour {int(texels.max())} of a palette of {len(colours)}"
        raise input_error(path, what, "write it again")
    return texels, palette


def _write_png(path: Path, layer: Layer) -> None:
    from PIL import Image, PngImagePlugin

    picture = Image.fromarray(layer.texels, "P")
    picture.putpalette(layer.palette[:, :3].tobytes(), "RGB")
    about = PngImagePlugin.PngInfo()
    about.add(b"gAMA", struct.pack(">I", GAMMA))
    with replacing(path) as partial:
        picture.save(partial, "PNG", transparency=layer.palette[:, 3].tobytes(), pnginfo=about, optimize=False)


#: Texels across or down below which a layer is remarked upon.
FEW_TEXELS = 4


def warn_of_textures(stack: LayerStack, names: Sequence[str]) -> None:
    """Warn of layers of so few texels that their place is in doubt, and of those without a picture."""
    for name, layer in zip(names, stack.layers, strict=True):
        if min(layer.width, layer.height) < FEW_TEXELS:
            size = f"{layer.width} x {layer.height} texels"
            text = f"layer '{name}' has {size} only: check the size and place of what it shows"
            warnings.warn(text, LippmannWarning, stacklevel=2)
        if not layer.palette[layer.texels, 3].any():
            warnings.warn(f"layer '{name}' is transparent all over: it shows nothing", LippmannWarning, stacklevel=2)


def warn_of_depths(depths_mm: Iterable[tuple[str, float]], display: Display) -> None:
    """Warn of the layers that leave the display's depth range, and say how far each one goes.

    `depths_mm` are (name, z), mm; of a layer that moves one for each place. A sky, at infinity, is meant to be far.
    """
    far, near = depth_reach_mm(display)
    worst: dict[str, float] = {}
    for name, depth in depths_mm:
        if not (far <= depth <= near or math.isinf(depth)):
            worst[name] = max(worst.get(name, 0.0), depth, key=abs)
    if worst:
        places = ", ".join(f"'{name}' ({depth:+.4g} mm)" for name, depth in worst.items())
        depth_range = f"the display's depth range is z = {far:.4g} to {near:.4g} mm"
        warnings.warn(f"fine detail is lost in {places}: {depth_range}", LippmannWarning, stacklevel=2)


#: The file that makes a folder one of pictures.
PICTURES_FILE = "pictures.toml"
#: Most pixels of a picture.
MAX_PIXELS = 1 << 25
#: Rows that are decoded at once.
ROWS = 256
#: Red, green, blue and opacity of a picture's pixels, (height, width, 4).
Rgba = npt.NDArray[np.float32]
Width = Annotated[float, key("", above=0.0, high=1e6)]


@documented
@dataclass(frozen=True, kw_only=True)
class PictureKeys:
    """A picture of a folder."""

    file: Annotated[Path, key("a PNG in sRGB, with or without opacity; its path is relative to this file")]
    depth_mm: Annotated[Depth | Sky, key('z of the picture\'s plane; `"sky"`: infinitely far')]
    centre_mm: Annotated[Pair, key("position of its middle, x and y")] = (0.0, 0.0)
    width_mm: Annotated[Width | None, key("its width; the height follows", default="all that rays reach")] = None


@dataclass(frozen=True, kw_only=True)
class PicturesFile:
    """The keys of `pictures.toml`."""

    background: Annotated[Background, key("linear light behind all pictures")] = (0.0, 0.0, 0.0)
    picture: Annotated[tuple[PictureKeys, ...], key("", lengths=(1, MAX_LAYERS))]


def is_pictures(path: str | Path) -> bool:
    """Tell whether a path is a folder of pictures, or its `pictures.toml`."""
    return _is_of(Path(path), PICTURES_FILE)


def _is_of(path: Path, file: str) -> bool:
    return path.name == file or (path / file).is_file()


def cut_pictures(path: str | Path, display: Display, slot: tuple[int, int] = SLOT) -> tuple[Cut, tuple[str, ...]]:
    """Return the layers, from front to back, of a folder of pictures for a display, and their names.

    Raises InputError, with file, key and remedy, for bad keys and pictures, and for depths at or behind the eyes.
    """
    check_slot(slot)
    file = Path(path) / PICTURES_FILE if Path(path).is_dir() else Path(path)
    keys = toml.read(PicturesFile, toml.load(file, "pictures"), str(file))
    reach = reach_of(display)
    entries = []
    for place, one in enumerate(keys.picture):
        where = f"{file}: picture[{place}]"
        if one.depth_mm == "sky" and (one.width_mm is not None or one.centre_mm != (0.0, 0.0)):
            what = "a sky has neither a width nor a place"
            raise input_error(f"{where}.width_mm, centre_mm", what, "leave them out")
        depth = math.inf if one.depth_mm == "sky" else float(one.depth_mm)
        check_depth(depth, display, f"{where}.depth_mm")
        area, reached = _placed(_read(file.parent / one.file), reach, depth, one.centre_mm, one.width_mm)
        if reached is None:
            raise input_error(f"{where}.centre_mm", "no ray of the display reaches the picture", "move it inwards")
        light = _resized(reached, texels_for(area, display, slot))
        opacity = np.clip(light[..., 3], 0.0, 1.0)
        colour = np.clip(light[..., :3] / np.maximum(opacity, 1e-9)[..., None], 0.0, 1.0)
        layer, error_db = layer_of(area, Picture(colour, opacity))
        z = -math.inf if layer.sky else depth
        name = re.sub(r"[^\w-]", "_", one.file.stem, flags=re.ASCII)[:48]
        entries.append((-z, place, layer, Slab(z, z, z), error_db, name))
    _, _, layers, slabs, errors, names = zip(*sorted(entries, key=lambda entry: entry[:2]), strict=True)
    return Cut(LayerStack(layers, np.array(keys.background)), slabs, errors), tuple(unique(names))


def _read(path: Path) -> Rgba:
    """Return a picture's linear light, multiplied by its opacity, and the opacity: (height, width, 4)."""
    with opened_png(path, "mend its name in the file", "give a PNG") as picture:
        if picture.width * picture.height > MAX_PIXELS:
            what = f"has {picture.width} x {picture.height} pixels"
            raise input_error(path, what, f"make it smaller, at most {MAX_PIXELS} pixels")
        if picture.mode.startswith("I"):  # grey of 16 bits, which Pillow's conversion would clip
            numbers, white = np.asarray(picture)[..., None], 65535.0
        else:
            numbers, white = np.asarray(picture.convert("RGBA")), 255.0
    light = np.ones((*numbers.shape[:2], 4), np.float32)
    for first in range(0, len(light), ROWS):  # in parts: many times the memory of the file's numbers is taken
        rows, part = numbers[first : first + ROWS] / white, light[first : first + ROWS]
        part[..., 3:] = rows[..., 3:] if rows.shape[2] == 4 else 1.0
        part[..., :3] = decode(rows[..., :3], "srgb") * part[..., 3:]
    return light


def _placed(light: Rgba, reach: Reach, depth_mm: float, centre: Pair, width: float | None) -> tuple[Area, Rgba | None]:
    """Return where the part of a picture lies that rays reach, and that part; None where they reach none of it."""
    reached = reach.area(depth_mm)
    rows, columns = light.shape[:2]
    if width is None:  # as large as needed to cover all, about its centre
        across, up = (
            2.0 * max(abs(low - c), abs(high - c))
            for low, high, c in ((reached.left, reached.right, centre[0]), (reached.bottom, reached.top, centre[1]))
        )
        width = max(across, up * columns / rows)
    pixel = width / columns
    left, top = centre[0] - 0.5 * width, centre[1] + 0.5 * rows * pixel
    first, last = (np.clip((x - left) / pixel, 0, columns) for x in (reached.left, reached.right))
    upper, lower = (np.clip((top - y) / pixel, 0, rows) for y in (reached.top, reached.bottom))
    c0, c1, r0, r1 = math.floor(first), math.ceil(last), math.floor(upper), math.ceil(lower)
    area = Area(depth_mm, left + c0 * pixel, top - r1 * pixel, left + c1 * pixel, top - r0 * pixel)
    return area, light[r0:r1, c0:c1] if c1 > c0 and r1 > r0 else None


def _resized(light: Rgba, max_size: tuple[int, int]) -> Floats:
    """Return a picture of at most so many texels across and down, each the mean of its pixels."""
    from PIL import Image

    size = min(max_size[0], light.shape[1]), min(max_size[1], light.shape[0])
    if size == (light.shape[1], light.shape[0]):
        return light.astype(np.float64)
    planes = (Image.fromarray(np.ascontiguousarray(light[..., k]), "F") for k in range(4))
    return np.stack([np.asarray(plane.resize(size, Image.Resampling.BOX), np.float64) for plane in planes], axis=-1)

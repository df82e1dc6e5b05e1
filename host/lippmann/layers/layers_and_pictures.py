"""Reads and writes folders of layers, and reads folders of pictures (docs/reference/layers-file.md).

The PNG of a layer has the bytes that a board stores. The PNG's gamma chunk states that
light is the square of palette values, so that any viewer shows correct colours.
"""

from __future__ import annotations

import contextlib
import math
import re
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import numpy.typing as npt

from lippmann.base import toml
from lippmann.base.files import make_folder, replacing, write_file
from lippmann.base.images import check_output
from lippmann.base.toml import documented, key, toml_text
from lippmann.base.tones import decode
from lippmann.display.description import Display, Pair
from lippmann.errors import InputError, input_error, likely_file, located, not_there, path_of, reason, warn_user
from lippmann.layers.scene_cutting import SLOT, Area, Cut, Reach, Slab, check_slot, layer_of, reach_of, texels_for
from lippmann.layers.stack import COLOURS, MAX_DEPTH_MM, MAX_LAYERS, MAX_SIDE, Bytes, Floats, Layer, LayerStack, Size
from lippmann.optics.crosstalk_and_viewing_zone import viewing_distance
from lippmann.optics.display_properties import depth_reach_mm
from lippmann.scenes.mitsuba_xml import unique

if TYPE_CHECKING:
    import PIL.Image

#: File that describes a folder of layers.
FILE = "layers.toml"
#: File that describes a folder of pictures.
PICTURES_FILE = "pictures.toml"
#: Pattern of layer names that are valid file names on every system.
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,63}")
#: PNG gamma 1/2, from light to palette values, in units of 10^-5.
GAMMA = 50_000
#: A layer with fewer texels across or down causes a warning.
FEW_TEXELS = 4
#: Maximum pixels of a picture.
MAX_PIXELS = 1 << 25
#: Rows of a picture decoded at once, to limit memory.
ROWS = 256
#: Red, green, blue and opacity of a picture's pixels, (height, width, 4).
Rgba = npt.NDArray[np.float32]

Row = Annotated[tuple[float, float, float], key("", shape="[a, b, c], finite numbers")]
Sky = Literal["sky"]
Depth = Annotated[float, key("", low=-MAX_DEPTH_MM, high=MAX_DEPTH_MM)]
Light = Annotated[float, key("", low=0.0, high=1.0)]
Background = Annotated[tuple[Light, Light, Light], key("", shape="[red, green, blue], 0 to 1")]


@documented
@dataclass(frozen=True, kw_only=True)
class LayerKeys:
    """A layer in a folder of layers."""

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


def is_layers(path: str | Path, file: str = FILE) -> bool:
    """Tell whether a path is `layers.toml` (or another `file`), or a folder with this file."""
    return Path(path).name == file or (Path(path) / file).is_file()


def load_named_layers(path: str | Path) -> tuple[LayerStack, tuple[str, ...]]:
    """Read a folder of layers, or its `layers.toml`; return the stack and the layers' names.

    Raises InputError, with file, key and remedy, for invalid keys, and for pictures
    that are not 8-bit PNGs with a palette.
    """
    folder = path_of(path, "a folder of layers")
    file = folder / FILE if folder.is_dir() else folder
    if not file.exists():
        raise input_error(path, "is not a folder of layers", f"give a folder with {FILE}; lippmann layers makes one")
    keys = toml.read(LayersFile, toml.load(file, "layers"), str(file))
    layers = dict[str, Layer]()
    for place, one in enumerate(keys.layer):
        where, name, picture = f"{file}: layer[{place}]", one.picture.stem, one.picture
        if picture.suffix != ".png" or not NAME.fullmatch(name) or picture.name != str(picture):
            remedy = "give the name of a .png in the same folder: letters, digits, _ and - only"
            raise input_error(f"{where}.picture", f"'{picture}' is not a layer's picture", remedy)
        if name in layers:
            raise input_error(f"{where}.picture", f"{picture} is a layer already", "copy it under another name")
        texels, palette = _read_png(file.parent / picture)
        depth = math.inf if one.depth_mm == "sky" else float(one.depth_mm)
        with located(where):
            layers[name] = Layer(texels, palette, depth, np.array([one.s, one.t]), one.brightness, one.visible)
    return LayerStack(tuple(layers.values()), np.array(keys.background)), tuple(layers)


def save_layers(path: str | Path, stack: LayerStack, names: Sequence[str] = ()) -> Path:
    """Write a stack to a folder, created if missing; return the path of its `layers.toml`.

    `names` are the layers' names, by default layer_0, layer_1, ... from front to back.
    Pictures that this function wrote for the folder's former layers are removed.
    Other programs' pictures are not replaced.

    Raises InputError for invalid file names, names of other programs' pictures, and if
    writing fails.
    """
    names = tuple(names) or tuple(f"layer_{place}" for place in range(len(stack.layers)))
    used_names = {name.casefold() for name in names}
    if len(names) != len(stack.layers) or len(used_names) != len(names):
        what = f"{len(stack.layers)} layers are called {', '.join(names)}"
        raise input_error(path, what, "give each layer its own name")
    for name in names:
        if not NAME.fullmatch(name):
            raise input_error(path, f"'{name}' is not a layer's name", "use letters, digits, _ and - only")

    folder = Path(path)
    make_folder(folder)
    file = check_output(folder / FILE, (".toml",))
    pictures = [folder / f"{name}.png" for name in names]
    for picture in pictures:
        if picture.exists() and not _is_written(picture):
            raise input_error(picture, "exists, and is not a layer of an earlier run", "choose another folder")

    former_pictures = _written_pictures(file)
    for picture, layer in zip(pictures, stack.layers, strict=True):
        _write_png(picture, layer)
    write_file(file, _layers_text(stack, names))
    for picture in former_pictures:
        if picture.stem.casefold() not in used_names:
            picture.unlink(missing_ok=True)
    return file


def _written_pictures(file: Path) -> list[Path]:
    try:
        layers = toml.read(LayersFile, toml.load(file, "layers"), str(file)).layer
    except InputError:  # the folder has no valid layers
        return []
    pictures = [file.parent / one.picture for one in layers if one.picture.name == str(one.picture)]
    return [picture for picture in pictures if _is_written(picture)]


def _is_written(path: Path) -> bool:
    """Tell, from the gamma chunk, whether `save_layers` wrote a picture."""
    with contextlib.suppress(InputError), open_png(path, "", "") as picture:
        return bool(picture.info.get("gamma") == GAMMA / 1e5)
    return False


def _layers_text(stack: LayerStack, names: Sequence[str]) -> str:
    tables = []  # toml_text writes exact numbers
    for name, layer in zip(names, stack.layers, strict=True):
        depth = "sky" if layer.sky else layer.depth_mm
        values = {"picture": f"{name}.png", "depth_mm": depth, "s": layer.matrix[0].tolist()}
        values |= {"t": layer.matrix[1].tolist(), "brightness": layer.brightness, "visible": layer.visible}
        tables.append(values)
    comment = "# Layers from front to back; lengths are mm in the display's frame.\n"
    return comment + toml_text({"background": stack.background.tolist(), "layer": tables})


def check_for_display(stack: LayerStack, display: Display, where: str = "layers") -> None:
    """Refuse layers at or behind a display's eyes; `where` names the stack in errors."""
    for place, layer in enumerate(stack.layers):
        check_depth(layer.depth_mm, display, f"{where}: layer[{place}].depth_mm")


def check_depth(depth_mm: float, display: Display, where: str) -> None:
    """Refuse a depth at or behind a display's eyes, except the depth of a sky."""
    eye = viewing_distance(display)
    if eye <= depth_mm < math.inf:
        what = f"{depth_mm:g} mm is not in front of the eyes of '{display.name}', at {eye:g} mm"
        raise input_error(where, what, f"give less than {eye:g}")


@contextlib.contextmanager
def open_png(path: Path, if_missing: str, if_broken: str) -> Iterator[PIL.Image.Image]:
    """Open a PNG; raise InputError with the remedy `if_missing` or `if_broken`."""
    from PIL import Image, UnidentifiedImageError

    if not path.is_file():
        raise input_error(path, not_there(path, "picture"), likely_file(path, (".png",)) or if_missing)
    try:
        with Image.open(path, formats=("PNG",)) as picture:
            yield picture
    except UnidentifiedImageError:
        raise input_error(path, "is not a complete PNG picture", if_broken) from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise input_error(path, f"cannot be read ({reason(error)})", "write it again") from None


def _read_png(path: Path) -> tuple[Bytes, Bytes]:
    """Return the indices (height, width) and the palette (256, 4) of a PNG."""
    with open_png(path, "mend its name in layers.toml", "write it again") as picture:
        if max(picture.size) > MAX_SIDE:
            what = f"has {picture.width} x {picture.height} texels, more than a slot can have"
            raise input_error(path, what, f"make each side at most {MAX_SIDE}")
        if picture.mode != "P" or picture.palette is None:
            kind = {"L": "grey", "1": "black and white"}.get(picture.mode, picture.mode)
            remedy = "convert it with lippmann layers"
            raise input_error(path, f"is a {kind} picture without a palette", remedy)
        clear = picture.info.get("transparency", b"")
        texels = np.asarray(picture, np.uint8)
        colours = np.array(picture.getpalette("RGB"), np.uint8).reshape(-1, 3)
    palette = np.zeros((COLOURS, 4), np.uint8)
    palette[: len(colours), :3], palette[: len(colours), 3] = colours, 255
    if isinstance(clear, int):  # Pillow's form of a palette with one transparent colour
        palette[clear, 3] = 0
    else:
        palette[: len(clear), 3] = np.frombuffer(clear, np.uint8)[:COLOURS]
    highest = int(texels.max(initial=0))
    if texels.size and highest >= len(colours):
        raise input_error(path, f"uses colour {highest}, but its palette ends at {len(colours) - 1}", "write it again")
    return texels, palette


def _write_png(path: Path, layer: Layer) -> None:
    from PIL import Image, PngImagePlugin

    picture = Image.fromarray(layer.texels, "P")
    picture.putpalette(layer.palette[:, :3].tobytes(), "RGB")
    about = PngImagePlugin.PngInfo()
    about.add(b"gAMA", struct.pack(">I", GAMMA))
    with replacing(path) as partial:
        picture.save(partial, "PNG", transparency=layer.palette[:, 3].tobytes(), pnginfo=about, optimize=False)


def warn_of_textures(stack: LayerStack, names: Sequence[str]) -> None:
    """Warn of layers with very few texels, and of transparent layers."""
    for name, layer in zip(names, stack.layers, strict=True):
        if min(layer.width, layer.height) < FEW_TEXELS:
            size = f"{layer.width} x {layer.height} texels"
            warn_user(f"layer '{name}' has only {size}: check the size and position of its objects")
        if not layer.palette[layer.texels, 3].any():
            warn_user(f"layer '{name}' is completely transparent: it shows nothing")


def warn_of_depths(depths_mm: Iterable[tuple[str, float]], display: Display) -> None:
    """Warn of layers (name, z in mm) outside the display's depth range, except of skies."""
    far, near = depth_reach_mm(display)
    worst: dict[str, float] = {}
    for name, depth in depths_mm:
        if not (far <= depth <= near or math.isinf(depth)):
            worst[name] = max(worst.get(name, 0.0), depth, key=abs)
    if worst:
        places = ", ".join(f"'{name}' ({depth:+.4g} mm)" for name, depth in worst.items())
        depth_range = f"the display's depth range is z = {far:.4g} to {near:.4g} mm"
        warn_user(f"fine detail is lost in {places}: {depth_range}")


Width = Annotated[float, key("", above=0.0, high=1e6)]


@documented
@dataclass(frozen=True, kw_only=True)
class PictureKeys:
    """A picture in a folder of pictures."""

    file: Annotated[Path, key("a PNG in sRGB, with or without opacity; its path is relative to this file")]
    depth_mm: Annotated[Depth | Sky, key('z of the picture\'s plane; `"sky"`: infinitely far')]
    centre_mm: Annotated[Pair, key("position of its middle, x and y")] = (0.0, 0.0)
    width_mm: Annotated[Width | None, key("its width; the height follows", default="all that rays reach")] = None


@dataclass(frozen=True, kw_only=True)
class PicturesFile:
    """The keys of `pictures.toml`."""

    background: Annotated[Background, key("linear light behind all pictures")] = (0.0, 0.0, 0.0)
    picture: Annotated[tuple[PictureKeys, ...], key("", lengths=(1, MAX_LAYERS))]


def cut_pictures(path: str | Path, display: Display, slot: Size = SLOT) -> tuple[Cut, tuple[str, ...]]:
    """Return the layers of a folder of pictures for a display, front to back, and their names.

    Raises InputError, with file, key and remedy, for invalid keys and pictures, and for
    depths at or behind the eyes.
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
        picture = _read_picture(file.parent / one.file)
        area, reached = _crop_to_reach(picture, reach, depth, one.centre_mm, one.width_mm)
        if not reached.size:
            raise input_error(f"{where}.centre_mm", "no ray reaches the picture", "move it towards the centre")
        light = _resize_picture(reached, texels_for(area, display, slot))
        opacity = np.clip(light[..., 3], 0.0, 1.0)
        colour = np.clip(light[..., :3] / np.maximum(opacity, 1e-9)[..., None], 0.0, 1.0)
        layer, error_db = layer_of(area, colour, opacity)
        z = -math.inf if layer.sky else depth
        name = re.sub(r"[^\w-]", "_", one.file.stem, flags=re.ASCII)[:48]
        entries.append((layer, Slab(z, z, z), error_db, name))
    entries.sort(key=lambda entry: -entry[1].depth_mm)
    layers, slabs, errors, names = zip(*entries, strict=True)
    return Cut(LayerStack(layers, np.array(keys.background)), slabs, errors), tuple(unique(names))


def _read_picture(path: Path) -> Rgba:
    """Return a picture's premultiplied linear light and its opacity, (height, width, 4)."""
    with open_png(path, "mend its name in pictures.toml", "give a PNG") as picture:
        width, height = picture.size
        if width * height > MAX_PIXELS:
            remedy = f"give at most {MAX_PIXELS} pixels"
            raise input_error(path, f"has too many pixels ({width} x {height})", remedy)
        if picture.mode.startswith("I"):  # 16-bit grey, which Pillow would clip
            numbers, white = np.asarray(picture)[..., None], 65535.0
        else:
            numbers, white = np.asarray(picture.convert("RGBA")), 255.0
    light = np.ones((height, width, 4), np.float32)
    for first in range(0, height, ROWS):
        rows, part = numbers[first : first + ROWS] / white, light[first : first + ROWS]
        part[..., 3:] = rows[..., 3:] if rows.shape[2] == 4 else 1.0
        part[..., :3] = decode(rows[..., :3], "srgb") * part[..., 3:]
    return light


def _crop_to_reach(light: Rgba, reach: Reach, depth_mm: float, centre: Pair, width: float | None) -> tuple[Area, Rgba]:
    reached = reach.area(depth_mm)
    rows, columns = light.shape[:2]
    if width is None:  # wide enough to cover `reached`
        across = 2.0 * max(abs(side - centre[0]) for side in (reached.x0, reached.x1))
        up = 2.0 * max(abs(side - centre[1]) for side in (reached.y0, reached.y1))
        width = max(across, up * columns / rows)
    pixel = width / columns
    x0, y0 = centre[0] - 0.5 * width, centre[1] + 0.5 * rows * pixel
    first, last = (np.clip((x - x0) / pixel, 0, columns) for x in (reached.x0, reached.x1))
    upper, lower = (np.clip((y0 - y) / pixel, 0, rows) for y in (reached.y1, reached.y0))
    c0, c1, r0, r1 = math.floor(first), math.ceil(last), math.floor(upper), math.ceil(lower)
    area = Area(depth_mm, x0 + c0 * pixel, y0 - r1 * pixel, x0 + c1 * pixel, y0 - r0 * pixel)
    return area, light[r0:r1, c0:c1]


def _resize_picture(light: Rgba, max_size: Size) -> Floats:
    from PIL import Image

    height, width = light.shape[:2]
    size = min(max_size[0], width), min(max_size[1], height)
    if size == (width, height):
        return light.astype(np.float64)
    planes = (Image.fromarray(np.ascontiguousarray(light[..., k]), "F") for k in range(4))
    return np.stack([np.asarray(plane.resize(size, Image.Resampling.BOX), np.float64) for plane in planes], axis=-1)

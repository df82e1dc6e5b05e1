"""Layers from a folder of pictures with opacity: `pictures.toml` tells the depth, place and width of each."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt

from lippmann.base import toml
from lippmann.base.toml import documented, key
from lippmann.base.tones import decode
from lippmann.display.description import Display, Pair
from lippmann.errors import input_error
from lippmann.layers.layers_folder import Background, Depth, Sky, check_depth, opened_png
from lippmann.layers.scene_cutting import SLOT, Area, Cut, Reach, Slab, check_slot, layer_of, reach_of, texels_for
from lippmann.layers.stack import MAX_LAYERS, Floats, LayerStack, Picture
from lippmann.scenes.mitsuba_xml import unique

#: The file that makes a folder one of pictures.
FILE = "pictures.toml"
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
    path = Path(path)
    return path.name == FILE or (path.is_dir() and (path / FILE).is_file())


def cut_pictures(path: str | Path, display: Display, slot: tuple[int, int] = SLOT) -> tuple[Cut, tuple[str, ...]]:
    """Return the layers, from front to back, of a folder of pictures for a display, and their names.

    Raises InputError, with file, key and remedy, for bad keys and pictures, and for depths at or behind the eyes.
    """
    check_slot(slot)
    file = Path(path) / FILE if Path(path).is_dir() else Path(path)
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
            raise input_error(str(path), what, f"make it smaller, at most {MAX_PIXELS} pixels")
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
        across, up = (2.0 * max(abs(low - c), abs(high - c)) for low, high, c in
                      ((reached.left, reached.right, centre[0]), (reached.bottom, reached.top, centre[1])))  # fmt: skip
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

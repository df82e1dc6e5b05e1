"""Converts eyes' views of a window, in a folder or quilt, to a Mitsuba scene.

The eyes are in a row or a grid in front of the window. A point in the window's plane is
at the same pixel position in all views.

A quilt contains the views as tiles in Looking Glass' order: the leftmost eye's view is
at the bottom left, the next views follow to the right, then upward. A quilt with the
name `NAME_qs8x6a0.75.png` has 8 columns and 6 rows of views 0.75 times as wide as high.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import numpy.typing as npt

from lippmann.base.file_limits import read_limited
from lippmann.base.images import LINEAR_SUFFIXES, Radiance, StoredRows
from lippmann.base.tones import decode
from lippmann.errors import input_error
from lippmann.optics.rays import Floats
from lippmann.scenes.mitsuba_xml import new_scene, plugin, to_world, value, write

#: File with the eyes' positions in a folder of views.
EYES = "views.json"
PICTURES = (".png", ".jpg", ".jpeg", ".webp", *LINEAR_SUFFIXES)
#: Maximum distance of an eye from its grid position, in steps of the grid.
GRID_TOLERANCE = 0.1
MAX_VIEWS, MAX_PIXELS = 10_000, 200_000_000
MAX_BYTES = 1 << 24
MAX_HALF = float(np.finfo(np.float16).max)
FORM = '{"window_mm": [64, 48], "views": [{"file": "view_0000.png", "eye_mm": [-30, 0, 600]}, ...]}'


@dataclass(frozen=True)
class Views:
    """Linear pictures (rows, columns, height, width, 3) of a window, as eyes on a grid see it."""

    pictures: npt.NDArray[np.float16]
    x_mm: Sequence[float]
    y_mm: Sequence[float]
    distance_mm: float
    size_mm: tuple[float, float]

    def show_on(self, shape: Element, folder: Path) -> None:
        """Add the emitter `light_field` with the views to a shape, and make the shape black."""
        np.savez(
            folder / "views.npz",
            views=self.pictures,
            x_mm=self.x_mm,
            y_mm=self.y_mm,
            distance_mm=self.distance_mm,
            size_mm=self.size_mm,
        )
        value(plugin(shape, "bsdf", "diffuse"), "rgb", "reflectance", 0.0)
        value(plugin(shape, "emitter", "light_field"), "string", "filename", "views.npz")

    def write_scene(self, folder: Path) -> Path:
        """Write a scene of the views into an empty folder; return its path."""
        scene = new_scene()
        shape = plugin(scene, "shape", "rectangle", id="window")
        to_world(shape, "scale", x=0.5 * self.size_mm[0], y=0.5 * self.size_mm[1], z=1)
        self.show_on(shape, folder)
        return write(scene, folder / "scene.xml")


def eyes_text(size_mm: Sequence[float], names: Sequence[str], eyes: Sequence[Sequence[float]], **more: object) -> str:
    """Return the text of the file `EYES`: window's size, names of views, eyes' positions, mm."""
    views = [{"file": name, "eye_mm": list(eye)} for name, eye in zip(names, eyes, strict=True)]
    return json.dumps({"window_mm": list(size_mm), **more, "views": views}, indent=1) + "\n"


def read_folder(folder: Path) -> Views:
    """Read a folder of views.

    Raises InputError for invalid files, and for eyes that form no row or grid.
    """
    path = folder / EYES
    try:
        keys = json.loads(read_limited(path, MAX_BYTES, "write it again"))
        size = (float(keys["window_mm"][0]), float(keys["window_mm"][1]))
        views = [(str(one["file"]), tuple(float(c) for c in one["eye_mm"])) for one in keys["views"]]
    except (ValueError, TypeError, KeyError, IndexError, RecursionError) as error:
        reason = f"no {error}" if isinstance(error, KeyError) else str(error)[:100]
        raise input_error(path, f"does not describe the views ({reason})", f"write {FORM}") from None

    eyes = np.array([eye for _, eye in views if len(eye) == 3])
    if not (min(size) > 0.0 and math.isfinite(sum(size))):
        raise input_error(path, f"window_mm is {size[0]:g} x {size[1]:g}", "give width and height above 0")
    if not 0 < len(views) <= MAX_VIEWS:
        raise input_error(path, f"has {len(views)} views", f"give 1 to {MAX_VIEWS}")
    if len(eyes) != len(views) or not np.isfinite(eyes).all():
        raise input_error(path, "has an eye_mm that is not three numbers", f"write {FORM}")
    if not eyes[:, 2].min() > 0.0 or np.ptp(eyes[:, 2]) > 1e-3 * eyes[0, 2]:
        what = "has eyes at several distances, or behind the window"
        raise input_error(path, what, "give all eyes the same z above 0")
    (x, columns), (y, rows) = _steps(path, eyes[:, 0]), _steps(path, eyes[:, 1])
    if len(x) * len(y) != len(views) or len(set(zip(rows.tolist(), columns.tolist(), strict=True))) != len(views):
        what = f"has {len(views)} eyes on {len(x)} columns and {len(y)} rows"
        raise input_error(path, what, "give one view per position of a row or grid")

    pictures: npt.NDArray[np.float16] | None = None
    for (name, _), row, column in zip(views, rows, columns, strict=True):
        one, _ = read_light(folder / name, len(views))
        if pictures is None:
            pictures = np.zeros((len(y), len(x), *one.shape), np.float16)
        if one.shape != pictures.shape[2:]:
            what = f"has {one.shape[1]} x {one.shape[0]} pixels, the first view {pictures.shape[3]} x "
            raise input_error(folder / name, f"{what}{pictures.shape[2]}", "give views of equal size")
        pictures[row, column] = one
    assert pictures is not None
    return Views(pictures, x, y, float(eyes[0, 2]), size)


def _steps(path: Path, places: Floats) -> tuple[list[float], npt.NDArray[np.intp]]:
    """Return the ascending positions of a grid's lines, and the index of each eye's line."""
    rising = np.sort(places)
    gaps = np.diff(rising)
    # Eyes nearer to each other than 1/8 of a typical grid step are on one line.
    steps = gaps[gaps > 1e-6 * max(1.0, float(np.abs(places).max()))]
    wide = gaps > (0.125 * float(np.quantile(steps, 0.75)) if len(steps) else math.inf)
    groups = np.split(rising, np.flatnonzero(wide) + 1)
    lines = np.array([group.mean() for group in groups])
    number = np.abs(places[:, None] - lines).argmin(axis=1)
    step = float(np.diff(lines).min()) if len(lines) > 1 else math.inf
    if np.abs(places - lines[number]).max() > GRID_TOLERANCE * step:
        raise input_error(path, "has eyes that form no row or grid", "align the eyes in rows and columns")
    return lines.tolist(), number


def _check_size(path: Path, pixels: int) -> None:
    if pixels > MAX_PIXELS:
        what = f"the views have {pixels / 1e6:.0f} million pixels; {MAX_PIXELS // 1_000_000} are allowed"
        raise input_error(path, what, "give fewer or smaller views")


def read_light(path: Path, count: int = 1) -> tuple[Radiance, dict[str, str]]:
    """Read a picture; return linear light (height, width, 3) and metadata.

    Raises InputError if `count` such pictures are too large.
    """
    # Check the size before memory for pixels is allocated.
    if path.suffix.lower() in (".png", *LINEAR_SUFFIXES):
        with StoredRows(path) as rows:
            _check_size(path, count * rows.shape[0] * rows.shape[1])
            radiance, metadata = np.asarray(rows), rows.metadata
    else:
        radiance, metadata = _read_by_pillow(path, count), {}
    return np.clip(radiance, 0.0, MAX_HALF, out=radiance), metadata


def _read_by_pillow(path: Path, count: int) -> Radiance:
    from PIL import Image

    try:
        with Image.open(path) as opened:
            _check_size(path, count * opened.width * opened.height)
            return decode(np.asarray(opened.convert("RGB"), np.float32) / np.float32(255.0), "srgb")
    except FileNotFoundError:
        raise input_error(path, "no such picture", "add it, or remove it from the list") from None
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise input_error(path, f"cannot be read ({str(error)[:100]})", f"give {', '.join(PICTURES)}") from None


#: Pattern of the tiling in a quilt's name: columns, rows, aspect of a view.
TILING = re.compile(r"_qs([1-9][0-9]{0,2})x([1-9][0-9]{0,2})a([0-9]{1,4}(?:\.[0-9]{1,9})?)$")
#: Looking Glass' angles, degrees: between the outermost cameras, and a camera's vertical field.
CONE_DEG, FIELD_DEG = 40.0, 14.0
EYES_KEY = "eyes"


def quilt_path(path: Path, columns: int, rows: int, aspect: float) -> Path:
    """Add the tiling to a quilt's name; raise InputError if the name has another tiling."""
    aspect_text = f"{aspect:.5f}".rstrip("0").rstrip(".")
    ending = f"_qs{columns}x{rows}a{aspect_text}"
    tiling = TILING.search(path.stem)
    if tiling is None:
        return path.with_name(f"{path.stem}{ending}{path.suffix}")
    if (int(tiling[1]), int(tiling[2])) != (columns, rows) or abs(float(tiling[3]) - aspect) > 0.01 * aspect:
        raise input_error(path, f"has another tiling than {ending}", "leave the tiling out of the name")
    return path


def tiled(views: Iterable[Radiance], columns: int, rows: int) -> Radiance:
    """Return a quilt of views (height, width, 3), which are ordered from left to right."""
    quilt: Radiance | None = None
    for number, view in enumerate(views):
        if quilt is None:
            quilt = np.zeros((rows, view.shape[0], columns, view.shape[1], 3), np.float32)
        up, column = divmod(number, columns)
        quilt[rows - 1 - up, :, column] = view
    assert quilt is not None
    return quilt.reshape(rows * quilt.shape[1], -1, 3)


def eyes_note(size_mm: Sequence[float], eyes: Sequence[Sequence[float]]) -> dict[str, str]:
    """Return a quilt's metadata: window's size, first and last eye's position, mm."""
    return {EYES_KEY: json.dumps({"window_mm": list(size_mm), "first_mm": list(eyes[0]), "last_mm": list(eyes[-1])})}


def read_quilt(path: Path) -> Views:
    """Read a quilt; default eye positions are Looking Glass'. Raises InputError for an invalid picture."""
    tiling = TILING.search(path.stem)
    assert tiling is not None
    columns, rows, aspect = int(tiling[1]), int(tiling[2]), float(tiling[3])
    quilt, metadata = read_light(path)
    height, width = quilt.shape[0] // rows, quilt.shape[1] // columns
    if not (height and width and aspect > 0.0):
        what = f"has {quilt.shape[1]} x {quilt.shape[0]} pixels, too few for {columns} x {rows} views"
        raise input_error(path, what, "correct the tiling in the file's name")
    tiles = quilt[: rows * height, : columns * width].reshape(rows, height, columns, width, 3)
    # The first view is at the bottom left.
    views = tiles[::-1].transpose(0, 2, 1, 3, 4).reshape(1, rows * columns, height, width, 3)
    size, y, distance = (aspect, 1.0), 0.0, 0.5 / math.tan(math.radians(0.5 * FIELD_DEG))
    last_x = math.tan(math.radians(0.5 * CONE_DEG)) * distance if rows * columns > 1 else 0.0
    first_x = -last_x
    if EYES_KEY in metadata:
        try:
            eyes = json.loads(metadata[EYES_KEY])
            size = (float(eyes["window_mm"][0]), float(eyes["window_mm"][1]))
            (first_x, y, distance), last_x = map(float, eyes["first_mm"]), float(eyes["last_mm"][0])
        except (ValueError, TypeError, KeyError, IndexError):
            raise input_error(path, f"has invalid metadata '{EYES_KEY}'", "export it again") from None
    x = np.linspace(first_x, last_x, rows * columns).tolist()
    return Views(np.ascontiguousarray(views, np.float16), x, [y], distance, size)

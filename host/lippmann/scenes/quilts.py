"""Quilts: the views of a light-field display as tiles of one picture, by Looking Glass' rules.

The first view is the leftmost eye's, at the bottom left; the views go on to the right, then upward; the last one, of
the rightmost eye, is at the top right. The file's name tells the tiling and the aspect of a view:
`NAME_qs8x6a0.75.png` has 8 columns and 6 rows of views that are 0.75 times as wide as high.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from lippmann.base.images import Radiance
from lippmann.errors import input_error
from lippmann.scenes.window_views import PICTURES, Views, picture

#: The tiling in a quilt's name: columns, rows, aspect.
TILING = re.compile(r"_qs([1-9][0-9]{0,2})x([1-9][0-9]{0,2})a([0-9]{1,4}(?:\.[0-9]{1,9})?)$")
#: What a quilt of another tool does not tell, of Looking Glass' cameras: the cone of their eyes and the height of the
#: window as an eye sees it, degrees.
CONE_DEG, FIELD_DEG = 40.0, 14.0
#: The metadata that tell a quilt's eyes.
NOTE = "eyes"
#: Digits of the aspect.
ASPECT_DIGITS = 5


def quilt_path(path: Path, columns: int, rows: int, aspect: float) -> Path:
    """Return the path of a quilt, with its tiling in the name; InputError when the name tells another one."""
    ending = f"_qs{columns}x{rows}a{f'{aspect:.{ASPECT_DIGITS}f}'.rstrip('0').rstrip('.')}"
    told = TILING.search(path.stem)
    if told is None:
        return path.with_name(f"{path.stem}{ending}{path.suffix}")
    if (int(told[1]), int(told[2])) != (columns, rows) or abs(float(told[3]) - aspect) > 0.01 * aspect:
        raise input_error(str(path), f"names another tiling than {ending}", "leave the tiling out of the name")
    return path


def tiled(views: Iterable[Radiance], columns: int, rows: int) -> Radiance:
    """Return the quilt of views in the order of the eyes from left to right, (height, width, 3) each."""
    quilt: Radiance | None = None
    for number, view in enumerate(views):
        height, width = view.shape[:2]
        if quilt is None:
            quilt = np.zeros((rows * height, columns * width, 3), np.float32)
        up, column = divmod(number, columns)
        top = (rows - 1 - up) * height
        quilt[top : top + height, column * width : (column + 1) * width] = view
    assert quilt is not None
    return quilt


def eyes_note(size_mm: Sequence[float], eyes: Sequence[Sequence[float]]) -> dict[str, str]:
    """Return the metadata of a quilt that tell its window's size and its eyes, mm, which its name does not."""
    return {NOTE: json.dumps({"window_mm": list(size_mm), "first_mm": list(eyes[0]), "last_mm": list(eyes[-1])})}


def is_quilt(path: Path) -> bool:
    """Tell whether a file is a quilt by its name, such as fish_qs8x6a1.33.png."""
    return path.suffix.lower() in PICTURES and TILING.search(path.stem) is not None


def read_quilt(path: Path) -> Views:
    """Read a quilt. Where its file does not tell the eyes, they are those of Looking Glass' cameras.

    Raises InputError for a picture that cannot be read, or whose size has no such tiling.
    """
    told = TILING.search(path.stem)
    assert told is not None
    columns, rows, aspect = int(told[1]), int(told[2]), float(told[3])
    whole, metadata = picture(path)
    height, width = whole.shape[0] // rows, whole.shape[1] // columns
    if not (height and width and aspect > 0.0):
        what = f"has {whole.shape[1]} x {whole.shape[0]} pixels, too few for {columns} x {rows} views"
        raise input_error(str(path), what, "correct the tiling in its name")
    tiles = whole[: rows * height, : columns * width].reshape(rows, height, columns, width, 3)
    # The first view is at the bottom left.
    views = tiles[::-1].transpose(0, 2, 1, 3, 4).reshape(1, rows * columns, height, width, 3)
    size = (aspect, 1.0)
    distance = 0.5 / math.tan(math.radians(0.5 * FIELD_DEG))
    reach = math.tan(math.radians(0.5 * CONE_DEG)) * distance
    x = np.linspace(-reach, reach, rows * columns).tolist() if rows * columns > 1 else [0.0]
    y = 0.0
    if NOTE in metadata:
        try:
            eyes = json.loads(metadata[NOTE])
            size = (float(eyes["window_mm"][0]), float(eyes["window_mm"][1]))
            (left, y, distance), right = map(float, eyes["first_mm"]), float(eyes["last_mm"][0])
            x = np.linspace(left, right, rows * columns).tolist() if rows * columns > 1 else [left]
        except (ValueError, TypeError, KeyError, IndexError):
            raise input_error(str(path), "its note of the eyes is broken", "export it again") from None
    return Views(np.ascontiguousarray(views), x, [y], distance, size)

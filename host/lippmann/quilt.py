"""Quilts: the views of a light-field display as tiles of one picture, by Looking Glass' rules.

The first view is the leftmost eye's, at the bottom left; the views go on to the right, then upward; the last one, of
the rightmost eye, is at the top right. The file's name tells the tiling and the aspect of a view:
`NAME_qs8x6a0.75.png` has 8 columns and 6 rows of views that are 0.75 times as wide as high.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from lippmann.errors import input_error
from lippmann.images import Radiance

#: The tiling in a quilt's name: columns, rows, aspect.
TILING = re.compile(r"_qs([1-9][0-9]{0,2})x([1-9][0-9]{0,2})a([0-9]+(?:\.[0-9]+)?)$")
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

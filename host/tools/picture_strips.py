"""Pictures that compare engines, models and word lengths: a scene's integral image, and an eye's view of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from lippmann.base.variant import mitsuba
from lippmann.rendering.sources import Lines, RaySource


def every_strip(source: RaySource, every: int, rows: int = 1) -> RaySource:
    """Return a part of a picture: every so many strips of so many rows (`rows_of_strips`)."""
    mi = mitsuba()

    def moved(b: Any, v: Any) -> tuple[Any, Any]:
        strip = b.floor(v * (1.0 / rows))
        return strip, v + (strip * (every - 1.0) + every // 2) * rows

    def lines(b: Any, u: Any, v: Any, square: Any) -> Lines:
        return source.lines(b, u, moved(b, v)[1], square)

    height = source.height_px // (every * rows) * rows
    taken = replace(source, height_px=height, lines=lines, owner=None)
    owner_of = source.owner
    if owner_of is None:
        return taken

    def owner(b: Any, u: Any, v: Any) -> Any:
        strip, v = moved(b, v)
        # The strip's number is added, so that pixels of two strips never share.
        return owner_of(b, u, v) + mi.UInt32(mi.Int32(strip)) * 0x9E3779B1

    return replace(taken, owner=owner)


def rows_of_strips(height_px: int, every: int, rows: int = 1) -> npt.NDArray[np.int64]:
    """Return the picture's rows that `every_strip` takes, from the middle of the first group of strips on."""
    strips = np.arange(height_px // (every * rows)) * every + every // 2
    taken: npt.NDArray[np.int64] = (strips[:, None] * rows + np.arange(rows)).ravel()
    return taken

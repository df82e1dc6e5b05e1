"""The samples of an image: which pixel each belongs to, its line of sight, and the ray into the scene.

Samples are numbered pixel by pixel, and in each colour by colour, where a pixel has sub-pixels. Pixels come in square
tiles, row by row, and in Morton order in each, so that rays traced together stay close.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lippmann.base.variant import current_device, mitsuba
from lippmann.display.description import Panel
from lippmann.display.subpixels import COLOURS, Box, Layout, layout_of
from lippmann.optics.backend import DrJitBackend
from lippmann.optics.sampling import points_in_pixel, points_in_square
from lippmann.rendering.sources import Lines, RaySource
from lippmann.scenes.placement import Placement

#: Side of the tiles.
TILE_PX = 8


def colour_count(layout: Layout | None) -> int:
    """Return how many colours have samples of their own: three where pixels have sub-pixels, else one for all."""
    if layout is None:
        return 1
    return 3


def colours_of(panel: Panel) -> int:
    """Return how many colours of a panel's pixels have samples of their own."""
    return colour_count(layout_of(panel.subpixels))


def pixel_of(first_tile: Any, place: Any, width: int, height: int) -> tuple[Any, Any]:
    """Return the pixel number of a place in the order of tiles, and whether it lies inside the image."""
    mi = mitsuba()
    tiles_across = -(-width // TILE_PX)
    tile = first_tile + place // (TILE_PX * TILE_PX)
    bits = place & (TILE_PX * TILE_PX - 1)
    x = (bits & 1) | ((bits >> 1) & 2) | ((bits >> 2) & 4)
    y = ((bits >> 1) & 1) | ((bits >> 2) & 2) | ((bits >> 3) & 4)
    tile_row = tile // tiles_across
    column = (tile - tile_row * tiles_across) * TILE_PX + x
    row = tile_row * TILE_PX + y
    inside = (column < width) & (row < height)
    return mi.UInt32(row * width + column), inside


@dataclass
class Parts:
    """The parts of pixels that are sampled (`Box`): Dr.Jit values, for each colour one for each pixel of the layout."""

    box: tuple[Any, Any, Any, Any]
    #: Whether all parts are as high as their pixels.
    full_height: bool

    @classmethod
    def of(cls, layout: Layout | None) -> Parts:
        """Return the parts of a layout; opaque, so that other places need no compilation."""
        mi = mitsuba()
        import drjit as dr

        boxes = [Box(0.0, 0.0, 1.0, 1.0)]
        if layout is not None:
            boxes = [box for colour in COLOURS[: colour_count(layout)] for box in layout.boxes(colour)]
        u, v, width, height = (mi.Float(list(column)) for column in zip(*boxes, strict=True))
        dr.make_opaque(u, v, width, height)
        return cls((u, v, width, height), all(box.v == 0.0 and box.height == 1.0 for box in boxes))


@dataclass
class Seeds:
    """Seeds of random numbers: Dr.Jit values (UInt32). No named tuple, whose values Dr.Jit would not record."""

    #: Of the image.
    image: Any
    #: The picture's pass: how many were made before.
    number: Any


def lines_of(
    source: RaySource, samples: int, seeds: Seeds, pixel: Any, sample: Any, parts: Parts, colour: Any = 0
) -> Lines:
    """Return the lines of sight of samples, by the numbers of their pixels, their own, and their colours (UInt32)."""
    mi = mitsuba()
    import drjit as dr

    b = DrJitBackend(current_device())
    x, y = points_in_pixel(pixel, sample, samples, seeds.image, seeds.number)
    row = pixel // source.width_px
    column = pixel - row * source.width_px
    box = Box(*parts.box)
    if source.layout is not None:
        number = (colour * source.layout.rows + row % source.layout.rows) * source.layout.columns
        number += column % source.layout.columns
        box = Box(*(dr.gather(mi.Float, values, number) for values in box))
    u = b.double(column) + b.double(0.5 + box.u + box.width * (x - 0.5))
    if not parts.full_height:
        y = 0.5 + box.v + box.height * (y - 0.5)
    return source.lines(b, u, b.double(row) + b.double(y), points_in_square(pixel, sample, seeds.image + seeds.number))


@dataclass
class Pose:
    """Where a scene stands, as Dr.Jit values: arguments of a program, so that a moved scene needs no other one."""

    near_mm: Any
    #: The first three rows of `Placement.scene_from_display`; None where that is the identity.
    rows: list[list[Any]] | None

    @classmethod
    def of(cls, placement: Placement) -> Pose:
        """Return the pose of a placement."""
        mi = mitsuba()
        import drjit as dr

        matrix = placement.scene_from_display
        moved = not np.array_equal(matrix, np.eye(4))
        rows = [[dr.opaque(mi.Float, float(x)) for x in line] for line in matrix[:3]] if moved else None
        return cls(dr.opaque(mi.Float, placement.near_mm), rows)

    def ray(self, lines: Lines) -> Any:
        """Return the scene's rays along lines of sight, from in front of the scene towards the display."""
        mi = mitsuba()
        import drjit as dr

        point, direction, near = lines.point, lines.direction, self.near_mm
        t = (near - point[2]) / direction[2]
        start = mi.Point3f(point[0] + t * direction[0], point[1] + t * direction[1], near)
        back = mi.Vector3f(*(-c for c in direction))
        if self.rows is not None:
            m = self.rows
            start = mi.Point3f(*(line[0] * start.x + line[1] * start.y + line[2] * start.z + line[3] for line in m))
            back = dr.normalize(mi.Vector3f(*(line[0] * back.x + line[1] * back.y + line[2] * back.z for line in m)))
        ray = mi.RayDifferential3f(start, back)
        ray.wavelengths = []
        return ray

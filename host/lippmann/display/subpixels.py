"""Describe which sub-pixel emits a pixel's colour: the pixel's own, or the nearest."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal, NamedTuple

from lippmann.errors import InputError

Colour = Literal["red", "green", "blue", "white"]
#: A numpy or Dr.Jit array, or a backend for such arrays.
Numbers = Any
COLOURS: tuple[Colour, ...] = ("red", "green", "blue", "white")
#: A sub-pixel, in pixels: colour, centre (x right, y up, from the first pixel's centre), width, height.
Subpixel = tuple[Colour, float, float, float, float]
#: Maximum period of a layout along x and y, pixels.
MAX_PERIOD = 16
#: Accepted rounding error of coordinates in a file, pixels.
ROUNDING = 1e-6


def _row(order: str, column: int = 0, row: int = 0) -> tuple[Subpixel, ...]:
    names, n = {name[0]: name for name in COLOURS}, len(order)
    places = [column + (2 * k + 1 - n) / (2 * n) for k in range(n)]
    stripes = zip(order, places, strict=True)
    return tuple((names[letter], x, -float(row), 1.0 / n, 1.0) for letter, x in stripes)


#: Layouts, keyed by name. In `pentile`, red-green pixels alternate with blue-green pixels.
LAYOUTS: dict[str, tuple[Subpixel, ...]] = {
    **{order: _row(order) for order in ("rgb", "bgr", "rgbw")},
    "pentile": (*_row("rg"), *_row("bg", 1), *_row("bg", 0, 1), *_row("rg", 1, 1)),
}


class Box(NamedTuple):
    """A rectangle, in pixels: centre (u right, v down, from a pixel's centre), width, height."""

    u: float
    v: float
    width: float
    height: float


@dataclass(frozen=True)
class Layout:
    """The sub-pixel layout of a panel, which repeats every `columns` by `rows` pixels."""

    subpixels: tuple[Subpixel, ...]
    columns: int
    rows: int

    def gain(self, colour: Colour) -> float:
        """Return a sub-pixel's brightness relative to its pixel: panel area / its colour's area."""
        area = sum(w * h for name, _, _, w, h in self.subpixels if name == colour)
        return self.columns * self.rows / area

    def emitters(self, b: Numbers, u: Numbers, v: Numbers) -> Iterator[tuple[int, float, Numbers]]:
        """Yield each sub-pixel's colour (index in `COLOURS`) and gain, and a mask of points (u, v) inside it."""
        tile_u = u - self.columns * b.floor(u / self.columns)
        tile_v = v - self.rows * b.floor(v / self.rows)
        for colour, u_min, v_min, u_max, v_max in self.edges():
            inside = (tile_u >= u_min) & (tile_u < u_max) & (tile_v >= v_min) & (tile_v < v_max)
            yield COLOURS.index(colour), self.gain(colour), inside

    def edges(self) -> Iterator[tuple[Colour, float, float, float, float]]:
        """Yield each sub-pixel's colour and edges (left, top, right, bottom), pixels from the layout's top left."""
        for colour, x, y, w, h in self.subpixels:
            # Round the edges, so that neighbouring sub-pixels share an edge.
            u_min, u_max = (round(0.5 + x + side * w, 12) for side in (-0.5, 0.5))
            v_min, v_max = (round(0.5 - y + side * h, 12) for side in (-0.5, 0.5))
            yield colour, u_min, v_min, u_max, v_max

    def split_light(self, light: Sequence[Numbers], darkest: Numbers) -> list[Numbers]:
        """Split a pixel's light: white sub-pixels, if any, emit its minimum `darkest`, others the remainder."""
        if "white" not in (colour for colour, *_ in self.subpixels):
            return list(light)
        return [*(colour - darkest for colour in light), darkest]

    def boxes(self, colour: Colour) -> list[Box]:
        """Return the sub-pixel that emits a colour for each pixel, row by row.

        If a pixel lacks the colour, the nearest sub-pixel emits the colour.
        """
        own = [sub for sub in self.subpixels if sub[0] == colour]
        boxes = []
        for number in range(self.columns * self.rows):
            row, column = divmod(number, self.columns)
            away = {sub: math.hypot(sub[1] - column, sub[2] + row) for sub in own}
            _, x, y, w, h = min(own, key=lambda sub: (_pixel_of(sub) != (column, row), away[sub]))
            boxes.append(Box(x - column, -y - row, w, h))
        return boxes

    @property
    def borrows(self) -> bool:
        """Whether some pixel lacks a red, green or blue sub-pixel."""
        boxes = (box for colour in COLOURS[:3] for box in self.boxes(colour))
        return any(max(abs(box.u), abs(box.v)) > 0.5 + ROUNDING for box in boxes)


def _pixel_of(subpixel: Subpixel) -> tuple[int, int]:
    return math.floor(subpixel[1] + 0.5), math.floor(-subpixel[2] + 0.5)


def layout_of(subpixels: str | tuple[Subpixel, ...]) -> Layout | None:
    """Return the layout for a name or a table, None for "none".

    Raises InputError for an invalid table.
    """
    if subpixels == "none":
        return None
    table = LAYOUTS[subpixels] if isinstance(subpixels, str) else subpixels
    titles = [f"the {colour} sub-pixel at [{x:g}, {y:g}]" for colour, x, y, _, _ in table]
    pixels = [_pixel_of(sub) for sub in table]
    for colour in COLOURS[:3]:
        if colour not in (sub[0] for sub in table):
            raise InputError(f"the layout has no {colour}; add a sub-pixel of that colour")
    owned = [(sub[0], pixel) for sub, pixel in zip(table, pixels, strict=True)]
    for (colour, x, y, w, h), (column, row), subject in zip(table, pixels, titles, strict=True):
        if not (0 <= column < MAX_PERIOD and 0 <= row < MAX_PERIOD):
            place = f"is not in the {MAX_PERIOD} x {MAX_PERIOD} pixels right of and below the first"
            raise InputError(f"{subject} {place}; give x and y in pixels from the first pixel's centre, y upwards")
        room = 0.5 + ROUNDING
        fits = abs(x - column) + 0.5 * w <= room and abs(y + row) + 0.5 * h <= room
        if not (w > 0.0 and h > 0.0 and fits):
            raise InputError(f"{subject}, {w:g} x {h:g} pixels, is not inside its pixel; make it smaller or move it")
        if owned.count((colour, (column, row))) > 1:
            remedy = "remove one, or describe two pixels"
            raise InputError(f"{subject} shares its pixel with another {colour} sub-pixel; {remedy}")
    for ((_, *first), one), ((_, *second), other) in combinations(zip(table, titles, strict=True), 2):
        gaps = (abs(first[k] - second[k]) - 0.5 * (first[k + 2] + second[k + 2]) for k in (0, 1))
        if max(gaps) < -ROUNDING:
            raise InputError(f"{one} overlaps {other}; shrink or move one of them")
    return Layout(table, 1 + max(column for column, _ in pixels), 1 + max(row for _, row in pixels))
